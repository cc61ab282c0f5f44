"""True against represented: volume, area and the smallest section of a body.

The true ones are the mesh's. A section along an axis is that of a plane through voxel
centres; the smallest one is that of the narrowest neck, where the body is wider on both
sides, or else its widest: the ends of a ball are no section that heat passes.
"""

from typing import NamedTuple, TypedDict

import numpy as np
from jaxtyping import Float

from ..geometry.mesh import Mesh
from .cut_voxels import CutVoxels
from .lattice import Lattice


_MIN_NECK = 0.05
"""Least relative loss of section that is a neck."""

MAX_DIFFERENCE = 0.02
"""Relative difference [-] up to which areas and volumes are scaled to the true ones;
beyond it a user is warned."""


class _Pair(NamedTuple):
    """A quantity of the mesh and of its voxels."""

    true: float
    represented: float

    @property
    def error(self) -> float:
        """Relative difference [-]."""
        return self.represented / self.true - 1 if self.true else 0.0

    @property
    def percent(self) -> str:
        """Represented in percent of the true value."""
        return f"{100 * (1 + self.error):.2f} %"


class RepresentedReport(TypedDict):
    """True and represented values, with units in the keys."""

    volume_m3: dict[str, float]
    area_m2: dict[str, float]
    smallest_section_m2: dict[str, float]
    smallest_section_across: str
    """Axis of the mesh that the smallest section is normal to."""


class Represented(NamedTuple):
    """Quantities of a closed mesh and of its voxels."""

    volume: _Pair
    """[m^3]"""
    area: _Pair
    """[m^2]"""
    smallest_section: _Pair
    """[m^2]"""
    section_axis: int
    """Axis that the smallest section is normal to."""

    def described(self) -> str:
        """One line, in percent of the true values."""
        return (
            f"represents {self.volume.percent} of its volume, {self.area.percent} of "
            f"its area and {self.smallest_section.percent} of its smallest section "
            f"({self.smallest_section.true * 1e4:.3g} cm2 across "
            f"{'xyz'[self.section_axis]})"
        )

    @property
    def is_off(self) -> bool:
        """True if one of them is off by more than 2 %."""
        pairs = (self.volume, self.area, self.smallest_section)
        return any(abs(pair.error) > MAX_DIFFERENCE for pair in pairs)

    def as_dict(self) -> RepresentedReport:
        """Plain types, with units in the keys."""
        return RepresentedReport(
            volume_m3=self.volume._asdict(),
            area_m2=self.area._asdict(),
            smallest_section_m2=self.smallest_section._asdict(),
            smallest_section_across="xyz"[self.section_axis],
        )


def represented(
    mesh: Mesh, lattice: Lattice, solid: np.ndarray, cut: CutVoxels, area: float
) -> Represented:
    """Compare a closed mesh with its voxels, whose surface has an area [m^2]."""
    face = lattice.pitch**2
    cell = lattice.pitch**3
    volume = (np.count_nonzero(solid) + float((cut.volume - 1).sum())) * cell
    necks = []
    for axis in range(3):
        true = _mesh_sections(mesh, lattice, axis)
        k = _narrowest(true)
        section = cut.section[cut.voxel[:, axis] == k, axis]
        voxels = np.count_nonzero(solid.take(k, axis))
        section_voxels = voxels + float((section - 1).sum())
        pair = _Pair(true=float(true[k]), represented=section_voxels * face)
        necks.append((pair.true, axis, pair))
    _, axis, smallest = min(necks)
    return Represented(
        volume=_Pair(mesh.volume, volume),
        area=_Pair(mesh.area, area),
        smallest_section=smallest,
        section_axis=axis,
    )


def _mesh_sections(mesh: Mesh, lattice: Lattice, axis: int) -> Float[np.ndarray, " k"]:
    """Sections of a closed mesh by the planes of voxel centres across an axis [m^2]."""
    # Each triangle that a plane cuts is a piece of the section's outline; by Green's
    # theorem its area is half the sum of p x q along the pieces.
    axis_order = [axis, (axis + 1) % 3, (axis + 2) % 3]
    corners = lattice.to_cells(mesh.triangles)[..., axis_order]
    low = np.ceil(corners[..., 0].min(1) - 0.5)
    high = np.ceil(corners[..., 0].max(1) - 0.5)
    count = np.clip(high - low, 0, None).astype(int)
    owner = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    plane = low[owner].astype(int) + step
    triangle = corners[owner]
    above = triangle[..., 0] > (plane + 0.5)[:, None]
    # Turned so that the first corner is alone on its side of the plane.
    alone = np.where(above.sum(1) == 1, above.argmax(1), above.argmin(1))
    order = (alone[:, None] + np.arange(3)) % 3
    rows = np.arange(len(owner))
    triangle = triangle[rows[:, None], order]
    above = above[rows, alone]
    below_plane = (plane + 0.5)[:, None] - triangle[:, :1, 0]
    rise = triangle[:, 1:, 0] - triangle[:, :1, 0]
    fraction = (below_plane / np.where(rise == 0, 1, rise))[..., None]
    ends = triangle[:, :1, 1:] + fraction * (triangle[:, 1:, 1:] - triangle[:, :1, 1:])
    p = ends[:, 0]
    q = ends[:, 1]
    double = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    double = np.where(above, double, -double)
    shape = lattice.shape[axis]
    inside = (plane >= 0) & (plane < shape)
    area = np.bincount(plane[inside], double[inside] / 2, shape)
    return np.abs(area) * lattice.pitch**2


def _narrowest(section: Float[np.ndarray, " k"]) -> int:
    """Index of the narrowest neck, or of the widest section."""
    # Between parts there is no section: their ends are no necks.
    pieces = np.split(section, np.flatnonzero(np.diff(section > 0)) + 1)
    widest_before = np.concatenate([np.maximum.accumulate(p) for p in pieces])
    widest_after = np.concatenate(
        [np.maximum.accumulate(p[::-1])[::-1] for p in pieces]
    )
    neck = (section > 0) & (
        section < (1 - _MIN_NECK) * np.minimum(widest_before, widest_after)
    )
    if not neck.any():
        return int(section.argmax())
    return int(np.where(neck, section, np.inf).argmin())
