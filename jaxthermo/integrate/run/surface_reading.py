"""Surface temperatures between fragments, to second order in the pitch.

Through the fragments near a point that face the same way, a plane over the tangent
plane of the surface is laid by weighted least squares, and read at the point. Facing
decides: a thin sheet has another temperature a voxel behind, a fold a voxel away.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.spatial import KDTree

from ...geometry.vectors import tangents
from ...memo.found import found
from ...scene.scene import BodyGeometry


_NEIGHBOURS = 9
"""Fragments through whose temperatures a plane is laid."""

_CANDIDATES = 4 * _NEIGHBOURS
"""Fragments among which they are selected: on thin parts half face the other way."""

_SAME_SIDE = 0.5
"""Smallest cosine between normals of one side [-]."""

# On a sphere the chord to a point whose normal is 60 degrees off rises by half of that.
_MAX_RISE = np.tan(np.arccos(_SAME_SIDE) / 2)
"""Largest height of a fragment above the tangent plane over its distance along it."""

_MAX_HEIGHT = 0.25
"""Height up to which points and fragments are of one surface anyway [pitches]."""

# Fragments of a plane are up to 0.9 pitches from its points, those of a face of a
# polyhedron, near its edges and corners, up to 1.4; of a rounded one more.
_REACH = 1.75
"""Distance to the nearest fragment beyond which a point is lost [pitches]."""

_APART = 1e-3
"""Distance below which fragments are at the same point [pitches]."""

_CLOSE = 0.05
"""Square of the distance below which fragments count the same [pitches^2]."""

_RADIUS = 2.5
"""Distance along the surface from which fragments have no weight [pitches]."""

# In a corner between two rows of fragments, a plane has weights of 2.5 in sum.
_MAX_WEIGHTS = 4.0
"""Largest sum of magnitudes of weights: how much a plane may amplify errors."""


class SurfaceReading(NamedTuple):
    """Temperatures at points as weighted means of those of fragments."""

    fragment: Int[np.ndarray, "p k"]
    """Index of each fragment, the nearest first."""
    weight: Float[np.ndarray, "p k"]
    """Weight of each fragment [-]; the sum is 1."""
    is_lost: Bool[np.ndarray, " p"]
    """True where no fragment nearby faces as the point does."""
    distance: Float[np.ndarray, " p"]
    """Distance to the nearest fragment, whichever way it faces [m]."""
    height: Float[np.ndarray, " p"]
    """Height above the plane of the nearest fragment [m]; negative inside."""

    def at(
        self, points: Bool[np.ndarray, " p"] | Int[np.ndarray, " q"]
    ) -> "SurfaceReading":
        """Return the reading of the points that a mask or indices select."""
        return SurfaceReading(*(column[points] for column in self))

    def read(
        self, temperature: Float[Array | np.ndarray, "t s"]
    ) -> Float[Array | np.ndarray, "t p"]:
        """Return the temperatures at the points [K]; at lost ones of no meaning."""
        on_host = isinstance(temperature, np.ndarray)
        mean = _weighted_mean if on_host else _jitted_mean
        return mean(temperature, self.fragment, self.weight.astype(temperature.dtype))


def _weighted_mean(temperature, fragment, weight):
    # Differences to the nearest: weights of a sum would lose digits in float32.
    first = temperature[:, fragment[:, 0]]
    excess = temperature[:, fragment] - first[:, :, None]
    return first + (excess * weight[None]).sum(axis=2)


# One program for all operations, which would each be compiled for each shape.
_jitted_mean = jax.jit(_weighted_mean)


def surface_reading(
    geometry: BodyGeometry,
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"] | None = None,
) -> SurfaceReading:
    """Find fragments and weights for points on a body's surface, in its own frame [m].

    Without `normals`, a point faces as the nearest fragment does, and is lost if it is
    not in the plane of that fragment.
    """
    position = geometry.fragment_position
    pitch = geometry.pitch
    distance, near = _tree(position).query(points, k=_CANDIDATES)
    # Where there are fewer fragments, the others are at infinity.
    near = np.minimum(near, len(position) - 1)
    directions = geometry.fragment_normal
    above = ((points - position[near[:, 0]]) * directions[near[:, 0]]).sum(axis=1)
    normal = directions[near[:, 0]] if normals is None else normals
    offset = (position[near] - points[:, None]) / pitch
    height = np.einsum("pki,pi->pk", offset, normal)
    across = np.sqrt(np.maximum((distance / pitch) ** 2 - height**2, 0))
    used = np.einsum("pki,pi->pk", directions[near], normal) > _SAME_SIDE
    used &= np.isfinite(distance)
    used &= np.abs(height) <= _MAX_HEIGHT + _MAX_RISE * across
    # Cells of one voxel at a plane hold at the same point: a plane needs it once.
    apart = np.abs(np.diff(offset, axis=1)).max(axis=2) > _APART
    alike = np.einsum("pki,pki->pk", directions[near[:, 1:]], directions[near[:, :-1]])
    used[:, 1:] &= apart | (alike < _SAME_SIDE)
    # The nearest used fragments first, then unused ones, which have no weight.
    order = np.argsort(~used, axis=1, kind="stable")[:, :_NEIGHBOURS]
    is_used = np.take_along_axis(used, order, axis=1)
    first = np.take_along_axis(distance, order, axis=1)[:, 0]
    is_lost = ~is_used[:, 0] | (first > _REACH * pitch)
    if normals is None:
        is_lost |= np.abs(above) > _MAX_HEIGHT * pitch
    offset = np.take_along_axis(offset, order[..., None], axis=1)
    along = offset @ np.stack(tangents(normal), axis=2)
    weight = _plane_weights(along, is_used)
    fragment = np.take_along_axis(near, order, axis=1)
    return SurfaceReading(
        fragment=fragment,
        weight=weight,
        is_lost=is_lost,
        distance=distance[:, 0],
        height=above,
    )


def _tree(position: Float[np.ndarray, "s 3"]) -> KDTree:
    """Search tree of the fragments of a body, built once for all of its solutions."""
    # With a copy: a finding must not keep what it belongs to.
    return found((position,), "tree", lambda: KDTree(position, copy_data=True))


def _plane_weights(
    along: Float[np.ndarray, "p k 2"], used: Bool[np.ndarray, "p k"]
) -> Float[np.ndarray, "p k"]:
    """Weights of the value at 0 of the plane nearest to the values at `along`."""
    # Nearly an interpolation: an average over neighbours would hide their scatter.
    square = (along**2).sum(axis=2)
    root_weight = np.maximum(1 - square / _RADIUS**2, 0) / (square + _CLOSE)
    root_weight = np.where(used, root_weight, 0)
    # Of a lost point nothing is read, but its weights must be finite.
    root_weight[:, 0] = np.maximum(root_weight[:, 0], 1e-9)
    mean = root_weight**2 / (root_weight**2).sum(axis=1, keepdims=True)
    centre = np.einsum("pk,pkj->pj", mean, along)
    lever = root_weight[:, :, None] * (along - centre[:, None])
    # By the pseudo-inverse: no slope across fragments that lie in a row.
    slope = np.linalg.pinv(lever, rcond=1e-3) * root_weight[:, None]
    weight = mean - np.einsum("pj,pjk->pk", centre, slope)
    # Nearly in a row they would be a lever: their mean instead.
    is_lever = np.abs(weight).sum(axis=1) > _MAX_WEIGHTS
    return np.where(is_lever[:, None], mean, weight)
