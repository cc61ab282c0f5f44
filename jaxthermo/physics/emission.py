"""Emission to the surroundings, net of what comes back (thesis eq. 1, completed).

q = eps sigma A (T_s^4 - T^4), for a surface that sees only surroundings at T_s. The
thesis drops the second half and then the whole term; at 300 K it is worth a heat
transfer coefficient of 6 W/(m^2 K), as much as still air. Source: Stefan-Boltzmann law,
Kirchhoff's law for a grey surface.

T is that of the surface. The node under it is half a cell away: one step of Newton's
method for the temperature between gives q / (1 + 4 eps sigma T^3 pitch / (2 k)) with
the node's T, exact to second order in the pitch.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..array_types import Scalar
from ..constants import STEFAN_BOLTZMANN
from .term import AbstractBoundTerm, AbstractTerm, Drive, LeftOut, Surface
from .values import check_value, for_jit, is_zero, largest, value_at


class BoundEmission(AbstractBoundTerm):
    """Net emission of every fragment of one body."""

    fragments: Int[Array, " m"] | None
    strength: Float[Array, " s"]
    """eps sigma A [W/K^4]."""
    half_cell: Float[Array, " s"]
    """Between node and surface, 2 k A / pitch [W/K]."""
    temperature: Any
    reference: Float[Array, ""]

    def heat_rate(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """Eps sigma A (T_s - T)(T_s + T)(T_s^2 + T^2), exact for close temperatures."""
        ambient = value_at(self.temperature, time)
        hot = self.reference + theta
        difference = (ambient - self.reference) - theta
        sums = (ambient + hot) * (ambient * ambient + hot * hot)
        slope = 4 * self.strength * hot * hot * hot
        total = self.half_cell + slope
        share = self.half_cell / jnp.where(total > 0, total, 1)
        return share * self.strength * difference * sums

    def stiffness(self, hottest: Float[Array, ""], end: float) -> Float[Array, "*m"]:
        """4 eps sigma A T^3 [W/K]."""
        del end
        return 4 * self.strength * hottest.astype(self.strength.dtype) ** 3


class Surroundings(AbstractTerm):
    """Surroundings at one temperature: net emission eps sigma (T_s^4 - T^4) [W/m^2]."""

    temperature: Any
    """T_s [K], a number or a function of time."""

    def __check_init__(self):
        check_value(self.temperature, "Surroundings(temperature [K])", 0.0)

    @property
    def name(self) -> str:
        """In the ledger."""
        return "emission"

    @property
    def values(self) -> tuple[Any, ...]:
        """Its temperature."""
        return (self.temperature,)

    def bind(self, surface: Surface, reference: Scalar) -> AbstractBoundTerm | LeftOut:
        """Every fragment, with the emissivity of its material."""
        if is_zero(surface.emissivity):
            return LeftOut("the surface has emissivity 0")
        strength = STEFAN_BOLTZMANN * surface.emissivity * surface.area
        return BoundEmission(
            fragments=None,
            strength=strength,
            half_cell=2 * surface.conductivity / surface.pitch * surface.area,
            temperature=for_jit(self.temperature, surface.dtype),
            reference=jnp.asarray(reference, surface.dtype),
        )

    def drive(self, end: float | int) -> Drive:
        """Towards its temperature [K]."""
        return Drive(temperature=largest(self.temperature, end))
