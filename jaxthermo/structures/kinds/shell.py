"""Single shell: only the surface voxels, linked to all neighbours."""

import equinox as eqx
import numpy as np
from jaxtyping import Int

from ...errors import InputError
from ...voxels.grid import VoxelGrid
from ...voxels.surface import surface_links
from ..build.blocks import shell_voxels
from ..cache import cached
from ..structure import (
    AbstractBuiltStructure,
    Built,
    ConductionWeights,
    Links,
    Nodes,
    as_weights,
)


class SingleShell(AbstractBuiltStructure):
    """Surface voxels, linked over faces, edges and corners (thesis 4.2).

    Each of the up to 26 links has the area pitch^2, so a flat sheet conducts
    1 + sqrt(2) times as well along itself as its material; `weights` can correct that.

    Raises:
        InputError: if the capacity is neither "body" nor "own".
    """

    grid: VoxelGrid = eqx.field(static=True)
    capacity: str = eqx.field(static=True, default="body")
    """Volume of the nodes: "body" distributes that of the whole body evenly; "own" is
    one voxel each: a hollow body."""
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )
    built: Built = eqx.field(static=True, init=False)

    def __post_init__(self):
        if self.capacity not in ("body", "own"):
            raise InputError(
                f'SingleShell(capacity={self.capacity!r}): give "body" or "own"'
            )
        options = {"capacity": self.capacity}
        self.built = cached("single_shell", self.grid, options, _build)


def _build(grid: VoxelGrid, capacity: str) -> Built:
    voxels = shell_voxels(grid)
    count = len(voxels)
    volume = grid.voxel_volume
    if capacity == "body":
        volume *= grid.solid_count / max(count, 1)
    centre = grid.lattice.centres(voxels)
    node = np.full(grid.solid.shape, -1, np.int32)
    node[tuple(voxels.T)] = np.arange(count)
    level = np.zeros(count, np.int32)
    return Built(
        nodes=Nodes(centre, np.full(count, volume), level, centre),
        links=_links(grid, voxels),
        fragment_node=node[tuple(grid.fragment_voxel.T)],
        voxel_node=node[grid.solid],
    )


def fragment_rank(
    grid: VoxelGrid, voxels: Int[np.ndarray, "m 3"]
) -> Int[np.ndarray, " s"]:
    """Index of each fragment's voxel among the given voxels in lattice order."""
    shape = grid.solid.shape
    number = np.ravel_multi_index(tuple(voxels.T), shape)
    sought = np.ravel_multi_index(tuple(grid.fragment_voxel.T), shape)
    return np.asarray(np.searchsorted(number, sought), np.int32)


def _links(grid: VoxelGrid, voxels: Int[np.ndarray, "m 3"]) -> Links:
    """Links of touching voxels at 1, sqrt(2) or sqrt(3) times the pitch."""
    pairs = surface_links(voxels, grid.lattice.shape)
    # Stable, since the pairs are 13 sorted runs, one for each direction.
    src, dst = pairs[np.argsort(pairs[:, 0], kind="stable")].T
    steps = np.abs(voxels[dst] - voxels[src]).sum(1)
    half = 0.5 * grid.pitch * np.sqrt(np.arange(4))[steps]
    return Links(
        src=np.ascontiguousarray(src),
        dst=np.ascontiguousarray(dst),
        area=np.full(len(src), grid.pitch**2),
        distance_src=half,
        distance_dst=half,
    )
