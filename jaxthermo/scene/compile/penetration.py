"""Loads that have not gone as deep as a voxel: their error, and what reduces it.

Between a surface and its node, half a cell a / 2 below it, no heat is stored: a flux
warms the surface at once by what takes a time of the order of a^2 / alpha. A load that
would warm a surface without loss by D = q'' a / (2 k) above its node is answered, per
D, in the time u = alpha t / a^2 and with the loss b = s a / (2 k) of s [W/(m^2 K)],

    by a half space:  T = (1 - erfcx(2 b sqrt(u))) / b,
    by cells:         T = (1 + theta_1) / (1 + b),
                      d theta_1 / du = 2 (1 - b theta_1) / (1 + b) + theta_2 - theta_1,
                      d theta_i / du = theta_(i-1) - 2 theta_i + theta_(i+1).

The difference is the error of the cells; those of all jumps and ramps add up.

Source: Carslaw and Jaeger, Conduction of Heat in Solids, 2.7.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.linalg import eigh_tridiagonal
from scipy.optimize.elementwise import find_root
from scipy.special import erfcx

from ...arrays import Time, consecutive, device_array, is_compiling, is_traced
from ...errors import InputError
from ...material.material import Material
from ...memo.found import found
from ...memo.once import once
from ...network.network import inverse
from ...physics.time_varying import just_before
from ...structures.kinds.sheet import Sheet
from ...structures.kinds.skin import Skin
from ...structures.structure import AbstractStructure
from ..body_materials import AbstractMaterials
from ..scene import Scene
from .program import Compiled, Program


_MIN_ERROR = 1.0
"""Error from which a user is warned [K]."""

_MIN_FRACTION = 0.02
"""Error from which a user is warned, over the largest rise of the surface [-]."""

_MAX_INTERVALS = 48
"""Largest number of intervals between changes of the loads that are told apart."""

_MAX_SAVES = 512
"""Largest number of saved times at which the error is estimated."""

_CHAIN = 24
"""Number of cells, enough for times up to `_LATEST`."""

_LATEST = 25.0
"""Time from which cells are right [a^2 / alpha]."""

_MIN_LOSS = 1e-3
"""Loss b that stands for none [-]."""

_MIN_SHARE = 1e-12
"""Smallest excess of a surface over its node, as a share of that without loss [-]."""


class _OuterShapes(NamedTuple):
    """Outermost cells of structures, by fragment."""

    counts: list[int]
    """Number of fragments of each structure."""
    area: Float[np.ndarray, " s"]
    """[m^2]"""
    thickness: Float[np.ndarray, " s"]
    """[m]"""
    capacity: Float[np.ndarray, " s"]
    """Capacity of sheets, per area [J/(m^2 K)], and thickness of solids [m]."""


class _OuterCells(NamedTuple):
    """Outermost cells of all bodies, by fragment."""

    thickness: Float[np.ndarray, " s"]
    """Thickness a [m]."""
    time: Float[np.ndarray, " s"]
    """a^2 / alpha [s]; 0 where no natural term acts."""


class _Loads(NamedTuple):
    """Loads on a fragment, as its excess over its node without loss, D [K]."""

    fragment: int
    """Number of the fragment among those of all bodies."""
    edges: Float[np.ndarray, " e"]
    """Ends of the intervals between changes [s]."""
    first: Float[np.ndarray, " n"]
    """At the start of each interval [K]."""
    last: Float[np.ndarray, " n"]
    """At its end [K]."""
    loss: float
    """Loss b [-]."""


class _Response(NamedTuple):
    """Response of a surface to a step of D by 1 K."""

    step: Float[np.ndarray, "..."]
    """Rise [K]."""
    integral: Float[np.ndarray, "..."]
    """Its integral over u, the response to a ramp [K]."""


def penetration_warnings(
    scene: Scene,
    compiled: Compiled,
    save_times: Sequence[float],
) -> tuple[str, ...]:
    """A line about each body whose cells are too coarse for loads before saved times.

    None where numbers are traced.

    Args:
        scene: bodies and terms.
        compiled: their programs, and the times at which what acts changes.
        save_times: times that are saved [s].
    """
    saves = np.array([time for time in save_times if time > 0])
    is_known = not (scene.is_traced or is_traced(compiled.programs) or is_compiling())
    if not saves.size or not is_known:
        return ()
    changes = {*compiled.breakpoints, *compiled.starts}
    inner = sorted(time for time in changes if 0 < time < saves[-1])
    edges = np.array([0.0, *inner, saves[-1]])
    # The last interval ends with the run, not with a change.
    fastest = float(np.diff(edges)[:-1].min(initial=saves[0]))
    program = compiled.program
    shapes = found(
        scene.structures,
        by="outer cells",
        find=lambda: _outer_shapes(scene.structures),
    )
    cells = _outer_cells(scene, program, shapes)
    shallow = cells.time > fastest
    if shallow.any():
        shallow &= _largest_drive(compiled, float(saves[-1])) > _MIN_ERROR
    if not shallow.any():
        return ()
    loads = _strongest_loads(
        compiled,
        edges=_thinned(edges, _MAX_INTERVALS),
        shallow=shallow,
        slices=consecutive(shapes.counts),
    )
    lines = []
    for number, body_loads in loads.items():
        line = _line(
            scene.bodies[number].structure,
            thickness=float(cells.thickness[body_loads.fragment]),
            cell_time=float(cells.time[body_loads.fragment]),
            loads=body_loads,
            saves=_thinned(saves, _MAX_SAVES),
        )
        if line:
            lines.append(f"body {number}: {line}")
    return tuple(lines)


def _thinned(times: Float[np.ndarray, " n"], count: int) -> Float[np.ndarray, " m"]:
    """Some of the times, with the first and the last; all if they are not more."""
    chosen = np.linspace(0, len(times) - 1, min(len(times), count))
    return times[chosen.astype(int)]


def _half_cells(program: Program) -> Float[np.ndarray, " s"]:
    """Conductance of the half cell of each fragment if nothing touched it [W/K]."""
    half_cell = np.array(program.fragment_terms.half_cell, float)
    for fragments, body in zip(program.fragments(), program.bodies, strict=True):
        exposed = np.broadcast_to(np.asarray(body.exposed_fraction), body.node.shape)
        half_cell[fragments] /= np.where(exposed > 0, exposed, 1)
    return half_cell


def _outer_cells(scene: Scene, program: Program, shapes: _OuterShapes) -> _OuterCells:
    references = {}
    for group in program.bodies:
        mean = float(np.asarray(group.reference).mean())
        references |= dict.fromkeys(group.numbers, mean)
    # Bodies share materials.
    heat_capacities_of = once(_heat_capacities)
    heat_capacities = []
    for number, (body, count) in enumerate(
        zip(scene.bodies, shapes.counts, strict=True)
    ):
        material = body.material
        # Sheets, and air, which has no surface.
        if material is None:
            heat_capacities.append(np.ones(count))
            continue
        by_material = heat_capacities_of(material, references[number])
        if isinstance(material, Material):
            heat_capacities.append(by_material.repeat(count))
        else:
            of_fragments = material.of_fragments(scene.structures[number].voxels)
            heat_capacities.append(by_material[of_fragments])
    half_cell = _half_cells(program)
    heat = 2 * (shapes.capacity * np.concatenate(heat_capacities)) * shapes.area
    time = np.zeros(len(half_cell))
    np.divide(heat, half_cell, out=time, where=half_cell > 0)
    return _OuterCells(thickness=shapes.thickness, time=time)


def _outer_shapes(structures: tuple[AbstractStructure, ...]) -> _OuterShapes:
    thicknesses = []
    capacities = []
    for structure in structures:
        if isinstance(structure, Sheet):
            thickness = structure.face_cell_thickness(float)
            capacity = structure.face_capacity(float)
        else:
            thickness = 2 * structure.fragment_distance
            capacity = thickness
        thicknesses.append(thickness)
        capacities.append(capacity)
    areas = [structure.grid.fragment_area for structure in structures]
    return _OuterShapes(
        counts=list(map(len, areas)),
        area=np.concatenate(areas),
        thickness=np.concatenate(thicknesses),
        capacity=np.concatenate(capacities),
    )


def _heat_capacities(
    material: Material | AbstractMaterials, temperature: float
) -> Float[np.ndarray, " m"]:
    """Heat capacity of each material of a solid body [J/(m^3 K)]."""
    several = isinstance(material, AbstractMaterials)
    materials = material.materials if several else (material,)
    constant = [body_material.at(temperature) for body_material in materials]
    return np.array([float(entry.volumetric_heat_capacity) for entry in constant])


def _largest_drive(compiled: Compiled, end: float) -> Float[np.ndarray, " s"]:
    """Largest D of the fragments of all bodies up to the end [K]; infinite if unknown.

    It takes no program.
    """
    within = compiled.temperatures.known()
    assert within is not None
    terms = compiled.program.fragment_terms
    half_cell = np.asarray(terms.half_cell)
    drive = np.zeros(len(half_cell))
    for _, term in terms.natural:
        max_flux = float(term.law.max_flux(within, end))
        area = np.asarray(term.effective_area)
        heat_rate = np.multiply(area, max_flux, out=np.zeros(len(area)), where=area > 0)
        drive += np.divide(
            heat_rate, half_cell, out=np.zeros(len(area)), where=half_cell > 0
        )
    return drive


@eqx.filter_jit
def _drive(
    program: Program,
    time: Time,
    below: list[Float[Array, " _"]],
    above: Float[Array, " s"],
) -> Float[Array, " s"]:
    """D of all fragments at a time [K].

    Args:
        program: of a scene.
        time: of the loads [s].
        below: temperatures of the nodes below the fragments of each body [K].
        above: excess of each fragment over its node [K].
    """
    terms, theta = program.terms_above(time, below)
    surface = theta + above
    heat_rates = [term.heat_rate(time, surface) for _, term in terms.natural]
    total = sum(heat_rates, jnp.zeros_like(theta))
    return total * inverse(jnp.asarray(terms.half_cell))


def _strongest_loads(
    compiled: Compiled,
    edges: Float[np.ndarray, " e"],
    shallow: Bool[np.ndarray, " s"],
    slices: list[slice],
) -> dict[int, _Loads]:
    """Loads on the most strongly loaded of the shallow fragments of each body."""
    programs = compiled.programs
    if compiled.program.airs:
        programs = tuple(program.in_air(compiled.state) for program in programs)
    below = _initial_temperatures(compiled)
    dtype = below[0].dtype
    starts = edges[:-1].tolist()
    ends = [float(just_before(end, dtype)) for end in edges[1:].tolist()]

    def drives(
        start: float, time: float, above: Float[np.ndarray, " s"]
    ) -> Float[np.ndarray, " s"]:
        drive = _drive(
            programs[compiled.number_at(start)],
            time=device_array(np.asarray(time), dtype),
            below=below,
            above=device_array(above, dtype),
        )
        return np.asarray(drive, float)

    # Those of few intervals; all times of many would take much memory.
    @lru_cache(maxsize=4)
    def drives_of_nodes(start: float, time: float) -> Float[np.ndarray, " s"]:
        return drives(start, time, np.zeros(len(shallow)))

    strongest = np.zeros(len(shallow))
    for start, time in (*zip(starts, starts, strict=True), (starts[-1], ends[-1])):
        strongest = np.maximum(strongest, np.abs(drives_of_nodes(start, time)))
    # A load may change its sign; one that is not finite is told by the run.
    counts = shallow & (strongest > _MIN_ERROR / 2) & np.isfinite(strongest)
    strongest[~counts] = 0
    fragments = {
        number: part.start + int(strongest[part].argmax())
        for number, part in enumerate(slices)
        if strongest[part].any()
    }
    chosen = list(fragments.values())
    pairs = list(zip(starts, ends, strict=True))
    first = np.array([drives_of_nodes(start, start)[chosen] for start, _ in pairs])
    last = np.array([drives_of_nodes(start, end)[chosen] for start, end in pairs])
    # Numbers of the bodies that one time loads most, by this time.
    bodies_at = defaultdict(list)
    drive_of = {}
    for column, number in enumerate(fragments):
        drive = np.stack([first[:, column], last[:, column]], axis=1)
        # No error is larger than all changes of the load together.
        changes = np.abs(np.diff(drive.ravel(), prepend=0.0)).sum()
        if not _MIN_ERROR <= changes < math.inf:
            continue
        interval, is_last = np.unravel_index(np.abs(drive).argmax(), drive.shape)
        start = starts[interval]
        bodies_at[start, ends[interval] if is_last else start].append(number)
        drive_of[number] = drive
    loss_of = {}
    for (start, time), numbers in bodies_at.items():
        losses = _losses(
            partial(drives, start, time),
            without_loss=drives_of_nodes(start, time),
            fragments=np.array([fragments[number] for number in numbers]),
        )
        loss_of |= dict(zip(numbers, losses.tolist(), strict=True))
    return {
        number: _Loads(
            fragment=fragments[number],
            edges=edges,
            first=drive[:, 0],
            last=drive[:, 1],
            loss=loss_of[number],
        )
        for number, drive in drive_of.items()
    }


def _losses(
    drives: Callable[[Float[np.ndarray, " s"]], Float[np.ndarray, " s"]],
    without_loss: Float[np.ndarray, " s"],
    fragments: Int[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Loss b [-] of some fragments from D at an excess of each over its node."""

    def missing(
        share: Float[np.ndarray, " m"], fragment: Int[np.ndarray, " m"]
    ) -> Float[np.ndarray, " m"]:
        above = np.zeros(len(without_loss))
        above[fragment] = share * without_loss[fragment]
        return drives(above)[fragment] / without_loss[fragment] - share

    # At the excess E the flux is what half a cell conducts: D = (1 + b) E. Without a
    # loss E may be beyond D by a rounding error, and no root is within.
    root = find_root(
        missing,
        (0.0, 1.001),
        args=(fragments,),
        tolerances={"xatol": _MIN_SHARE, "xrtol": 1e-3},
    )
    share = np.where(root.success, root.x, 1.0)
    return np.maximum(1 / np.maximum(share, _MIN_SHARE) - 1, _MIN_LOSS)


