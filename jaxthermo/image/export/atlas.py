"""Temperature texture of a body: an atlas in which every triangle has its own texels.

Two triangles share a square of n + 3 texels, corners at the centres of texels: linear
interpolation within one triangle never reads a texel of another. n is the longest edge
over the texel's length, rounded up.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from ...errors import InputError
from ...scene.scene import BodyGeometry
from ..facets import corner_normals
from ..view import smooth_weights


# Longest side of a texture that all graphics cards take [texels].
_LARGEST = 8192


class Atlas(NamedTuple):
    """Texture coordinates of a body's triangles and the weights of the texels."""

    vertices: Float[np.ndarray, "v 3"]
    """In the frame of the body [m]."""
    normals: Float[np.ndarray, "v 3"]
    """At the corners of all triangles, by `normal_faces`."""
    faces: Int[np.ndarray, "f 3"]
    normal_faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "f 3 2"]
    """Texture coordinates of the corners, from the lower left of the texture."""
    size: tuple[int, int]
    """Width and height [texels]."""
    texel: Int[np.ndarray, " t"]
    """Texels that a triangle has, rows first from the top."""
    weights: csr_array
    """Weights [t, s] of the body's fragments."""

    def texture(self, fragments: Float[np.ndarray, " s"]) -> Float[np.ndarray, "h w"]:
        """Values of all texels; those of no triangle have the mean of the others."""
        width, height = self.size
        values = np.asarray(self.weights @ fragments, np.float32)
        image = np.full(width * height, values.mean(), np.float32)
        image[self.texel] = values
        return image.reshape(height, width)


class _Cells(NamedTuple):
    """Place of every triangle in the atlas."""

    edge: Int[np.ndarray, " f"]
    """Texels along a leg, n."""
    corner: Int[np.ndarray, "f 2"]
    """Column and row of the texel of the first corner."""
    step: Int[np.ndarray, " f"]
    """1, or -1 for the triangle that begins in the opposite corner of the square."""
    size: tuple[int, int]


def build_atlas(geometry: BodyGeometry, texel: float | None = None) -> Atlas:
    """Atlas of a body.

    Args:
        geometry: of the body.
        texel: length of a texel [m]; the voxels' edge if None. Where the atlas would be
            larger than 8192 texels they are longer.

    Raises:
        InputError: for more triangles than such a texture has room for.
    """
    vertices, faces = geometry.vertices, geometry.faces
    triangles = vertices[faces]
    longest = np.linalg.norm(np.roll(triangles, -1, 1) - triangles, axis=-1).max(axis=1)
    length = texel or geometry.pitch
    while (cells := _packed(np.ceil(longest / length).astype(int))) is None:
        if length > longest.max():
            raise InputError(
                f"a texture has no room for {len(faces)} triangles: export vertices "
                "with --format glb, or simplify the mesh"
            )
        length *= 1.25
    _, normals, normal_faces = corner_normals(vertices, faces)
    owner, pixel, share = _texels(cells)
    mixed = lambda corners: np.einsum("tc,tci->ti", share, corners[owner])
    ahead = mixed(normals[normal_faces])
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)
    weights = smooth_weights(mixed(triangles), ahead, geometry)
    uv = _coordinates(cells)
    return Atlas(
        vertices=vertices,
        normals=normals,
        faces=faces,
        normal_faces=normal_faces,
        uv=uv,
        size=cells.size,
        texel=pixel,
        weights=weights,
    )


def _packed(edge: Int[np.ndarray, " f"]) -> _Cells | None:
    """Squares in rows, largest first; None if they do not fit."""
    edge = np.maximum(edge, 1)
    order = np.argsort(-edge, kind="stable")
    # The first of a pair is the larger one.
    side = edge[order][::2] + 3
    area = int((side.astype(np.int64) ** 2).sum())
    width = 2 ** max(2, math.ceil(math.log2(max(math.sqrt(area), side[0]))))
    if width > _LARGEST:
        return None
    left, top, low, place = 0, 0, 0, np.empty((len(side), 2), np.int64)
    for number, each in enumerate(side.tolist()):
        if left + each > width:
            left, top = 0, top + low
        low = each if left == 0 else low
        place[number] = left, top
        left += each
    height = 2 ** math.ceil(math.log2(top + low))
    if height > _LARGEST:
        return None
    corner, step = np.empty((len(edge), 2), np.int64), np.ones(len(edge), np.int64)
    corner[order[::2]] = place
    other = order[1::2]
    corner[other] = place[: len(other)] + side[: len(other), None] - 1
    step[other] = -1
    return _Cells(edge=edge, corner=corner, step=step, size=(width, height))


def _texels(
    cells: _Cells,
) -> tuple[Int[np.ndarray, " t"], Int[np.ndarray, " t"], Float[np.ndarray, "t 3"]]:
    """Triangle, pixel, and barycentric coordinates of each texel of the atlas."""
    owners, pixels, shares = [], [], []
    for edge in np.unique(cells.edge).tolist():
        own = np.flatnonzero(cells.edge == edge)
        row, column = np.indices((edge + 1, edge + 1)).reshape(2, -1)
        # One more line than the triangle has, which interpolation also reads.
        used = row + column <= edge + 1
        row, column = row[used], column[used]
        away = cells.step[own, None]
        x = cells.corner[own, 0, None] + away * column
        y = cells.corner[own, 1, None] + away * row
        share = np.stack([edge - row - column, column, row], axis=1) / edge
        owners.append(np.repeat(own, len(row)))
        pixels.append((y * cells.size[0] + x).ravel())
        shares.append(np.tile(share, (len(own), 1)))
    return np.concatenate(owners), np.concatenate(pixels), np.concatenate(shares)


def _coordinates(cells: _Cells) -> Float[np.ndarray, "f 3 2"]:
    along = (cells.step * cells.edge)[:, None] * np.array([[1, 0]])
    down = (cells.step * cells.edge)[:, None] * np.array([[0, 1]])
    first = cells.corner
    centre = np.stack([first, first + along, first + down], axis=1) + 0.5
    scaled = centre / np.array(cells.size)
    return np.stack([scaled[..., 0], 1 - scaled[..., 1]], axis=-1)
