"""Emission to the surroundings, net of what comes back (thesis eq. 1, completed).

q = eps sigma A (T_s^4 - T^4), for a surface that sees only surroundings at T_s. The
thesis drops the second half and then the whole term; at 300 K it is worth a heat
transfer coefficient of 6 W/(m^2 K), as much as still air. Source: Stefan-Boltzmann law,
Kirchhoff's law for a grey surface.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..array_types import Scalar
from ..constants import STEFAN_BOLTZMANN
from .term import AbstractLaw, AbstractTerm, Binding, Drive, LeftOut, Surface, binding
from .values import check_value, for_jit, is_zero, largest, value_at


class Emission(AbstractLaw):
    """Net emission of a black surface; the share holds the emissivity."""

    temperature: Any
    """Of the surroundings [K]."""
    reference: Float[Array, ""]

    def flux(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """Sigma (T_s - T)(T_s + T)(T_s^2 + T^2), exact for close temperatures."""
        ambient = value_at(self.temperature, time)
        hot = self.reference + theta
        difference = (ambient - self.reference) - theta
        sums = (ambient + hot) * (ambient * ambient + hot * hot)
        return STEFAN_BOLTZMANN * difference * sums

    def slope(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """4 sigma T^3, of a grey surface."""
        del time
        hot = jnp.maximum(self.reference + theta, 0)
        return 4 * STEFAN_BOLTZMANN * hot * hot * hot

    def steepest(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """4 sigma T^3 at the hottest."""
        del end
        return 4 * STEFAN_BOLTZMANN * hottest**3

    @property
    def is_linear(self) -> bool:
        """No."""
        return False

    def hot_side(
        self, time: Float[Array, ""], pushed: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """Where emission alone sheds what is pushed in, or the surroundings'."""
        ambient = value_at(self.temperature, time)
        # Scaled by the surroundings' or 1 K, so that a fourth power stays in float32.
        scale = jnp.maximum(ambient, 1)
        square = (ambient / scale) * (ambient / scale)
        shed = jnp.maximum(pushed, 0) / STEFAN_BOLTZMANN / scale**4
        level = jnp.maximum(square * square + shed, jnp.finfo(pushed.dtype).tiny)
        # Two square roots are vectorized, and a power is not.
        return scale * jnp.sqrt(jnp.sqrt(level)) - self.reference


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

    def bind(self, surface: Surface, reference: Scalar) -> Binding | LeftOut:
        """Every free fragment, with the emissivity of its material."""
        if is_zero(surface.emissivity):
            return LeftOut("the surface has emissivity 0")
        acts = surface.acted_on(None)
        if isinstance(acts, LeftOut):
            return acts
        law = Emission(
            temperature=for_jit(self.temperature, surface.dtype),
            reference=jnp.asarray(reference, surface.dtype),
        )
        return binding(surface.emissivity * surface.area, law, acts)

    def drive(self, end: float | int) -> Drive:
        """Towards its temperature [K]."""
        return Drive(temperature=largest(self.temperature, end))
