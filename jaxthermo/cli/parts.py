"""`jaxthermo parts`: the named parts of a mesh file and their sizes."""

import json
import sys
from pathlib import Path
from typing import TypedDict

import numpy as np

from ..config.types.quantities import LENGTH, to_si
from ..console.terminal import open_console, print_line
from ..errors import located
from ..geometry.files.read import read_contents, read_mesh
from ..geometry.load import file_scale
from ..geometry.mesh import Mesh
from ..geometry.parts import separate_parts
from ..report.numbers import count
from ..report.table import Table


class _PartSizes(TypedDict):
    """Sizes of one part, in metres or in units of the file."""

    name: str
    faces: int
    area: float
    volume: float | None
    """None for an open part, which has none."""
    size: list[float]
    """Extent along x, y and z."""
    closed: bool
    open_edges: int


class _FileSizes(TypedDict):
    """Sizes of all parts of a file."""

    file: str
    unit: str
    """Unit of the lengths: "m" or "file unit"."""
    parts: list[_PartSizes]


def parts(
    path: Path, unit: str | None, height: str | None, up: str, as_json: bool
) -> None:
    """Print the parts of a mesh file, as a table or as JSON.

    Raises:
        InputError: for a file that cannot be read, or options that do not fit.
    """
    target = None
    if height is not None:
        with located("--height"):
            target = to_si(height, LENGTH)
    file_path = path.expanduser()
    file_mesh = read_mesh(file_path, read_contents(file_path))
    metres: float | str | None = unit
    is_stated = False
    if unit is None and height is None:
        metres = file_mesh.metres_per_unit
        is_stated = metres is not None
    has_metres = metres is not None or target is not None
    scale = file_scale(
        file_path,
        unit=metres if has_metres else 1.0,
        height=target,
        up=up,
    )
    meshes = separate_parts(file_path, file_mesh, scale)
    sizes = _FileSizes(
        file=str(path),
        unit="m" if has_metres else "file unit",
        parts=[_sizes(mesh) for mesh in meshes.values()],
    )
    if as_json:
        sys.stdout.write(json.dumps(sizes, indent=2) + "\n")
        return
    _print(sizes, bounds=_bounds(list(meshes.values())), is_stated=is_stated)


def _sizes(mesh: Mesh) -> _PartSizes:
    # Sorts all edges, as does asking the mesh whether it is watertight.
    open_edges = mesh.open_edges
    is_closed = open_edges == 0
    return _PartSizes(
        name=mesh.name,
        faces=len(mesh.faces),
        area=mesh.area,
        volume=mesh.volume if is_closed else None,
        size=np.ptp(mesh.bounds, axis=0).tolist(),
        closed=is_closed,
        open_edges=open_edges,
    )


def _bounds(meshes: list[Mesh]) -> list[float]:
    """Extent of all meshes together."""
    corners = np.concatenate([mesh.bounds for mesh in meshes])
    return np.ptp(corners, axis=0).tolist()


def _print(sizes: _FileSizes, bounds: list[float], is_stated: bool) -> None:
    console = open_console()
    unit = sizes["unit"]
    rows = [
        (
            part["name"],
            f"{part['faces']:,}",
            f"{part['area']:.4g}",
            "" if part["volume"] is None else f"{part['volume']:.4g}",
            _product(part["size"]),
            "closed" if part["closed"] else f"open ({part['open_edges']:,} open edges)",
        )
        for part in sizes["parts"]
    ]
    columns = (
        "node/mesh/material",
        "faces",
        f"area\n{unit}^2",
        f"volume\n{unit}^3",
        f"size\n{unit}",
        "surface",
    )
    table = Table(columns, rows, left=(0, 5), framed=False)
    console.print(table.rich())
    faces = sum(part["faces"] for part in sizes["parts"])
    line = f"{count(len(rows), 'part')}, {count(faces, 'face')}, "
    line += f"{_product(bounds)} {unit}"
    if is_stated:
        line += ", in the unit that the file states"
    elif unit != "m":
        line += "s: --unit says how long they are"
    print_line(console, line)


def _product(lengths: list[float]) -> str:
    return " x ".join(f"{length:.4g}" for length in lengths)
