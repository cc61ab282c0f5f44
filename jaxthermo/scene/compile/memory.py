"""Forecast of the memory of a run, before anything large is made.

A run keeps what it computes from its bodies and their compiled program, and its steps
need states and surface arrays. Both are sums over the elements of a body times the
bytes of each. The bytes of the largest arrays follow from their shapes, the others are
measured on many bodies with sun, convection and emission. `experiments run memory`
compares them with what processes take. The bodies themselves with their voxels and
structures, which exist before, and the compiler are not counted.
"""

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from ...host_memory import require_memory
from ...material.material import Material
from ...memo.found import found
from ...memo.once import once
from ...parallel.devices import require_device_memory
from ...sheets.sheet_grid import SheetGrid
from ...structures.kinds.full import FullVolume
from ...structures.structure import AbstractStructure
from ..body_materials import AbstractMaterials
from ..motion import Motion
from ..scene import Scene
from .groups import as_links, grouped_numbers
from .program import Compiled


Method = Literal["euler", "stages", "implicit", "diagonal"]
"""Kind of steps, by the states that they need: one and the next; those of the stages of
a Runge-Kutta-Legendre scheme; those of linear solves with multigrid, or without."""


class _Parts(NamedTuple):
    """Parts of a body, or bytes for each of them."""

    faces: float = 0
    """Triangles of its mesh."""
    fragments: float = 0
    read_fragments: float = 0
    """Fragments, once for each device of the body."""
    surface_nodes: float = 0
    cut_voxels: float = 0
    values: float = 0
    """Values of a state: cells of the lattice, or nodes."""
    cut_values: float = 0
    """Values of a state whose lattice has cut voxels."""
    nodes: float = 0
    links: float = 0
    varying_links: float = 0
    """Links of materials that vary with temperature, where these are several."""
    column_cells: float = 0
    """Cells of columns through a thickness."""

    def bytes_of(self, counts: "_Parts") -> float:
        """Return the sum over all parts of their number times these bytes [bytes]."""
        return float(np.dot(self, counts))


# In float32. A stencil has a byte for each cell, and no array of links.
_KEPT_STENCIL = _Parts(faces=135, fragments=223, cut_voxels=136, values=1)
_KEPT_LINKS = _Parts(faces=137, fragments=152, surface_nodes=100, links=41)
# Runs and rows of a full volume, instead of links.
_KEPT_RUNS = _Parts(faces=133, fragments=222, surface_nodes=82)
# The links of a full volume are found for the run, other structures have theirs.
_KEPT_VOXEL_LINKS = _Parts(links=43)
# Conductances of three faces and the capacity of each cell.
_KEPT_MIXED_STENCIL = _Parts(values=16)
# Copies in the network and in the surface that several bodies share.
_KEPT_JOINED = _Parts(faces=108, fragments=264, nodes=16, links=40)
# Of its voxels alone: bodies of one grid have them once.
_KEPT_ONCE = _Parts(fragments=96, nodes=52, links=40)
_KEPT_ONCE_STENCIL = _Parts(fragments=48, cut_voxels=136)
# Of every further snapshot: what sources that move, and bodies that move beside it,
# change on a body at rest; and all that follows from the place of one that moves.
_KEPT_SNAPSHOT = _Parts(fragments=30)
# On a sheet, whose fragments are each lit by several triangles.
_KEPT_SNAPSHOT_OF_SHEET = _Parts(fragments=68)
_KEPT_MOVED = _Parts(faces=72, fragments=88)
# Triangles of bodies that move are joined with those of others that do.
_KEPT_MOVED_TOGETHER = _Parts(faces=72)

