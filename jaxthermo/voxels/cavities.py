"""Closed cavities: empty voxels that no path through voxel faces joins to the outside.

What comes from outside, such as air, sun and surroundings, acts on no surface in them.
An opening narrower than a voxel may be closed in the voxels.
"""

import abc
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float, Int, Int32
from typing_extensions import override

from ..host_memory import require_memory
from .lattice import Lattice


# Labels, and truth values of the empty cells with and without a rim.
_BYTES_PER_CELL = np.dtype(np.int32).itemsize + 2 * np.dtype(bool).itemsize

_SOLID = -1
_OUTSIDE = 0


class AbstractCavities(abc.ABC):
    """Parts of space that a body encloses, in its own frame, numbered from 1."""

    @property
    @abc.abstractmethod
    def count(self) -> int:
        """Number of cavities."""

    @abc.abstractmethod
    def at(self, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """Number of the cavity around each point [m]; 0 outside, -1 in the body."""


@dataclass(frozen=True, eq=False)
class Cavities(AbstractCavities):
    """The closed cavities of a body, in its own frame, as runs of voxels along z.

    An array with a number for each voxel would be the largest one of a body.
    """

    lattice: Lattice
    solid: Bool[np.ndarray, "x y z"]
    """Voxels of the body."""
    start: Int[np.ndarray, " r"]
    """First voxel of each run, as an index into the flat lattice, ascending."""
    stop: Int[np.ndarray, " r"]
    """Voxel after the last of each run."""
    number: Int32[np.ndarray, " r"]
    """Number of the cavity of each run, from 1."""

    @property
    @override
    def count(self) -> int:
        return int(self.number.max())

    @override
    def at(self, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        return self._of_cells(np.floor(self.lattice.to_cells(points)).astype(int))

    def _of_cells(self, cells: Int[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        within = ((cells >= 0) & (cells < self.lattice.shape)).all(1)
        inside = tuple(cells[within].T)
        flat_index = np.ravel_multi_index(inside, self.lattice.shape)
        # The last run that starts at or before the cell; the first one if none does.
        run = np.searchsorted(self.start, flat_index, side="right").clip(min=1) - 1
        is_closed = (self.start[run] <= flat_index) & (flat_index < self.stop[run])
        open_label = np.where(self.solid[inside], _SOLID, _OUTSIDE)
        number = np.full(len(cells), _OUTSIDE)
        number[within] = np.where(is_closed, self.number[run], open_label)
        return number

    def faced(
        self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> Int[np.ndarray, " n"]:
        """Number of the cavity that pieces of the body's surface face; 0 for none.

        Points [m] on the surface, with normals out of the body.
        """
        rows = np.arange(len(points))
        axis = np.abs(normals).argmax(1)
        ahead = np.where(normals[rows, axis] > 0, 1, -1)
        position = self.lattice.to_cells(points)
        # The first voxel centre in front of the surface.
        position[rows, axis] += 0.5 * ahead
        cells = np.floor(position).astype(int)
        number = self._of_cells(cells)
        # In narrow corners that voxel may be solid: what is empty around it decides.
        corner = np.flatnonzero(number == _SOLID)
        offsets = np.indices((3, 3, 3)).reshape(3, -1).T - 1
        near = [self._of_cells(cells[corner] + offset) for offset in offsets]
        opens = (np.asarray(near) == _OUTSIDE).any(axis=0)
        highest = np.maximum(np.max(near, axis=0), _OUTSIDE)
        number[corner] = np.where(opens, _OUTSIDE, highest)
        return number


def find_cavities(
    solid: Bool[np.ndarray, "x y z"], lattice: Lattice
) -> Cavities | None:
    """The closed cavities between solid voxels; None if there are none."""
    cells = int(np.prod([n + 2 for n in solid.shape]))
    remedy = "use a coarser pitch, or `inside: open` if all terms act in cavities, too"
    require_memory(_BYTES_PER_CELL * cells, "finding closed cavities", remedy)
    # A rim of empty voxels joins all that is outside.
    label = np.zeros([n + 2 for n in solid.shape], np.int32)
    scipy.ndimage.label(np.pad(~solid, 1, constant_values=True), output=label)
    if label.max() < 2:
        return None
    # Plane by plane: copies would be the largest arrays of a run.
    plane_size = solid[0].size
    runs = [
        _runs_in_plane(plane, outside=int(label[0, 0, 0]), first=x * plane_size)
        for x, plane in enumerate(label[1:-1, 1:-1, 1:-1])
    ]
    return Cavities(
        lattice=lattice,
        solid=solid,
        start=np.concatenate([run.start for run in runs]),
        stop=np.concatenate([run.stop for run in runs]),
        number=np.concatenate([run.number for run in runs]),
    )


class _Runs(NamedTuple):
    """Runs of cavity voxels along z in one plane."""

    start: Int[np.ndarray, " r"]
    stop: Int[np.ndarray, " r"]
    number: Int32[np.ndarray, " r"]


def _runs_in_plane(label: Int32[np.ndarray, "y z"], outside: int, first: int) -> _Runs:
    """Runs of cavities in a plane of labels.

    Labels count from 1, with 0 in the body; the plane begins at the voxel `first`.
    """
    number = np.pad((label - (label > outside)).ravel(), 1)
    number[1:-1][(label == outside).ravel()] = 0
    change = np.flatnonzero(number[1:] != number[:-1])
    opens = change[number[change + 1] > 0]
    closes = change[number[change] > 0]
    return _Runs(start=first + opens, stop=first + closes, number=number[opens + 1])
