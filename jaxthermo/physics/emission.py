"""Emission to the surroundings, net of what comes back (thesis eq. 1, completed).

q = eps sigma A (T_s^4 - T^4), for a surface that sees only surroundings at T_s. The
thesis drops the second half and then the whole term; at 300 K it is worth a heat
transfer coefficient of 6 W/(m^2 K), as much as still air. Source: Stefan-Boltzmann law,
Kirchhoff's law for a grey surface.

T is that of the surface, and the node under it is half a cell away, so the surface
settles where emission and conduction through the half cell meet. Newton's method finds
that from the hotter of node and surroundings, where it cannot overshoot.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..array_types import Scalar
from ..constants import STEFAN_BOLTZMANN
from .term import AbstractBoundTerm, AbstractTerm, Drive, LeftOut, Surface
from .values import check_value, for_jit, is_zero, largest, value_at


NEWTON_STEPS = 5
"""From 10 times the node's temperature in a near-insulator they leave 1e-5 of q."""


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
        gap = (ambient - self.reference) - theta
        # Of the surface over the node: a difference, so that float32 keeps its digits.
        excess = jnp.maximum(gap, 0)
        for _ in range(NEWTON_STEPS):
            hot = self.reference + theta + excess
            net = self._net(ambient, hot, gap - excess) - self.half_cell * excess
            slope = 4 * self.strength * hot * hot * hot + self.half_cell
            excess = excess + net / jnp.where(slope > 0, slope, 1)
        return self.half_cell * excess

    def _net(self, ambient, hot, difference):
        sums = (ambient + hot) * (ambient * ambient + hot * hot)
        return self.strength * difference * sums

    def stiffness(self, hottest: Float[Array, ""], end: float) -> Float[Array, "*m"]:
        """4 eps sigma A T^3 in series with the half cell [W/K]."""
        del end
        slope = 4 * self.strength * hottest.astype(self.strength.dtype) ** 3
        total = slope + self.half_cell
        return slope * self.half_cell / jnp.where(total > 0, total, 1)


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
