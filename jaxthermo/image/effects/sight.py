"""Lines of sight of a view: directions and distances of surface points."""

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float

from ..camera import OrthographicCamera
from ..view import View


class LinesOfSight(NamedTuple):
    """Geometry of the p pixels of a view that show a body."""

    point: Float[np.ndarray, "p 3"]
    """Surface points in the world [m]."""
    towards: Float[np.ndarray, "p 3"]
    """Unit vectors to the camera."""
    distance: Float[np.ndarray, " p"]
    """Distance of the camera [m]; from the image plane of an orthographic one."""
    cosine: Float[np.ndarray, " p"]
    """Cosine of the angle from the normal, not negative."""
    mirror: Float[np.ndarray, "p 3"]
    """Unit vectors along which light comes that a mirror would send to the camera."""


_known: WeakKeyDictionary[View, LinesOfSight] = WeakKeyDictionary()


def lines_of_sight(view: View) -> LinesOfSight:
    """Lines of sight of a view, kept as long as the view."""
    if view not in _known:
        _known[view] = _computed(view)
    return _known[view]


def _computed(view: View) -> LinesOfSight:
    origin, step = view.camera.rays(view.pixel)
    length = np.linalg.norm(step, axis=1)
    point = origin + step * view.depth[:, None]
    towards = -step / length[:, None]
    along = np.einsum("ij,ij->i", towards, view.normal)
    # A smooth normal may look away from the camera at an outline.
    cosine = np.clip(along, 0, 1)
    mirror = 2 * cosine[:, None] * view.normal - towards
    mirror /= np.linalg.norm(mirror, axis=1)[:, None]
    parallel = isinstance(view.camera, OrthographicCamera)
    distance = view.depth if parallel else view.depth * length
    return LinesOfSight(
        point=point, towards=towards, distance=distance, cosine=cosine, mirror=mirror
    )
