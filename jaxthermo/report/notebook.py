"""HTML by which a notebook shows a value: a picture, and a few lines about it.

Classes below this folder find it by name, since they cannot import it.
"""

import base64
import html
import io
from collections.abc import Iterator, Sequence
from functools import singledispatch
from typing import Any, NamedTuple

import numpy as np
from PIL.Image import Image as Picture, fromarray

from ..arrays import is_traced
from ..constants import ZERO_CELSIUS
from ..errors import InputError
from ..geometry.mesh import Mesh, Pose, mesh_summary
from ..image.colour.picture import picture
from ..image.colour.preview import draw_preview
from ..image.radiance.image import Image
from ..image.render import render
from ..image.surface.camera import frame_all
from ..image.surface.visible import WorldMesh
from ..integrate.run.abstract_solution import AbstractSolution
from ..progress import duration
from ..scene.air import bodies_with_surface
from ..scene.compile.body_names import body_label
from ..scene.receipt_model import Receipt
from ..scene.scene import Scene
from ..voxels.abstract_grid import AbstractGrid
from ..voxels.grid import VoxelGrid
from .numbers import count, significant
from .voxel_sheet import voxel_view


_MAX_LINES = 20
_WIDTH = 400
_HEIGHT = 300
# Smallest range of a colour scale [K].
_MIN_RANGE = 0.1


class _Shown(NamedTuple):
    """A value as a notebook shows it."""

    picture: Picture | None
    lines: Sequence[str]


def html_of(value: Any) -> str:
    """The HTML of a value of a class that has `_repr_html_`."""
    shown = _Shown(None, [f"{type(value).__name__} of traced values"])
    if not is_traced(value):
        try:
            shown = _shown(value)
        except InputError as error:
            # A notebook would show a traceback in place of the value.
            shown = _Shown(None, [f"{type(value).__name__} without a picture: {error}"])
    lines = [*shown.lines]
    if len(lines) > _MAX_LINES:
        more = len(lines) - _MAX_LINES + 1
        lines = [*lines[: _MAX_LINES - 1], f"and {count(more, 'more line')}"]
    text = "<br>".join(map(html.escape, lines))
    if shown.picture is None:
        return f"<div>{text}</div>"
    buffer = io.BytesIO()
    shown.picture.save(buffer, "PNG")
    data = base64.b64encode(buffer.getvalue()).decode()
    alt = html.escape(lines[0])
    return f"<div><img alt='{alt}' src='data:image/png;base64,{data}'><br>{text}</div>"


@singledispatch
def _shown(value: Any) -> _Shown:
    return _Shown(None, [repr(value)])


@_shown.register
def _image(image: Image) -> _Shown:
    is_body = np.asarray(image.object_id) >= 0
    if not is_body.any():
        return _Shown(None, [_size(image), "no body is in the image"])
    apparent = np.asarray(image.apparent_temperature, float)[is_body]
    surface = np.asarray(image.temperature, float)[is_body]
    low, high = _scale(apparent)
    return _Shown(
        picture(image, low, high),
        [
            _size(image),
            f"apparent temperature {_range(apparent)}",
            f"surface temperature {_range(surface)}",
        ],
    )


def _size(image: Image) -> str:
    rows, columns = np.shape(image.radiance)
    return f"Image: {columns} x {rows} pixels at {duration(float(image.time))}"


def _scale(kelvin: np.ndarray) -> tuple[float, float]:
    low = float(kelvin.min())
    return low, max(float(kelvin.max()), low + _MIN_RANGE)


def _range(kelvin: np.ndarray) -> str:
    low, high = np.array([kelvin.min(), kelvin.max()]) - ZERO_CELSIUS
    return f"{low:.1f} to {high:.1f} degC"


@_shown.register
def _solution(solution: AbstractSolution) -> _Shown:
    triangles = [surface.geometry.triangles for surface in solution.surfaces]
    camera = frame_all(np.concatenate(triangles), _WIDTH, _HEIGHT)
    return _Shown(
        _image(render(solution, camera)).picture, [*_solution_lines(solution)]
    )


