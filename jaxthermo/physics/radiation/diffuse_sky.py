"""Diffuse daylight: short-wave radiation of an even sky, also reflected by the ground.

    q = a (F_sky E_sky + F_ground E_ground) A

with the absorptivity a, the view factors F and irradiances of horizontal surfaces E
(isotropic sky; Liu and Jordan, Solar Energy 7 (1963) 53). The bright region around the
sun is not resolved.
"""

import equinox as eqx
from typing_extensions import override

from ...arrays import TimeVarying
from ...voxels.selection import AbstractSelection
from ..boundary import ImposedFlux
from ..surface import Surface
from ..term import OperatingPoint, Scale
from ..time_varying import check_value, for_jit, is_zero, largest
from .irradiation import AbstractRadiativeTerm, Irradiation
from .visibility import check_directions, sky_view_of


class DiffuseSky(AbstractRadiativeTerm):
    """Diffuse daylight from the sky and from the ground.

    q = a (F_sky E_sky + F_ground E_ground) [W/m^2]

    With `occlusion` obstacles hide both, and count as black.

    Raises:
        InputError: for a negative irradiance, or too few directions.
    """

    name = "diffuse_sky"
    absorbed_by = "absorptivity"
    unseen = "none of the surface sees the sky or the ground"
    dark = "it is dark at all times"
    from_outside = True

    irradiance: TimeVarying
    """E_sky on a horizontal surface [W/m^2]: a number or a function of time."""
    reflected: TimeVarying = 0.0
    """E_ground, albedo times the global irradiance [W/m^2]: a number or a function of
    time."""
    occlusion: int | None = eqx.field(static=True, default=None)
    """Number of directions in which obstacles are detected, such as 128."""
    on: AbstractSelection | None = None
    """Part of the surface that it heats."""

    def __check_init__(self):
        check_value(self.irradiance, "DiffuseSky(irradiance [W/m^2])", 0.0)
        check_value(self.reflected, "DiffuseSky(reflected [W/m^2])", 0.0)
        if self.occlusion is not None:
            check_directions(self.occlusion)

    @override
    def irradiation(self, surface: Surface) -> tuple[Irradiation, ...]:
        views = [sky_view_of(body, self.occlusion) for body in surface.bodies]
        return tuple(
            self._on_all(
                surface,
                [view[n] for view in views],
                ImposedFlux(for_jit(strength, surface.dtype)),
            )
            for n, strength in enumerate((self.irradiance, self.reflected))
            if not (surface.prune and is_zero(strength))
        )

    @override
    def scale(self, point: OperatingPoint) -> Scale:
        strength = max(
            float(largest(e, point.end)) for e in (self.irradiance, self.reflected)
        )
        return Scale(heat_flux=float(point.material.absorptivity) * strength)
