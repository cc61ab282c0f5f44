"""`jaxthermo parts`: the named parts of a mesh file, and the start of their scene."""

import json
import sys
from collections import Counter
from pathlib import Path
from typing import TypedDict

import numpy as np

from ..config.types.quantities import LENGTH, to_si
from ..console.terminal import open_console, print_line
from ..errors import InputError, located
from ..geometry.equal_parts import PlacedPart, placed_parts
from ..geometry.files.read import read_contents, read_mesh
from ..geometry.load import file_scale
from ..geometry.mesh import Mesh
from ..geometry.part_names import short_names
from ..geometry.parts import separate_parts
from ..geometry.wall_thickness import wall_thickness
from ..memo.once import once
from ..report.numbers import count
from ..report.table import Table
from .scene_start import ignoring_rule, scene_start


_Y_UP = (".glb", ".gltf")
"""Formats whose standard has y up, whatever some programs write."""

_Y_UP_LINE = "by its standard this format has y up: give --up y"


class _PartSizes(TypedDict):
    """Sizes of one part, in metres or in units of the file."""

    name: str
    instances: int
    """Number of parts of this geometry, with this one."""
    faces: int
    area: float
    volume: float | None
    """None for an open part, which has none."""
    size: list[float]
    """Extent along x, y and z."""
    closed: bool
    open_edges: int
    extent: bool
    """False for a part whose faces have no area: no body can be made of it."""
    thickness: float | None
    """Thickness of a closed thin wall; None for any other part."""


class _FileSizes(TypedDict):
    """Sizes of all parts of a file."""

    file: str
    unit: str
    """Unit of the lengths: "m" or "file unit"."""
    parts: list[_PartSizes]


def parts(
    path: Path,
    unit: str | None,
    height: str | None,
    up: str,
    as_json: bool,
    as_scene: bool,
) -> None:
    """Print the parts of a mesh file, as a table, as JSON or as the start of a scene.

    Raises:
        InputError: for a file that cannot be read, or options that do not fit.
    """
    if as_json and as_scene:
        raise InputError("--scene: give it or --json, not both")
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
    if as_scene and not has_metres:
        raise InputError(
            f"--scene: {path} does not state its unit: give --unit or --height"
        )
    meshes = separate_parts(file_path, file_mesh, scale)
    is_turned = up == "z" and path.suffix.lower() in _Y_UP
    if as_scene:
        scaled = {"unit": "m" if metres == 1.0 else metres}
        if target is not None:
            scaled = {"height": target}
        if is_turned:
            sys.stdout.write(f"# {_Y_UP_LINE}\n")
        sys.stdout.write(scene_start({"path": str(path), **scaled, "up": up}, meshes))
        return
    placed = placed_parts(meshes)
    sizes = _FileSizes(
        file=str(path),
        unit="m" if has_metres else "file unit",
        parts=_all_sizes(meshes, placed),
    )
    if as_json:
        sys.stdout.write(json.dumps(sizes, indent=2) + "\n")
        return
    _print(sizes, bounds=_bounds(list(meshes.values())), is_stated=is_stated)
    _print_without_extent(sizes["parts"])
    if is_turned:
        print_line(open_console(), _Y_UP_LINE)


def _all_sizes(
    meshes: dict[str, Mesh], placed: dict[str, PlacedPart]
) -> list[_PartSizes]:
    instances = Counter(id(part.mesh) for part in placed.values())
    thickness = once(wall_thickness)
    sizes = []
    for name, mesh in meshes.items():
        # Sorts all edges, as does asking the mesh whether it is watertight.
        open_edges = mesh.open_edges
        is_closed = open_edges == 0
        first = placed[name].mesh
        sizes.append(
            _PartSizes(
                name=name,
                instances=instances[id(first)],
                faces=len(mesh.faces),
                area=mesh.area,
                volume=mesh.volume if is_closed else None,
                size=np.ptp(mesh.bounds, axis=0).tolist(),
                closed=is_closed,
                open_edges=open_edges,
                extent=mesh.has_extent,
                thickness=thickness(first) if is_closed else None,
            )
        )
    return sizes


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
            f"{part['instances']:,}",
            f"{part['faces']:,}",
            f"{part['area']:.4g}",
            "" if part["volume"] is None else f"{part['volume']:.4g}",
            _product(part["size"]),
            "" if part["thickness"] is None else f"{part['thickness']:.4g}",
            _surface(part),
        )
        for part in sizes["parts"]
    ]
    columns = (
        "node/mesh/material",
        "instances",
        "faces",
        f"area\n{unit}^2",
        f"volume\n{unit}^3",
        f"size\n{unit}",
        f"wall\n{unit}",
        "surface",
    )
    table = Table(columns, rows, left=(0, 7), framed=False)
    console.print(table.rich())
    faces = sum(part["faces"] for part in sizes["parts"])
    line = f"{count(len(rows), 'part')}, {count(faces, 'face')}, "
    line += f"{_product(bounds)} {unit}"
    if is_stated:
        line += ", in the unit that the file states"
    elif unit != "m":
        line += "s: --unit says how long they are"
    print_line(console, line)


def _surface(part: _PartSizes) -> str:
    if not part["extent"]:
        return "no extent"
    if part["closed"]:
        return "closed"
    return f"open ({part['open_edges']:,} open edges)"


def _print_without_extent(parts: list[_PartSizes]) -> None:
    """Say which parts have no extent, and how a scene leaves them out."""
    shorts = short_names([part["name"] for part in parts])
    names = [
        short for short, part in zip(shorts, parts, strict=True) if not part["extent"]
    ]
    if names:
        have, them = ("part has", "it") if len(names) == 1 else ("parts have", "them")
        print_line(
            open_console(),
            f"{len(names):,} {have} no extent: leave {them} out of a scene by the rule "
            f"{ignoring_rule(names)}",
        )


def _product(lengths: list[float]) -> str:
    return " x ".join(f"{length:.4g}" for length in lengths)