def _solution_lines(solution: AbstractSolution) -> Iterator[str]:
    times = np.asarray(solution.times, float)
    saved = count(len(times), "saved time")
    yield f"{type(solution).__name__}: {saved}, the last at {duration(times[-1])}"
    for number, surface in enumerate(solution.surfaces):
        kelvin = np.asarray(solution.of_body(number), float)[-1]
        label = body_label(number, surface.geometry.name)
        yield f"{label}: surface at {_range(kelvin)}"
    if solution.energy is not None:
        last = {
            name: float(np.asarray(heat)[-1])
            for name, heat in solution.energy.mechanisms.items()
        }
        for name, heat in last.items():
            yield f"heat by {name}: {significant(heat)} J"
        residual = float(np.abs(np.asarray(solution.energy.residual_relative)).max())
        yield f"energy residual {residual:.1e}"
    if solution.heat_rates is not None:
        for name, rate in solution.heat_rates.mechanisms.items():
            yield f"heat rate by {name}: {significant(float(rate))} W"
    if solution.run is not None and solution.energy is not None:
        yield f"{count(solution.run.steps, 'step')} by {solution.run.solver}"


@_shown.register
def _mesh(mesh: Mesh) -> _Shown:
    if not len(mesh.faces):
        raise InputError("it has no faces")
    return _Shown(_preview([mesh], [Pose()]), [f"Mesh {mesh_summary(mesh)}"])


@_shown.register
def _grid(grid: AbstractGrid) -> _Shown:
    if not isinstance(grid, VoxelGrid):
        return _Shown(_preview([grid.mesh], [Pose()]), [repr(grid)])
    camera = frame_all(grid.mesh.triangles, _WIDTH, _HEIGHT)
    return _Shown(fromarray(voxel_view(grid, camera)), [repr(grid)])


@_shown.register
def _scene(scene: Scene) -> _Shown:
    bodies = bodies_with_surface(scene)
    noun = "body" if len(scene.bodies) == 1 else "bodies"
    lines = [f"Scene: {len(scene.bodies):,} {noun}, state in {scene.dtype}"]
    for number, body in enumerate(bodies):
        structure = body.structure
        nodes = count(structure.node_count, "node")
        label = body_label(number, body.name)
        lines.append(f"{label}: {type(structure).__name__}, {nodes}")
    lines.append(f"terms: {', '.join(term.name for term in scene.terms) or 'none'}")
    meshes = [body.structure.grid.mesh for body in bodies]
    poses = [body.pose.at(0.0) for body in bodies]
    names = [body.name for body in bodies]
    return _Shown(_preview(meshes, poses, names), lines)


@_shown.register
def _receipt(receipt: Receipt) -> _Shown:
    lines = [
        f"included: {', '.join(receipt.included)}",
        f"{count(receipt.nodes, 'node')}, {count(receipt.links, 'link')}, "
        f"{count(receipt.fragments, 'fragment')}, state in {receipt.dtype}",
        *(f"warning: {line}" for line in receipt.warnings),
        *(f"left out: {o.what} ({o.why})" for o in receipt.left_out),
        *(f"note: {line}" for line in receipt.notes),
    ]
    return _Shown(None, lines)


def _preview(
    meshes: Sequence[Mesh], poses: Sequence[Pose], names: Sequence[str] = ()
) -> Picture:
    """Shaded picture of meshes, seen from the front; an open one from both sides."""
    placed = [
        WorldMesh(pose.to_world(mesh.vertices), mesh.faces, not mesh.is_watertight)
        for mesh, pose in zip(meshes, poses, strict=True)
    ]
    triangles = np.concatenate([body.vertices[body.faces] for body in placed])
    drawn, _ = draw_preview(placed, frame_all(triangles, _WIDTH, _HEIGHT), names=names)
    return drawn