# Two states of a step, five of stages; a solve has a dozen, and the levels' own.
_STEPS_STENCIL: dict[Method, _Parts] = {
    "euler": _Parts(fragments=85, cut_voxels=49, values=8),
    "stages": _Parts(fragments=85, cut_voxels=49, values=16, cut_values=17),
    "implicit": _Parts(fragments=66, cut_voxels=190, values=97),
    "diagonal": _Parts(fragments=66, cut_voxels=190, values=71),
}
_STEPS_LINKS: dict[Method, _Parts] = {
    "euler": _Parts(fragments=36, surface_nodes=58, values=4, links=4),
    "stages": _Parts(fragments=36, surface_nodes=58, values=28, links=4),
    "implicit": _Parts(fragments=28, surface_nodes=58, values=4, links=33),
    "diagonal": _Parts(fragments=28, surface_nodes=58, values=47, links=4),
}
_STEPS_RUNS: dict[Method, _Parts] = {
    "euler": _Parts(fragments=34, surface_nodes=58, values=12),
    "stages": _Parts(fragments=34, surface_nodes=58, values=24),
}
# For solves alone: the connected parts, found from links, and levels of the multigrid.
_SOLVES_STENCIL: dict[Method, _Parts] = {
    "implicit": _Parts(nodes=83, cut_voxels=220, values=8),
    "diagonal": _Parts(nodes=83, cut_voxels=220),
}
_SOLVES_LINKS: dict[Method, _Parts] = {"implicit": _Parts(links=60)}

# What processes take while steps run in addition to the compiler's report: for links a
# copy of the state and what is computed from them on the way; for a stencil of any size
# what the allocator and the programs hold [bytes].
_RUNTIME_LINKS = _Parts(values=4, links=5)
_RUNTIME_STENCIL = 8_000_000
# Explicit steps eliminate columns: factors, and right-hand sides on the way.
_RUNTIME_COLUMNS: dict[Method, _Parts] = {
    "euler": _Parts(column_cells=167),
    "stages": _Parts(column_cells=167),
}

_KEPT_DOUBLE = 1.2
"""Ratio of the memory kept in float64 to that in float32: geometry is always in
float64."""


class _MemoryForecast(NamedTuple):
    """Memory of a run [bytes]."""

    retained: int
    """Findings and compiled program, as long as the scene exists."""
    steps: int
    """States and temporary arrays while the steps run."""
    rows: int
    """Saved temperatures."""
    runtime: int
    """Arrays of the steps that are in no report of the compiler."""

    @property
    def peak(self) -> int:
        """Peak of the run."""
        # Saved rows exist twice while the solution is put together.
        return self.retained + self.rows + max(self.steps + self.runtime, self.rows)


class _Kind(NamedTuple):
    """Properties of a body that the bytes for each of its parts depend on."""

    network: Literal["stencil", "runs", "links", "links of voxels"]
    is_mixed: bool
    """True for several materials."""
    is_joined: bool
    """True if it conducts as one network with others."""
    is_known: bool
    """True if a body before it has the same grid."""
    moves: bool
    moves_with_others: bool
    """True if it moves, and is not the only one."""
    is_sheet: bool


class _BodyKind(NamedTuple):
    """Properties of a body apart from those of its structure."""

    is_joined: bool
    moves: bool
    is_mixed: bool
    is_varying: bool
    """True for materials whose links vary, see `has_varying_links`."""


def forecast_memory(
    scene: Scene,
    saves: int,
    snapshots: int,
    method: Method,
    classes: tuple[int, ...] | None = None,
) -> _MemoryForecast:
    """Forecast of a run with a number of saves, by steps of a kind.

    `classes` are those of the bodies of the program, see `grouped_numbers`.
    """
    width = 8 if scene.dtype == "float64" else 4
    counts_by_kind = found(
        (scene,),
        by=("parts of bodies", classes),
        find=lambda: _counts_by_kind(scene, classes),
    )
    forecasts = [
        _forecast_of_kind(
            body_kind,
            counts=counts,
            width=width,
            saves=saves,
            snapshots=snapshots,
            method=method,
        )
        for body_kind, counts in counts_by_kind.items()
    ]
    stencils = any(body_kind.network == "stencil" for body_kind in counts_by_kind)
    allocator = _RUNTIME_STENCIL if stencils else 0
    retained, steps, rows, runtime = np.array(forecasts).sum(axis=0)
    return _MemoryForecast(
        retained=int(retained),
        steps=int(steps),
        rows=int(rows),
        runtime=allocator + int(runtime),
    )


