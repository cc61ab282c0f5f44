"""Temperature textures of a body for simulators: OBJ and GLB with coordinates, images.

The OBJ serves all images of its body: 16-bit PNG in 0.01 K and EXR in kelvin for
emitters of a renderer, and 8-bit PNG between two temperatures, as the `heat_signature`
of Gazebo's thermal camera with its `min_temp` and `max_temp`.
"""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from PIL import Image

from ...atomic import replacing
from ...geometry.mesh import Pose
from ...scene.scene import BodyGeometry
from ..files import write_channels
from ..palette import apply_palette
from ..raster_files import centikelvin
from .atlas import Atlas, build_atlas
from .gltf import GltfMesh, write_meshes
from .grey import grey_levels, write_grey


class BodyTextures(NamedTuple):
    """A body with its name, and the ends of its grey and colour scales [K]."""

    name: str
    geometry: BodyGeometry
    low: float
    high: float


def write_textures(
    folder: Path,
    body: BodyTextures,
    frames: Sequence[tuple[str, Float[np.ndarray, " s"]]],
    palette: str,
) -> dict[str, Any]:
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
    atlas = build_atlas(body.geometry)
    mesh = f"{body.name}.obj"
    _write_obj(folder / mesh, atlas)
    pages = []
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


def _write_obj(path: Path, atlas: Atlas) -> None:
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
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_glb(
    path: Path,
    atlas: Atlas,
    body: BodyTextures,
    image: Float[np.ndarray, "h w"],
    palette: str,
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
