"""Temperature textures of a body for simulators: OBJ and GLB with coordinates, images.

The OBJ serves all images of its body: 16-bit PNG in 0.01 K and EXR in kelvin for
emitters of a renderer, and 8-bit PNG between two temperatures, as the `heat_signature`
of Gazebo's thermal camera with its `min_temp` and `max_temp`.
"""

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, NotRequired, TypedDict

import numpy as np
from jaxtyping import Float, Int
from PIL import Image
from scipy.sparse import csr_array

from ...atomic import write_text
from ...choices import Palette
from ...errors import InputError
from ...geometry.mesh import Pose
from ...geometry.vectors import unit_vectors
from ...scene.scene import BodyGeometry
from ..colour.palette import apply_palette
from ..surface.facets import corner_normals
from ..surface.shapes import ShapePoints, Shapes
from ..surface.weights import smooth_weights
from .exr import write_channels
from .gltf import GltfMesh, write_meshes
from .raster_files import centikelvin, grey_levels, write_grey


# Longest side of a texture that all graphics cards take [texels].
_LARGEST = 8192


class _Atlas(NamedTuple):
    """Texture coordinates of a body's triangles and the weights of the texels.

    Every triangle has its own texels: two triangles share a square of n + 3 texels,
    with corners at the centres of texels, so that linear interpolation within one
    triangle never reads a texel of another. n is the longest edge over the length of a
    texel, rounded up.
    """

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
    """Index of each texel that a triangle has, rows first from the top."""
    weights: csr_array
    """Weights [t, s] of the body's fragments."""

    def texture(self, fragments: Float[np.ndarray, " s"]) -> Float[np.ndarray, "h w"]:
        """Values of all texels; texels without a triangle have the mean value."""
        width, height = self.size
        values = np.asarray(self.weights @ fragments, np.float32)
        image = np.full(width * height, values.mean(), np.float32)
        image[self.texel] = values
        return image.reshape(height, width)


class _Cells(NamedTuple):
    """Position of every triangle in the atlas."""

    edge: Int[np.ndarray, " f"]
    """Texels along a leg, n."""
    corner: Int[np.ndarray, "f 2"]
    """Column and row of the texel of the first corner."""
    step: Int[np.ndarray, " f"]
    """1, or -1 for the triangle that begins in the opposite corner of the square."""
    size: tuple[int, int]


