"""A directional source with Lambert's law and its shadow (thesis eq. 3).

q = a E max(0, -d . n) s A: absorptivity, irradiance, cosine between the normal n and
the way back along the rays' direction d, lit share, true area. The thesis writes the
diffuse term of Phong's model without the maximum; behind the terminator it would cool.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..array_types import Scalar
from ..raster.directions import unit_vector
from .boundary import ImposedFlux
from .shadow import lit_share
from .term import AbstractTerm, Binding, Drive, LeftOut, Surface, binding
from .values import check_value, for_jit, is_zero, largest


class Sun(AbstractTerm):
    """Parallel rays with shadows."""

    direction: tuple[float, float, float] = eqx.field(static=True)
    """The way the rays travel; any length."""
    irradiance: Any
    """E on a surface that faces the rays [W/m^2]; a number or a function of time."""

    def __check_init__(self):
        unit_vector(self.direction, "Sun(direction=)")
        check_value(self.irradiance, "Sun(irradiance [W/m^2])", 0.0)

    @property
    def name(self) -> str:
        """In the ledger."""
        return "sun"

    @property
    def values(self) -> tuple[Any, ...]:
        """Its irradiance."""
        return (self.irradiance,)

    def exposure(
        self,
        triangles: Float[np.ndarray, "f 3 3"],
        position: Float[np.ndarray, "s 3"],
        normal: Float[np.ndarray, "s 3"],
        pitch: float,
    ) -> Float[np.ndarray, " s"]:
        """Lambert's cosine times the lit share of surface points: 0 to 1."""
        cosine = np.maximum(0.0, -normal @ unit_vector(self.direction))
        return cosine * lit_share(triangles, position, normal, self.direction, pitch)

    def bind(self, surface: Surface, reference: Scalar) -> Binding | LeftOut:
        """The free fragments that the source sees."""
        del reference
        if is_zero(self.irradiance):
            return LeftOut("the irradiance is 0")
        if is_zero(surface.absorptivity):
            return LeftOut("the surface has absorptivity 0")
        acts = surface.acted_on(None)
        if isinstance(acts, LeftOut):
            return acts
        exposure = self.exposure(
            surface.scene_triangles, surface.position, surface.normal, surface.pitch
        )
        lit = acts & (exposure > 0)
        if not lit.any():
            return LeftOut("no surface of this body sees it")
        share = surface.absorptivity * jnp.asarray(exposure, surface.dtype)
        law = ImposedFlux(for_jit(self.irradiance, surface.dtype))
        return binding(share * surface.area, law, lit)

    def drive(self, end: float | int) -> Drive:
        """An imposed heat flux [W/m^2]."""
        return Drive(heat_flux=largest(self.irradiance, end))
