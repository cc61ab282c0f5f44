"""Emission to the surroundings, net of what comes back (thesis eq. 1, completed).

q = eps sigma A (T_s^4 - T^4), for a surface that sees only surroundings at T_s. The
thesis drops the second half and then the whole term; at 300 K it is worth a heat
transfer coefficient of 6 W/(m^2 K), as much as still air. Source: Stefan-Boltzmann law,
Kirchhoff's law for a grey surface.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..constants import STEFAN_BOLTZMANN
from .term import AbstractBoundTerm, AbstractTerm, LeftOut, Surface
from .values import is_zero, largest, value_at


class BoundEmission(AbstractBoundTerm):
    """Net emission of every fragment of one body."""

    fragments: Int[Array, " m"] | None
    strength: Float[Array, " s"]
    """eps sigma A [W/K^4]."""
    temperature: Any
    reference: Float[Array, ""]

    def heat_rate(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """eps sigma A (T_s - T)(T_s + T)(T_s^2 + T^2), exact for close temperatures."""
        ambient = value_at(self.temperature, time)
        hot = self.reference + theta
        difference = (ambient - self.reference) - theta
        return self.strength * difference * (ambient + hot) * (ambient**2 + hot**2)

    def stiffness(self, hottest: Float[Array, ""], end: float) -> Float[Array, "*m"]:
        """4 eps sigma A T^3 [W/K]."""
        del end
        return 4 * self.strength * hottest.astype(self.strength.dtype) ** 3


class Surroundings(AbstractTerm):
    """Surroundings at one temperature: net emission eps sigma (T_s^4 - T^4) [W/m^2]."""

    temperature: Any
    """T_s [K], a number or a function of time."""

    @property
    def name(self) -> str:
        """In the ledger."""
        return "emission"

    @property
    def knots(self) -> tuple[float, ...]:
        """Of the temperature."""
        return getattr(self.temperature, "knots", ())

    def bind(self, surface: Surface, reference: float) -> AbstractBoundTerm | LeftOut:
        """Every fragment, with the emissivity of its material."""
        if is_zero(surface.emissivity):
            return LeftOut("the surface has emissivity 0")
        strength = STEFAN_BOLTZMANN * surface.emissivity * surface.area
        return BoundEmission(
            fragments=None,
            strength=strength,
            temperature=self.temperature,
            reference=jnp.asarray(reference, surface.dtype),
        )

    def pulls_to(self, end: float) -> Float[Array, ""]:
        """The surroundings' own temperature [K]."""
        return largest(self.temperature, end)

    def pushes(self, end: float) -> Float[Array, ""]:
        """Nothing is imposed."""
        del end
        return jnp.zeros(())