def _build_atlas(geometry: BodyGeometry) -> _Atlas:
    """Make the atlas of a body, whose texels are as long as the edges of its voxels.

    Where the atlas would be larger than 8192 texels they are longer.

    Raises:
        InputError: for more triangles than such a texture has room for.
    """
    vertices = geometry.vertices
    faces = geometry.surface_faces
    triangles = vertices[faces]
    longest = np.linalg.norm(np.roll(triangles, -1, 1) - triangles, axis=-1).max(axis=1)
    length = geometry.pitch
    while (cells := _packed(np.ceil(longest / length).astype(int))) is None:
        if length > longest.max():
            raise InputError(
                f"a texture has no room for {len(faces)} triangles: export vertices "
                "with --format glb, or simplify the mesh"
            )
        length *= 1.25
    creased = corner_normals(vertices, faces)
    owner, pixel, share = _texels(cells)

    def mixed(corners: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, "t 3"]:
        return np.einsum("tc,tci->ti", share, corners[owner])

    ahead = unit_vectors(mixed(creased.normals[creased.faces]))
    texels = ShapePoints.of_one(mixed(triangles), ahead)
    weights = smooth_weights(texels, Shapes.of((geometry,)))
    uv = _coordinates(cells)
    return _Atlas(
        vertices=vertices,
        normals=creased.normals,
        faces=faces,
        normal_faces=creased.faces,
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
    left = 0
    top = 0
    low = 0
    origin = np.empty((len(side), 2), np.int64)
    for number, extent in enumerate(side.tolist()):
        if left + extent > width:
            left = 0
            top = top + low
        low = extent if left == 0 else low
        origin[number] = left, top
        left += extent
    height = 2 ** math.ceil(math.log2(top + low))
    if height > _LARGEST:
        return None
    corner = np.empty((len(edge), 2), np.int64)
    step = np.ones(len(edge), np.int64)
    corner[order[::2]] = origin
    second = order[1::2]
    corner[second] = origin[: len(second)] + side[: len(second), None] - 1
    step[second] = -1
    return _Cells(edge=edge, corner=corner, step=step, size=(width, height))


class _Texels(NamedTuple):
    """Texels of an atlas that a triangle has."""

    owner: Int[np.ndarray, " t"]
    """Number of the triangle."""
    pixel: Int[np.ndarray, " t"]
    """Index in the texture, rows first from the top."""
    share: Float[np.ndarray, "t 3"]
    """Barycentric coordinates in the triangle."""


def _texels(cells: _Cells) -> _Texels:
    owners = []
    pixels = []
    shares = []
    for edge in np.unique(cells.edge).tolist():
        triangles = np.flatnonzero(cells.edge == edge)
        row, column = np.indices((edge + 1, edge + 1)).reshape(2, -1)
        # One more line than the triangle has, which interpolation also reads.
        used = row + column <= edge + 1
        row = row[used]
        column = column[used]
        away = cells.step[triangles, None]
        x = cells.corner[triangles, 0, None] + away * column
        y = cells.corner[triangles, 1, None] + away * row
        share = np.stack([edge - row - column, column, row], axis=1) / edge
        owners.append(np.repeat(triangles, len(row)))
        pixels.append((y * cells.size[0] + x).ravel())
        shares.append(np.tile(share, (len(triangles), 1)))
    return _Texels(
        owner=np.concatenate(owners),
        pixel=np.concatenate(pixels),
        share=np.concatenate(shares),
    )


def _coordinates(cells: _Cells) -> Float[np.ndarray, "f 3 2"]:
    along = (cells.step * cells.edge)[:, None] * np.array([[1, 0]])
    down = (cells.step * cells.edge)[:, None] * np.array([[0, 1]])
    first = cells.corner
    centre = np.stack([first, first + along, first + down], axis=1) + 0.5
    scaled = centre / np.array(cells.size)
    return np.stack([scaled[..., 0], 1 - scaled[..., 1]], axis=-1)


class BodyTextures(NamedTuple):
    """A body with its name, and the ends of its grey and colour scales [K]."""

    name: str
    geometry: BodyGeometry
    low: float
    high: float


class _FrameFiles(TypedDict):
    """Names of the files of one frame, and what the caller notes of it."""

    files: list[str]
    time_s: NotRequired[float]
    pose: NotRequired[dict[str, list[Any]]]


class _BodyFiles(TypedDict):
    """Names of the files of a body, and the size of its images [texels]."""

    name: str
    files: list[str]
    width: int
    height: int
    textures: list[_FrameFiles]


def write_textures(
    folder: Path,
    body: BodyTextures,
    frames: Sequence[tuple[str, Float[np.ndarray, " s"]]],
    palette: Palette,
) -> _BodyFiles:
    """Write the OBJ of a body, and the images of each of its frames.

    Args:
        folder: that is there.
        body: with the scale of all its images.
        frames: name and temperatures of the fragments [K].
        palette: of the GLB files.

    Returns:
        Names of all files, and the size of the images.

    Raises:
        InputError: if a file cannot be written, or has no room for the triangles.
    """
    atlas = _build_atlas(body.geometry)
    mesh = f"{body.name}.obj"
    _write_obj(folder / mesh, atlas)
    pages: list[_FrameFiles] = []
    for stem, kelvin in frames:
        name = f"{body.name}_{stem}"
        names = [f"{name}.png", f"{name}.exr", f"{name}_heat.png", f"{name}.glb"]
        image = atlas.texture(kelvin)
        write_grey(folder / names[0], centikelvin(image))
        # Renderers read Y as a texture of one channel.
        write_channels(folder / names[1], {"Y": image}, {"units": "Y: K"})
        write_grey(folder / names[2], grey_levels(image, body.low, body.high))
        _write_glb(
            folder / names[3], atlas=atlas, body=body, image=image, palette=palette
        )
        pages.append({"files": names})
    return {
        "name": body.name,
        "files": [mesh],
        "width": atlas.size[0],
        "height": atlas.size[1],
        "textures": pages,
    }


def _write_obj(path: Path, atlas: _Atlas) -> None:
    """Mesh in the frame of its body [m], with texture coordinates of every corner."""
    corner = np.arange(atlas.faces.size).reshape(-1, 3)
    lines = ["# jaxthermo: metres, z up"]
    for key, rows in (("v", atlas.vertices), ("vn", atlas.normals)):
        lines += [f"{key} {x:.9g} {y:.9g} {z:.9g}" for x, y, z in rows.tolist()]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in atlas.uv.reshape(-1, 2).tolist()]
    indices = np.stack([atlas.faces, corner, atlas.normal_faces], axis=-1) + 1
    lines += [
        "f " + " ".join("/".join(map(str, corner)) for corner in face)
        for face in indices.tolist()
    ]
    write_text(path, "\n".join(lines) + "\n")


def _write_glb(
    path: Path,
    atlas: _Atlas,
    body: BodyTextures,
    image: Float[np.ndarray, "h w"],
    palette: Palette,
) -> None:
    colours = apply_palette(image, low=body.low, high=body.high, name=palette)
    png = io.BytesIO()
    Image.fromarray(colours).save(png, format="PNG")
    # Coordinates of glTF begin at the upper left.
    uv = atlas.uv.reshape(-1, 2) * [1, -1] + [0, 1]
    attributes = {
        "POSITION": atlas.vertices[atlas.faces].reshape(-1, 3),
        "NORMAL": atlas.normals[atlas.normal_faces].reshape(-1, 3),
        "TEXCOORD_0": uv,
    }
    faces = np.arange(atlas.faces.size).reshape(-1, 3)
    mesh = GltfMesh(
        name=body.name,
        pose=Pose(),
        faces=faces,
        attributes=attributes,
        texture=png.getvalue(),
    )
    notes = {"palette": palette, "low_K": body.low, "high_K": body.high}
    write_meshes(path, [mesh], notes)