def _counts_by_kind(
    scene: Scene, classes: tuple[int, ...] | None
) -> dict[_Kind, _Parts]:
    """Parts of all bodies of each kind together."""
    joined = {
        number
        for numbers in grouped_numbers(scene, classes)
        for number in numbers
        if len(numbers) > 1
    }
    # Many bodies share a material.
    is_mixed = once(lambda material: isinstance(material, AbstractMaterials))
    is_varying = once(has_varying_links)
    bodies = tuple(
        _BodyKind(
            is_joined=number in joined,
            moves=isinstance(body.pose, Motion),
            is_mixed=is_mixed(body.material),
            is_varying=is_varying(body.material),
        )
        for number, body in enumerate(scene.bodies)
    )
    return found(
        scene.structures,
        by=("parts of bodies", bodies),
        find=lambda: _summed_counts(scene.structures, bodies),
    )


def _summed_counts(
    structures: tuple[AbstractStructure, ...], bodies: tuple[_BodyKind, ...]
) -> dict[_Kind, _Parts]:
    several_move = sum(body.moves for body in bodies) > 1
    grids: set[int] = set()
    counts: dict[_Kind, list[_Parts]] = {}
    for structure, body in zip(structures, bodies, strict=True):
        in_group = as_links(structure) if body.is_joined else structure
        grid = in_group.grid
        body_kind = _Kind(
            network=_network_of(in_group),
            is_mixed=body.is_mixed,
            is_joined=body.is_joined,
            is_known=id(grid) in grids,
            moves=body.moves,
            moves_with_others=body.moves and several_move,
            is_sheet=isinstance(grid, SheetGrid),
        )
        grids.add(id(grid))
        body_counts = _counts(in_group)
        if body.is_varying:
            body_counts = body_counts._replace(varying_links=in_group.link_count)
        counts.setdefault(body_kind, []).append(body_counts)
    return {
        body_kind: _Parts(*np.array(listed).sum(axis=0))
        for body_kind, listed in counts.items()
    }


def _network_of(
    structure: AbstractStructure,
) -> Literal["stencil", "runs", "links", "links of voxels"]:
    if len(structure.state_shape) == 3:
        return "stencil"
    if not isinstance(structure, FullVolume):
        return "links"
    return "links of voxels" if structure.kernels is None else "runs"


class _KindForecast(NamedTuple):
    """Memory of the bodies of a kind; see `_MemoryForecast`."""

    retained: float
    steps: float
    rows: float
    runtime: float


def _forecast_of_kind(
    body_kind: _Kind,
    counts: _Parts,
    width: int,
    saves: int,
    snapshots: int,
    method: Method,
) -> _KindForecast:
    # What reads the fragments is on every device, and counted for all of them; what
    # steps evaluate is on the device of its section.
    read = counts._replace(fragments=counts.read_fragments)
    runtime = 0.0
    if body_kind.network == "stencil":
        retained = _KEPT_STENCIL.bytes_of(read)
        if body_kind.is_mixed:
            retained += _KEPT_MIXED_STENCIL.bytes_of(counts) * width / 4
        if body_kind.is_known:
            retained -= _KEPT_ONCE_STENCIL.bytes_of(counts)
        step_bytes = _STEPS_STENCIL[method]
        solves = _SOLVES_STENCIL
    elif body_kind.network == "runs":
        retained = _KEPT_RUNS.bytes_of(read)
        # Solves have a form of their own (`for_solves`).
        step_bytes = _STEPS_RUNS.get(method, _STEPS_LINKS[method])
        solves = _SOLVES_LINKS
    else:
        retained = _KEPT_LINKS.bytes_of(read)
        if body_kind.network == "links of voxels":
            retained += _KEPT_VOXEL_LINKS.bytes_of(counts)
        step_bytes = _STEPS_LINKS[method]
        solves = _SOLVES_LINKS
        runtime = _RUNTIME_LINKS.bytes_of(counts) * width / 4
        eliminated = _RUNTIME_COLUMNS.get(method, _Parts())
        runtime += eliminated.bytes_of(counts) * width / 4
    retained += solves.get(method, _Parts()).bytes_of(counts)
    if body_kind.is_joined:
        retained += _KEPT_JOINED.bytes_of(counts)
    if body_kind.is_joined and body_kind.is_known:
        retained -= _KEPT_ONCE.bytes_of(counts)
    kept_snapshot = _KEPT_SNAPSHOT
    if body_kind.moves:
        kept_snapshot = _KEPT_MOVED
    elif body_kind.is_sheet:
        kept_snapshot = _KEPT_SNAPSHOT_OF_SHEET
    of_snapshot = kept_snapshot.bytes_of(read)
    if body_kind.moves_with_others:
        of_snapshot += _KEPT_MOVED_TOGETHER.bytes_of(read)
    retained += (snapshots - 1) * of_snapshot
    retained += counts.varying_links * (8 * width + 8)
    return _KindForecast(
        retained=retained * (_KEPT_DOUBLE if width == 8 else 1),
        steps=step_bytes.bytes_of(counts) * width / 4,
        rows=int(read.fragments) * width * saves,
        runtime=runtime,
    )


