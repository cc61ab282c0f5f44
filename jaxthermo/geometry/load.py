"""Mesh files to metres and z up, with one line for every error a user can make."""

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..choices import UpAxis
from ..errors import InputError, positive_length
from ..memo.stored import stored
from .files.file_mesh import FileMesh
from .files.read import read_contents, read_mesh
from .mesh import Mesh
from .repair import MAX_HOLE_EDGES, repair_mesh


def load_mesh(
    path: str | os.PathLike[str],
    *,
    unit: str | float | int | None = None,
    height: float | int | None = None,
    up: UpAxis = "z",
    repair: bool = True,
    max_hole_edges: int = MAX_HOLE_EDGES,
) -> Mesh:
    """Read a mesh file as one mesh in metres, z up.

    OBJ, PLY, STL, GLB, glTF and OFF are read; 3MF, DAE, and Draco in a GLB, with the
    packages of the extra `formats`. Scenes are merged with their transforms. A GLB is
    by its standard in metres with y up: give `unit="m", up="y"`. An OBJ cut off at the
    end of a line looks complete: check `Mesh.open_edges`.

    Args:
        path: The file; its suffix decides the format.
        unit: Length of one file unit, as a name ("mm") or in metres.
        height: Instead of `unit`: the extent along the up axis [m].
        up: The file's axis that points up: x, y, z, -x, -y or -z.
        repair: Repair what can be repaired (see `repair_mesh`).
        max_hole_edges: Holes with more edges than this stay open [-].

    Raises:
        InputError: naming the file, the mistake and a remedy.
    """
    path = Path(path).expanduser()
    scale = file_scale(path, unit=unit, height=height, up=up)
    contents = read_contents(path)

    def build() -> Mesh:
        file_mesh = read_mesh(path, contents)
        placed = placed_mesh(path, file_mesh, scale)
        mesh = Mesh(placed.vertices, placed.faces, name=path.stem, axes=scale.axes)
        return repair_mesh(mesh, max_hole_edges=max_hole_edges) if repair else mesh

    return stored(
        "mesh",
        inputs=(
            contents.data,
            dict(contents.files),
            path.name,
            scale,
            repair,
            max_hole_edges,
        ),
        compute=build,
        types=(Mesh,),
    )


class FileScale(NamedTuple):
    """Scale and axes by which the numbers of a file become metres with z up."""

    unit: float | None
    """Length of one file unit [m]."""
    height: float | None
    """Extent of the whole mesh along z, if there is no unit [m]."""
    axes: tuple[str, str, str]
    """Names of our axes in the file."""


def file_scale(
    path: Path,
    unit: str | float | int | None,
    height: float | int | None,
    up: str,
) -> FileScale:
    """Check the arguments of `load_mesh` about the scale of a file.

    Raises:
        InputError: naming the argument and its value.
    """
    if (unit is None) == (height is None):
        raise InputError(
            f"{path}: give either unit= (such as 'mm') or height= in metres, "
            f"{'neither was given' if unit is None else 'not both'}"
        )
    return FileScale(
        unit=None if unit is None else _metres_per_unit(unit),
        height=None if height is None else positive_length("height", height),
        axes=_axes_for_up(up),
    )


def placed_mesh(path: Path, mesh: FileMesh, scale: FileScale) -> FileMesh:
    """The mesh of a file, in metres and z up.

    Raises:
        InputError: for a flat mesh that the height would scale.
    """
    vertices = mesh.vertices @ _axes_rotation(scale.axes).T
    metres = scale.unit
    if metres is None:
        assert scale.height is not None
        extent = float(np.ptp(vertices[mesh.faces][..., 2]))
        if extent == 0.0:
            raise InputError(
                f"{path}: is flat along up={scale.axes[2]!r}, so height= cannot scale "
                "it: give unit="
            )
        metres = scale.height / extent
    return mesh._replace(vertices=vertices * metres)


_METRES = {
    "nm": 1e-9, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "cm": 1e-2,
    "dm": 1e-1, "m": 1.0, "km": 1e3, "mil": 2.54e-5, "in": 0.0254, "inch": 0.0254,
    "ft": 0.3048, "foot": 0.3048, "yd": 0.9144,
    "micrometre": 1e-6, "millimetre": 1e-3, "centimetre": 1e-2, "metre": 1.0,
    "micrometer": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "meter": 1.0,
}  # fmt: skip

# Each is a proper rotation, so that winding and volume keep their sign.
_AXES = {
    "x": ("y", "z", "x"),
    "y": ("x", "-z", "y"),
    "z": ("x", "y", "z"),
    "-x": ("z", "y", "-x"),
    "-y": ("x", "z", "-y"),
    "-z": ("x", "-y", "-z"),
}


def _metres_per_unit(unit: str | float | int) -> float:
    if isinstance(unit, str):
        metres = _METRES.get(unit.strip().lower())
        if metres is None:
            raise InputError(
                f"unit {unit!r} is not known: name one of m, mm, cm, um, in, ft, "
                "or give the metres per file unit as a number"
            )
        return metres
    return positive_length("unit", unit)


def _axes_for_up(up: str) -> tuple[str, str, str]:
    axes = _AXES.get(up.strip().lower().removeprefix("+"))
    if axes is None:
        raise InputError(f"up={up!r} is no axis: name one of {', '.join(_AXES)}")
    return axes


def _axes_rotation(axes: tuple[str, str, str]) -> Float[np.ndarray, "3 3"]:
    """Rotation from file axes to ours: `ours = matrix @ file`."""
    rows = np.zeros((3, 3))
    for row, axis in zip(rows, axes, strict=True):
        row["xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return rows
