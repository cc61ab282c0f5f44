"""Pictures of bodies in contact and of the texels where they touch (5.3)."""

from collections.abc import Sequence

import numpy as np

from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.report.sheet import Legend, Tile, enlarged, sheet
from jaxthermo.voxels.textures import depth_colours, packed_images

from .contact_area import (
    FIXED,
    SHOWN,
    Touching,
    ball_on_plate,
    cap_area,
    rendered,
    touching_texels,
    two_cylinders,
)
from .exhibit import Picture
from .shaded import BODIES, box_corners, camera_on, in_world, shaded, with_box


_EDGE = 300
# With x to the left, as textures of z have it.
_DIRECTION = (0.3, -0.8, -0.5)
_SURFACE, _CONTACT, _NOTHING = (150, 184, 208), (226, 120, 40), (16, 17, 20)
_LEGEND = Legend(
    (("in contact", _CONTACT), ("surface", _SURFACE), ("no surface", _NOTHING))
)


def cylinder_textures() -> Picture:
    """The steps of the figure, from the bodies to the texture of A."""
    touching = two_cylinders(SHOWN)
    a, b = touching
    # One grey scale for both, from the bottom of A to the top of B.
    grid, tall = a.grid, a.grid.lattice.shape[2]
    grey = lambda depth: depth_colours(1 - np.clip(depth / (2 * tall), 0, 1))
    height = grid.lattice.to_cells(grid.fragment_position)[:, 2]
    own = packed_images(grid, 2, grey(height))[-1]
    layers = rendered(a, b, 2)
    of_b = layers.image(0, grey(layers.depth), np.array(_NOTHING, np.uint8))
    texels = touching_texels(a, b, a.pitch)
    own = enlarged(own, _EDGE)
    tiles = [
        Tile(_bodies(touching, len(own)), "A, with B on top", "and the box of A"),
        # Of the two layers of A along z the last one is the face that B stands on.
        Tile(own, "voxelized texture of A", "depth, last z layer"),
        Tile(enlarged(of_b[::-1, ::-1], _EDGE), "B in the box of A", "depth, first"),
        _texture_tile(a, texels, "texture T_A"),
    ]
    title = f"Two cylinders in contact, {SHOWN} voxels across"
    caption = (
        "From left to right as in the text: B is rendered into the box of A along z, "
        "its depths are compared with those in the voxelized texture of A, and T_A has "
        "the texels where they are the same within a voxel. Depth is grey: the higher, "
        "the brighter, on one scale."
    )
    return Picture("figure-5.4", sheet(tiles, _LEGEND, title, 4), caption)


def _bodies(touching: Touching, size: int) -> np.ndarray:
    a, _ = touching
    meshes = [in_world(body) for body in touching]
    corners = box_corners(a.world_bounds)
    points = np.concatenate([corners, *(mesh.vertices for mesh in meshes)])
    camera = camera_on(points, _DIRECTION, size)
    bodies, _ = shaded([*zip(meshes, BODIES, strict=True)], camera)
    return with_box(bodies, camera, a.world_bounds)


def _texture_tile(body: PlacedGrid, texels: np.ndarray, name: str) -> Tile:
    colours = np.array([_SURFACE, _CONTACT], np.uint8)[texels.astype(int)]
    layer = packed_images(body.grid, 2, colours)[-1]
    return Tile(enlarged(layer, _EDGE), name, f"{np.count_nonzero(texels)} in contact")


def plate_textures(resolutions: Sequence[int]) -> Picture:
    """The texture of a plate under a ball, at several resolutions."""
    tiles = []
    for voxels in resolutions:
        ball, plate = ball_on_plate(voxels, FIXED)
        texels = touching_texels(plate, ball, FIXED)
        tiles.append(_texture_tile(plate, texels, f"{voxels} voxels across the ball"))
    title = "Texture of a plate under a ball, within 1/16 of its radius"
    radius = float(np.sqrt(cap_area(FIXED) / np.pi))
    caption = (
        f"The plate from above. The exact contact is a disc of {radius:.3f} radii."
    )
    return Picture("figure-5.4-plate", sheet(tiles, _LEGEND, title), caption)