def check_memory(
    scene: Scene, saves: int, snapshots: int, method: Method, classes: tuple[int, ...]
) -> int:
    """Forecast of the peak of a run [bytes]; arguments as of `forecast_memory`.

    Raises:
        InputError: if it would not fit.
    """
    peak = forecast_memory(
        scene, saves=saves, snapshots=snapshots, method=method, classes=classes
    ).peak
    remedy = "use a coarser pitch, or save fewer times"
    task = "simulating this scene"
    require_memory(peak, task, remedy)
    require_device_memory(peak // scene.device_count, task, remedy)
    return peak


def with_memory_of(
    compiled: Compiled, scene: Scene, saves: int, method: Method
) -> Compiled:
    """Return a compiled scene with the forecast of steps of another kind.

    Raises:
        InputError: if these would not fit into memory.
    """
    memory = check_memory(
        scene,
        saves=saves,
        snapshots=len(compiled.starts),
        method=method,
        classes=compiled.classes,
    )
    receipt = replace(compiled.receipt, memory_bytes=memory)
    return replace(compiled, receipt=receipt)


def _counts(structure: AbstractStructure) -> _Parts:
    # Called on the class: a method of a module takes a pass over its leaves.
    return AbstractStructure.found(
        structure, "part_counts", lambda: _counts_of(structure)
    )


def _counts_of(structure: AbstractStructure) -> _Parts:
    grid = structure.grid
    is_stencil = len(structure.state_shape) == 3
    cut = grid.cut_voxel_count
    values = int(np.prod(structure.state_shape, dtype=float))
    columns = structure.columns
    # Those of a stencil would be counted among all its voxels, and are not needed.
    surface, links = (0, 0) if is_stencil else _surface_and_links(structure)
    return _Parts(
        faces=len(grid.mesh.faces),
        fragments=len(grid.fragment_area),
        read_fragments=structure.device_count * len(grid.fragment_area),
        surface_nodes=surface,
        cut_voxels=cut,
        values=values,
        cut_values=values if cut else 0,
        nodes=structure.node_count,
        links=links,
        column_cells=0 if columns is None else columns.link.size,
    )


def _surface_and_links(structure: AbstractStructure) -> tuple[int, int]:
    """Number of nodes that have surface, and of links."""
    count = structure.found(
        "surface_node_count", lambda: len(np.unique(structure.fragment_node()))
    )
    return count, structure.link_count


def has_varying_links(material: Material | AbstractMaterials | None) -> bool:
    """True if several materials, or one by axis, vary with temperature."""
    if material is None:
        return False
    several = isinstance(material, AbstractMaterials)
    materials = material.materials if several else (material,)
    by_axis = any(isinstance(entry.conductivity, tuple) for entry in materials)
    return (several or by_axis) and any(entry.varies for entry in materials)
