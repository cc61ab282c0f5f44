"""Surface of a body whose parts overlap or touch, by rays finer than its voxels.

The mesh has the faces inside the body too, and its own rays meet the line where a face
disappears in another part by chance, half a voxel off. Finer rays tell what fraction of
the mesh lies outside; its area is that fraction of the area of the triangles.
"""

import numpy as np
from jaxtyping import Float

from ..geometry.mesh import Mesh
from .cell_areas import Patches, SampledSurface
from .lattice import Lattice, peel_axes
from .surface import hidden_inside, positions, selected


# Rays along each side of a voxel, as far as there are no more crossings than these.
_FINEST = 8
_MANY_CROSSINGS = 2_000_000


def sampled_surface(
    mesh: Mesh, lattice: Lattice, normals: Float[np.ndarray, "f 3"]
) -> SampledSurface:
    """Surface of a closed mesh by rays finer than those through the voxels' centres."""
    expected = np.abs(mesh.area_vectors).sum() / lattice.pitch**2
    rays = int(np.clip(np.sqrt(_MANY_CROSSINGS / max(expected, 1)), 1, _FINEST))
    nx, ny, nz = (n * rays for n in lattice.shape)
    fine = Lattice(
        shape=(nx, ny, nz), origin=lattice.origin, pitch=lattice.pitch / rays
    )
    outer = []
    hidden = []
    for axis, layers in enumerate(peel_axes(mesh, fine)):
        slope = np.abs(normals[:, axis])
        is_hidden = hidden_inside(layers, slope)
        for pieces, is_chosen in ((outer, ~is_hidden), (hidden, is_hidden)):
            crossings = selected(layers, is_chosen)
            pieces.append(
                Patches(
                    position=positions(crossings, axis)[None] / rays,
                    normal=normals[crossings.triangle],
                    area=slope[crossings.triangle] / rays**2,
                )
            )
    return SampledSurface(outer=_joined(outer), hidden=_joined(hidden))


def _joined(pieces: list[Patches]) -> Patches:
    return Patches(
        position=np.concatenate([patches.position for patches in pieces], axis=1),
        normal=np.concatenate([patches.normal for patches in pieces]),
        area=np.concatenate([patches.area for patches in pieces]),
    )
