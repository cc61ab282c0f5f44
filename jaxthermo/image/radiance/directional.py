"""Surfaces that are not Lambertian: emissivity by the angle, and Phong reflection."""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from ...arrays import static_numbers
from ...errors import InputError
from ...geometry.vectors import row_dot, unit_vectors
from ...physics.radiation.diffuse_sky import DiffuseSky
from ...physics.radiation.source import AbstractSource, Sun
from ...physics.term import AbstractTerm
from ...physics.time_varying import is_zero
from ..surface.view import LinesOfSight, View
from .effect import AbstractSurfaceEffect, Horizon, PixelRadiation, check_range


class AngularEmissivity(AbstractSurfaceEffect):
    """Emissivity that falls towards grazing angles, as of paint and other dielectrics.

        eps(theta) = eps_n [1 - (1 - cos theta)^5],

    Schlick's form of Fresnel's equations, and the absorptivity likewise. The emissivity
    of the material is that along the normal; the heat balance takes it as the
    hemispherical one, which by this form is 1/21 lower.
    """

    rank = 0

    exponent: float = static_numbers(5.0)
    """Exponent [-]; a larger one keeps the emissivity up to larger angles."""

    def __check_init__(self):
        check_range(self, "exponent", 1, 100)

    @override
    def prepared(self, view: View, xp: Any) -> Any:
        return 1 - (1 - view.sight.cosine) ** self.exponent

    @override
    def apply(
        self, radiation: PixelRadiation, prepared: Any, horizon: Horizon
    ) -> PixelRadiation:
        return radiation._replace(
            emissivity=radiation.emissivity * prepared,
            absorptivity=radiation.absorptivity * prepared,
        )


class _Lobes(NamedTuple):
    """Weights of what is reflected around the mirror direction."""

    sources: Float[np.ndarray, "q p"]
    """Radiance per irradiance of each source, if all is reflected [1/sr]."""
    sky: Float[np.ndarray, " p"]
    """Fraction of the lobe above the horizon minus that of the hemisphere [-]."""


class SpecularReflection(AbstractSurfaceEffect):
    """Glossy reflection: Phong's lobe around the mirror direction.

        L = rho [(1 - s) E / pi + s E (n + 2) / (2 pi) cos^n alpha]

    of the irradiance E of a source, whose direction is alpha from the mirrored line of
    sight; with this factor no more than rho E is reflected. The lobe sees another
    mixture of sky and ground than the hemisphere, where nothing in the image hides them
    (`occlusion`) and outside of closed cavities. Other bodies are not mirrored.
    """

    rank = 1

    fraction: Any = 0.5
    """s, fraction of the reflected radiation in the lobe [-]."""
    exponent: float = static_numbers(20.0)
    """n, 5 for satin to 1000 for a polished surface [-]."""

    def __check_init__(self):
        check_range(self, "fraction", 0, 1)
        check_range(self, "exponent", 1, 100000)

    @override
    def prepared(self, view: View, xp: Any) -> _Lobes:
        sight = view.sight
        rows = [lobe for term in view.terms for lobe in self._lobes(term, sight)]
        lobes = np.array(rows).reshape(len(rows), len(sight.cosine))
        above = _above_horizon(np.arcsin(sight.mirror[:, 2].clip(-1, 1)), self.exponent)
        sky = above - (1 + view.normal[:, 2]) / 2
        if view.open_fraction is not None:
            sky = sky * view.open_fraction
        if view.is_enclosed is not None:
            # There the hemisphere and the lobe see the same walls.
            sky = sky * (1 - view.means(view.is_enclosed.astype(float)))
        return _Lobes(lobes, sky)

    def _lobes(
        self, term: AbstractTerm, sight: LinesOfSight
    ) -> list[Float[np.ndarray, " p"]]:
        """Lobes of what a term sends, a row for each irradiation by sources."""
        if isinstance(term, AbstractSource):
            return [] if is_zero(term.strength) else [self._lobe(term, sight)]
        if isinstance(term, DiffuseSky):
            # It comes from everywhere, and leaves as from a matt surface.
            on = [s for s in (term.irradiance, term.reflected) if not is_zero(s)]
            return [np.full(len(sight.cosine), 1 / math.pi) for _ in on]
        return []

    def _lobe(
        self, source: AbstractSource, sight: LinesOfSight
    ) -> Float[np.ndarray, " p"]:
        if isinstance(source, Sun):
            away = -np.asarray(source.direction, float)[None]
        else:
            away = source.points().mean(0) - sight.point
        towards = np.broadcast_to(unit_vectors(away), sight.mirror.shape)
        cosine = row_dot(sight.mirror, towards).clip(0, 1)
        return (self.exponent + 2) / (2 * math.pi) * cosine**self.exponent

    @override
    def apply(
        self, radiation: PixelRadiation, prepared: _Lobes, horizon: Horizon
    ) -> PixelRadiation:
        lobes, sky = prepared
        if len(lobes) != len(radiation.sources):
            raise InputError(
                f"SpecularReflection: {len(radiation.sources)} sources irradiate the "
                f"bodies, and the directions of {len(lobes)} are known: it takes Sun, "
                "PointSource, AreaSource and DiffuseSky"
            )
        contrast = sky * (horizon.sky - horizon.ground)
        thermal = radiation.thermal / math.pi + contrast
        mirrored = (1 - radiation.emissivity) * thermal
        lit = (lobes * radiation.sources).sum(0)
        mirrored = mirrored + (1 - radiation.absorptivity) * lit
        return radiation._replace(
            diffuse=radiation.diffuse * (1 - self.fraction),
            mirrored=radiation.mirrored + self.fraction * mirrored,
        )


@lru_cache(maxsize=8)
def _lobe_table(exponent: float) -> tuple[np.ndarray, np.ndarray]:
    """Elevations of a lobe's axis [rad], and the fraction of it above the horizon."""
    # In cos^(n + 1), in which the lobe has the same weight everywhere.
    power = (np.arange(256) + 0.5) / 256
    angle = np.arccos(power ** (1 / (exponent + 1)))
    elevation = np.linspace(-math.pi / 2, math.pi / 2, 513)
    with np.errstate(over="ignore"):
        edge = -np.tan(elevation[:, None]) / np.tan(angle)
    return elevation, np.arccos(edge.clip(-1, 1)).mean(1) / math.pi


def _above_horizon(
    elevation: Float[np.ndarray, " p"], exponent: float
) -> Float[np.ndarray, " p"]:
    return np.interp(elevation, *_lobe_table(exponent))