def _initial_temperatures(compiled: Compiled) -> list[Float[Array, " _"]]:
    """Temperatures of the nodes below the fragments of each group at the start [K]."""
    groups = compiled.program.bodies
    if all(not start.shape for start in compiled.start):
        dtype = compiled.program.fragment_terms.half_cell.dtype
        # Moved, not made: that compiles a program for each shape.
        return [device_array(np.zeros(group.node.shape, dtype)) for group in groups]
    pairs = zip(groups, compiled.state, strict=True)
    return [group.below(group.network.temperature(state))[1] for group, state in pairs]


def _of_half_space(time: Float[np.ndarray, "..."], loss: float) -> _Response:
    """Response after times u [-] for a loss b [-]."""
    root = 2 * loss * np.sqrt(time)
    lag = erfcx(root)
    lag_integral = (lag - 1 + 2 * root / math.sqrt(math.pi)) / (2 * loss) ** 2
    return _Response(step=(1 - lag) / loss, integral=(time - lag_integral) / loss)


def _of_cells(time: Float[np.ndarray, "..."], loss: float) -> _Response:
    """Response after times u up to `_LATEST` [-] for a loss b [-]."""
    diagonal = np.full(_CHAIN, 2.0)
    diagonal[0] = 1 + 2 * loss / (1 + loss)
    decay, modes = eigh_tridiagonal(diagonal, np.full(_CHAIN - 1, -1.0))
    gain = 2 / (1 + loss) * modes[0] ** 2 / decay
    relaxed = -np.expm1(-decay * time[..., None])
    node = relaxed @ gain
    node_integral = time * gain.sum() - relaxed @ (gain / decay)
    return _Response(
        step=np.where(time > 0, 1 + node, 0) / (1 + loss),
        integral=(time + node_integral) / (1 + loss),
    )


