"""A small source near by: irradiance I cos / R^2, with the shadows of one point.

E = I max(0, L . n) s / max(R, R_0)^2: radiant intensity I [W/sr], the unit vector L to
the source, lit share s, distance R, and the least distance R_0 from which on a real
source is no point any more. The thesis' eq. 3 leaves the distance out.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ..term import Drive, Surface
from ..time_varying import check_value, largest
from .shadow import lit_share_from
from .source import (
    AbstractSource,
    Triple,
    check_point,
    fixed_or_moving,
    inside_body,
    placed,
)


class PointSource(AbstractSource):
    """Rays from one point, the same in all directions, with shadows."""

    position: Triple | Callable[[float], Any] = eqx.field(
        static=True, converter=fixed_or_moving
    )
    """World [m]; or a function of time [s] that gives it."""
    radiant_intensity: Any
    """I [W/sr], the power over 4 pi; a number or a function of time."""
    least_distance: float = eqx.field(static=True, default=0.01)
    """R_0 [m]: nearer surfaces get what there is at this distance."""

    def __check_init__(self):
        check_point(placed(self.position, 0.0), "PointSource(position=)")
        what = "PointSource(radiant_intensity [W/sr])"
        check_value(self.radiant_intensity, what, 0.0)
        if not (np.isfinite(self.least_distance) and self.least_distance > 0):
            raise InputError(
                f"PointSource(least_distance={self.least_distance!r}): "
                "give a positive length in metres"
            )

    @property
    def name(self) -> str:
        """In the ledger."""
        return "point_source"

    @property
    def strength(self) -> Any:
        """Its radiant intensity [W/sr]."""
        return self.radiant_intensity

    @property
    def values(self) -> tuple[Any, ...]:
        """Its radiant intensity."""
        return (self.radiant_intensity,)

    @property
    def place(self) -> str:
        """Its position."""
        return "position"

    def check_place(self, surface: Surface) -> None:
        """Refuse a source inside a body.

        Raises:
            InputError: if it is.
        """
        if inside_body(surface, np.asarray(self.position, float)[None]).any():
            raise InputError(
                f"PointSource(position={self.position}): is inside body "
                f"{surface.body}; move it out of the body"
            )

    def exposure(
        self,
        triangles: Float[np.ndarray, "f 3 3"],
        position: Float[np.ndarray, "s 3"],
        normal: Float[np.ndarray, "s 3"],
        pitch: float,
    ) -> Float[np.ndarray, " s"]:
        """Cosine times lit share over the square of the distance [1/m^2]."""
        eye = np.asarray(self.position, float)
        away = eye - position
        distance = np.linalg.norm(away, axis=1)
        floored = np.maximum(distance, self.least_distance)
        along = np.einsum("ij,ij->i", normal, away) / np.where(
            distance > 0, distance, 1
        )
        found = np.maximum(0.0, along) / (floored * floored)
        faces = np.flatnonzero(found > 0)
        found[faces] *= lit_share_from(
            triangles, position[faces], normal[faces], eye, pitch
        )
        return found

    def drive(self, end: float | int) -> Drive:
        """The heat flux at the least distance [W/m^2]."""
        most = largest(self.radiant_intensity, end)
        return Drive(heat_flux=most / (self.least_distance * self.least_distance))
