"""Closed cavities: empty voxels that no path through voxel faces joins to the outside.

What comes from outside, such as air, sun and surroundings, acts on no surface in them.
An opening narrower than a voxel may be closed in the voxels.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Int32
from scipy import ndimage

from ..arrays import require_memory
from .lattice import Lattice


# Labels, and empty cells with and without a rim.
_BYTES_PER_CELL = 6

_SOLID, _OUTSIDE = -1, 0


@dataclass(frozen=True, eq=False)
class Cavities:
    """The closed cavities of a body, by number, in its own frame."""

    lattice: Lattice
    number: Int32[np.ndarray, "x y z"]
    """Number of the cavity of each voxel, from 1; 0 outside, -1 in the body."""

    @property
    def count(self) -> int:
        """Number of cavities."""
        return int(self.number.max())

    def at(self, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """Number of the cavity around each point [m]; 0 outside, -1 in the body."""
        return self._of_cells(np.floor(self.lattice.to_cells(points)).astype(int))

    def _of_cells(self, cells: Int[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        within = ((cells >= 0) & (cells < self.lattice.shape)).all(1)
        found = np.full(len(cells), _OUTSIDE)
        found[within] = self.number[tuple(cells[within].T)]
        return found

    def faced(
        self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> Int[np.ndarray, " n"]:
        """Number of the cavity that pieces of the body's surface face; 0 for none.

        Points [m] on the surface, with normals out of the body.
        """
        rows, axis = np.arange(len(points)), np.abs(normals).argmax(1)
        ahead = np.where(normals[rows, axis] > 0, 1, -1)
        at = self.lattice.to_cells(points)
        # The first voxel centre in front of the surface.
        at[rows, axis] += 0.5 * ahead
        cells = np.floor(at).astype(int)
        found = self._of_cells(cells)
        # In narrow corners that voxel may be solid: what is empty around it decides.
        corner = np.flatnonzero(found == _SOLID)
        offsets = np.indices((3, 3, 3)).reshape(3, -1).T - 1
        near = [self._of_cells(cells[corner] + offset) for offset in offsets]
        opens = np.any([each == _OUTSIDE for each in near], axis=0)
        highest = np.maximum(np.max(near, axis=0), _OUTSIDE)
        found[corner] = np.where(opens, _OUTSIDE, highest)
        return found


def find_cavities(
    solid: Bool[np.ndarray, "x y z"], lattice: Lattice
) -> Cavities | None:
    """The closed cavities between solid voxels; None if there are none."""
    cells = int(np.prod([n + 2 for n in solid.shape]))
    remedy = "use a coarser pitch, or `inside: open` if all terms act in cavities, too"
    require_memory(_BYTES_PER_CELL * cells, "finding closed cavities", remedy)
    # A rim of empty voxels joins all that is outside.
    label = np.zeros([n + 2 for n in solid.shape], np.int32)
    ndimage.label(np.pad(~solid, 1, constant_values=True), output=label)
    if label.max() < 2:
        return None
    outside = label[0, 0, 0]
    # In place and plane by plane: copies would be the largest arrays of a run.
    number = label[1:-1, 1:-1, 1:-1]
    for plane, body in zip(number, solid, strict=True):
        outer = plane == outside
        plane -= plane > outside
        plane[outer] = _OUTSIDE
        plane[body] = _SOLID
    return Cavities(lattice, number)
