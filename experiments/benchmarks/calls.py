"""A repeated call of a simulation with other numbers, its loop alone, and numba.

The standard scene on aggregates and on the full volume, 12 steps of RKL2: the compiled
loop alone; `run()` and `run(other)` of `compile_simulation`; and `jt.simulate(other)`,
where every other scene has a conductivity, an irradiance and a coefficient of its own.
A scene is compiled once as a function of its numbers, so that a call with other numbers
costs that function, the choice of steps, the loop and the reading of the surface. All
take turns with numba's explicit loop of the full volume of the same voxels. The errors
of all of them, numba's among them, are stated against the full volume in short steps of
RKL2. `run(other)` and `simulate(other)` must give the same temperatures.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

import jaxthermo as jt
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.run.simulate import run_plan
from jaxthermo.integrate.run.solution import Solution
from jaxthermo.report.numbers import with_range
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.timing import Spread, interleaved, ratio_of

from ..harness.agreement import largest_difference, require_within
from ..harness.measurement import MeasuredResult, Measurement, compared, plain_rows
from ..harness.meshes import END, SAVE_AT, standard_scene, statue
from ..harness.present import show, table_of
from .loops import NUMBA, loop_of, numba_explicit


QUICK = {"height": 60, "repeats": 2, "factors": (4, 8)}

_SOLVER = jt.SuperTimeStepping(dt=END / 12)
_BOUNDS = {"aggregate x4": 30.0, "aggregate x8": 150.0}
"""Speed of a call with other numbers, relative to numba's explicit full volume."""

_TRUTH = jt.SuperTimeStepping(dt=END / 144)
_MAX_ERROR = 20.0
_MAX_PEER_ERROR = 0.5
"""Largest error of our structures and of the peer, of their surfaces' range [%]."""
_MAX_DIFFERENCE = 1e-3
"""Largest difference of two calls with the same numbers [K]."""

_LOOP_FACTOR = 1.3
_REST_BOUND_MS = 3.0
"""A call with other numbers takes at most so many times its loop, and this in addition
[ms]."""

_LOOP = "the loop"
_AGAIN = "run()"
_OTHER = "run(other)"
_SIMULATE = "simulate(other)"
_PEER = f"{NUMBA}, explicit full volume"
_OURS = _LOOP, _AGAIN, _OTHER, _SIMULATE


class _Row(TypedDict):
    """Times of every call of one structure."""

    structure: str
    nodes: int
    error_percent: float
    peer_error_percent: float
    spans_s: dict[str, list[float]]


class _Result(MeasuredResult):
    mesh: str
    height: int
    peer_steps: int
    rows: list[_Row]


def run(
    folder: Path,
    height: int = 250,
    repeats: int = 7,
    factors: tuple[int, ...] = (3, 4, 6, 8),
) -> _Result:
    """Times of the calls of each structure, and their ratios.

    Args:
        folder: of the result.
        height: in voxels.
        repeats: of every call.
        factors: of the aggregates, in voxels along an edge of a block.
    """
    name, grid = statue(height)
    full = jt.FullVolume(grid)
    scene = _scene(full, 0)
    peer = numba_explicit(scene, END, SAVE_AT)
    truth = run_plan(plan_run(scene, t1=END, save_at=SAVE_AT, solver=_TRUTH))
    peer_run = StoredSolution(truth.times, peer.call(), truth.surfaces)
    peer_error = _error(_PEER, peer_run, truth=truth, tolerance=_MAX_PEER_ERROR)
    structures: dict[str, AbstractStructure] = {
        f"aggregate x{factor}": jt.Aggregate(grid, factor) for factor in factors
    }
    structures["full volume"] = full
    errors = {
        label: _error(
            label,
            jt.simulate(_scene(structure, 0), END, SAVE_AT, solver=_SOLVER),
            truth=truth,
            tolerance=_MAX_ERROR,
        )
        for label, structure in structures.items()
    }
    calls: dict[str, Callable[[], Any]] = {_PEER: peer.call}
    for label, structure in structures.items():
        structure_calls = _calls(structure, repeats)
        calls |= {
            f"{label}: {call_name}": call for call_name, call in structure_calls.items()
        }
    # The peer once a round with all structures: it takes seconds.
    spans = interleaved(calls, repeats)
    rows: list[_Row] = [
        {
            "structure": label,
            "nodes": structure.node_count,
            "error_percent": errors[label],
            "peer_error_percent": peer_error,
            "spans_s": {_PEER: spans[_PEER]}
            | {call_name: spans[f"{label}: {call_name}"] for call_name in _OURS},
        }
        for label, structure in structures.items()
    ]

    def time_of(call_name: str) -> Callable[[dict], str]:
        return lambda row: Spread.of(row["spans_s"][call_name]).text()

    def over_last(row: dict) -> str:
        spans_s = row["spans_s"]
        return with_range(*ratio_of(spans_s[_PEER], spans_s[_SIMULATE]))

    columns = [
        ("", "{structure}"),
        ("nodes", "{nodes:,}"),
        *((call_name, time_of(call_name)) for call_name in _OURS),
        ("numba over the last", over_last),
        ("error", "{error_percent:.2g} %"),
        ("of numba", "{peer_error_percent:.2g} %"),
    ]
    show(table_of(rows, columns, f"{name}, {height} high, {END:g} s, this host"))
    measured = [measurement for row in rows for measurement in _measurements(row)]
    return {
        "mesh": name,
        "height": height,
        "peer_steps": peer.steps,
        "rows": rows,
        "measurements": plain_rows(measured),
    }