def _rises(loads: _Loads, response: _Response, unit: float) -> Float[np.ndarray, "m n"]:
    """Rise at some times by the jump and ramp of the loads in each interval [K].

    Args:
        loads: of a fragment.
        response: at each time to a step at each edge of the loads.
        unit: a^2 / alpha [s].
    """
    jumps = loads.first - np.append(0.0, loads.last[:-1])
    slopes = unit * (loads.last - loads.first) / np.diff(loads.edges)
    return response.step[:, :-1] * jumps - np.diff(response.integral, axis=1) * slopes


def _line(
    structure: AbstractStructure,
    thickness: float,
    cell_time: float,
    loads: _Loads,
    saves: Float[np.ndarray, " m"],
) -> str:
    """The warning about a body, without its number; empty if its error is small."""
    time = np.maximum(saves[:, None] - loads.edges, 0) / cell_time
    early = np.minimum(time, _LATEST)
    rise = _rises(loads, _of_half_space(time, loads.loss), cell_time).sum(axis=1)
    by_cells = _rises(loads, _of_cells(early, loads.loss), cell_time)
    right = _rises(loads, _of_half_space(early, loads.loss), cell_time)
    errors = by_cells - right
    error = np.abs(errors.sum(axis=1))
    limit = max(_MIN_ERROR, _MIN_FRACTION * float(np.abs(rise).max()))
    worst = int(error.argmax())
    # Heat of the change that most of the error comes from.
    change = int(np.abs(errors[worst]).argmax())
    since = float(saves[worst] - loads.edges[change])
    depth = thickness * math.sqrt(since / cell_time)
    if not (error[worst] >= limit and depth < thickness):
        return ""
    latest = saves[np.flatnonzero(error >= limit)[-1]]
    cells = "cells" if isinstance(structure, Sheet | Skin) else "voxels"
    return (
        f"{since:.3g} s after a change of its loads heat has gone {depth * 1e3:.2g} mm "
        f"deep, less than its {cells} of {thickness * 1e3:.3g} mm: its surface is off "
        f"by about {error[worst]:.2g} K at {saves[worst]:.6g} s, and by "
        f"{limit:.2g} K or more until {latest:.6g} s; "
        f"{_remedy(structure, thickness, cell_time=cell_time, since=since)}"
    )


def _remedy(
    structure: AbstractStructure, thickness: float, cell_time: float, since: float
) -> str:
    if isinstance(structure, Sheet):
        return "give more `cells` through it, or save later"
    if isinstance(structure, Skin):
        return "give its skin more cells or a finer pitch, or save later"
    diffusivity = thickness**2 / cell_time
    try:
        cells = Skin.cells_for(thickness, diffusivity=diffusivity, time=since)
    except InputError:
        return "give it a finer pitch, or save later"
    return (
        f"give it a skin (`skin: {{cells: {cells}}}`) or a finer pitch, or save later"
    )
