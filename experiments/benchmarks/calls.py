"""A repeated call of a simulation with other numbers, its loop alone, and numba.

The standard scene on aggregates and on the full volume, 12 steps of RKL2: the compiled
loop alone; `run()` and `run(other)` of `compile_simulation`; and `jt.simulate(other)`,
where every other scene has a conductivity, an irradiance and a coefficient of its own.
A scene is compiled once as a function of its numbers, so that a call with other numbers
costs that function, the choice of steps, the loop and the reading of the surface. All
take turns with numba's explicit loop of the full volume of the same voxels.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

import jaxthermo as jt
from jaxthermo.report.numbers import with_range
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.timing import Spread, interleaved, ratio_of

from ..harness.measurement import MeasuredResult, Measurement, compared, plain_rows
from ..harness.meshes import END, SAVE_AT, standard_scene, statue
from ..harness.present import show, table_of
from .loops import NUMBA, loop_of, numba_explicit


QUICK = {"height": 60, "repeats": 2, "factors": (4, 8)}

_SOLVER = jt.SuperTimeStepping(dt=END / 12)
_BOUNDS = {"aggregate x4": 30.0, "aggregate x8": 150.0}
"""Speed of a call with other numbers, relative to numba's explicit full volume."""

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
    peer = numba_explicit(_scene(full, 0), END, SAVE_AT)
    structures: dict[str, AbstractStructure] = {
        f"aggregate x{factor}": jt.Aggregate(grid, factor) for factor in factors
    }
    structures["full volume"] = full
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


def _scene(structure: AbstractStructure, number: int) -> jt.Scene:
    """The standard scene with slightly higher numbers, by the number of the scene."""
    # So little more that the runs have as many stages.
    return standard_scene(structure, factor=1 + 1e-4 * number)


def _calls(structure: AbstractStructure, repeats: int) -> dict[str, Callable[[], Any]]:
    """Calls of one structure, each of them to be made once more than `repeats`."""
    run = jt.compile_simulation(_scene(structure, 0), END, SAVE_AT, solver=_SOLVER)
    # Made before they are timed, and each used once.
    other_scenes = iter([_scene(structure, n) for n in range(1, 2 * repeats + 3)])

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
    rows = []
    for call_name in _OURS:
        # The bound is that of a call with other numbers.
        bound = _BOUNDS.get(label) if call_name == _SIMULATE else None
        rows += compared(
            name=f"{label}: {call_name}",
            ours=spans[call_name],
            peers=peers,
            bound=bound,
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