def _error(
    name: str,
    solution: Solution | StoredSolution,
    *,
    truth: Solution,
    tolerance: float,
) -> float:
    """Error of a run against the full volume in short steps [%]."""
    error = float(jt.surface_error(solution, truth).worst_rms_percent)
    return require_within(f"error of {name}", error, tolerance=tolerance, unit="%")


def _scene(structure: AbstractStructure, number: int) -> jt.Scene:
    """The standard scene with slightly higher numbers, by the number of the scene."""
    # So little more that the runs have as many stages.
    return standard_scene(structure, factor=1 + 1e-4 * number)


def _calls(structure: AbstractStructure, repeats: int) -> dict[str, Callable[[], Any]]:
    """Calls of one structure, each of them to be made once more than `repeats`."""
    run = jt.compile_simulation(_scene(structure, 0), END, SAVE_AT, solver=_SOLVER)
    # Made before they are timed, and each used once.
    other_scenes = iter([_scene(structure, n) for n in range(1, 2 * repeats + 3)])
    unlike = _scene(structure, 2 * repeats + 3)
    surfaces = {
        _SIMULATE: jt.simulate(unlike, END, SAVE_AT, solver=_SOLVER),
        _OTHER: run(unlike),
    }
    largest_difference(
        f"surface of {structure.node_count} nodes",
        {name: solved.surface_temperature for name, solved in surfaces.items()},
        tolerance=_MAX_DIFFERENCE,
        unit="K",
    )

    def simulate_other() -> np.ndarray:
        solution = jt.simulate(next(other_scenes), END, SAVE_AT, solver=_SOLVER)
        return np.asarray(solution.surface_temperature)

    return {
        _LOOP: loop_of(run.plan),
        _AGAIN: lambda: np.asarray(run().surface_temperature),
        _OTHER: lambda: np.asarray(run(next(other_scenes)).surface_temperature),
        _SIMULATE: simulate_other,
    }


def _measurements(row: _Row) -> list[Measurement]:
    label = row["structure"]
    spans = row["spans_s"]
    peers = {_PEER: spans[_PEER]}
    call = spans[_SIMULATE]
    loop = spans[_LOOP]
    note = (
        f"{row['nodes']:,} nodes; error {row['error_percent']:.2g} %, of the peer "
        f"{row['peer_error_percent']:.2g} %"
    )
    rows = []
    for call_name in _OURS:
        # The bound is that of a call with other numbers.
        bound = _BOUNDS.get(label) if call_name == _SIMULATE else None
        rows += compared(
            name=f"{label}: {call_name}",
            ours=spans[call_name],
            peers=peers,
            bound=bound,
            note=note,
        )
    name = f"{label}: {_SIMULATE}"
    excess = np.subtract(call, loop).tolist()
    rest_ms = 1e3 * np.subtract(call, _LOOP_FACTOR * np.asarray(loop))
    return [
        *rows,
        *compared(name=name, ours=call, peers={"its loop": loop}, overhead=True),
        Measurement(f"{name} less its loop", "s", excess),
        Measurement(
            name=f"{name} less {_LOOP_FACTOR:g} times its loop",
            unit="ms",
            ours=rest_ms.tolist(),
            bound=_REST_BOUND_MS,
        ),
    ]
