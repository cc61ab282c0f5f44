"""Call of a simulation again with other numbers, beside its loop and beside numba.

The standard scene on aggregates and on the full volume, 12 steps of RKL2: the compiled
loop alone; `run()` and `run(other)` of `compile_simulation`; and `jt.simulate(other)`,
where every other scene has a conductivity, an irradiance and a coefficient of its own.
All take turns with numba's explicit loop of the full volume of the same voxels.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

import jaxthermo as jt
from jaxthermo.timing import Spread, interleaved, ratio_of

from ..harness.measurement import Measurement, PlainMeasurement, plain_rows
from ..harness.meshes import END, HEIGHT, SAVE_AT, START, thesis_meshes
from ..harness.present import show, table_of
from ..harness.timing import ratio_text, timing_of
from .loops import NUMBA, loop_of, numba_explicit


QUICK = {"height": 60, "repeats": 2, "factors": (4, 8)}

_SOLVER = jt.SuperTimeStepping(dt=END / 12)
_BOUNDS = {"aggregate x4": 30.0, "aggregate x8": 150.0}
"""Speed of a call with other numbers, relative to numba's explicit full volume."""

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


class _Result(TypedDict):
    mesh: str
    height: int
    peer_steps: int
    rows: list[_Row]
    measurements: list[PlainMeasurement]


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
    name, mesh = next(iter(thesis_meshes().items()))
    grid = jt.voxelize(mesh, HEIGHT / height)
    full = jt.FullVolume(grid)
    peer = numba_explicit(_scene(full, 0), END, SAVE_AT)
    structures: dict[str, jt.Aggregate | jt.FullVolume] = {
        f"aggregate x{factor}": jt.Aggregate(grid, factor) for factor in factors
    }
    structures["full volume"] = full
    calls: dict[str, Callable[[], Any]] = {_PEER: peer.call}
    for label, structure in structures.items():
        structure_calls = _calls(structure, repeats)
        calls |= {
            f"{label}: {call_name}": call for call_name, call in structure_calls.items()
        }
    # The peer once a round, beside all structures: it takes seconds.
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
        return lambda row: timing_of(row["spans_s"][call_name]).text()

    columns = [
        ("", "{structure}"),
        ("nodes", "{nodes:,}"),
        *((call_name, time_of(call_name)) for call_name in _OURS),
        ("numba over the last", lambda row: ratio_text(_over(row, _PEER, _SIMULATE))),
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


def _scene(structure: Any, number: int) -> jt.Scene:
    """The standard scene with numbers of its own."""
    # So little more that the runs have as many stages.
    factor = 1 + 1e-4 * number
    material = jt.Material(
        16.0 * factor, density=8000.0, specific_heat=500.0, absorptivity=1.0
    )
    terms = (
        jt.Sun((-1.0, 0.0, 0.0), jt.Until(5000.0 * factor, END / 2)),
        jt.Convection(10.0 * factor, START),
    )
    return jt.Scene((jt.Body(structure, material, temperature=START),), terms)


def _calls(structure: Any, repeats: int) -> dict[str, Callable[[], Any]]:
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


def _over(row: _Row, above: str, below: str) -> Spread:
    return ratio_of(row["spans_s"][above], row["spans_s"][below])


def _measurements(row: _Row) -> list[Measurement]:
    label = row["structure"]
    spans = row["spans_s"]
    peer = spans[_PEER]
    call = spans[_SIMULATE]
    loop = spans[_LOOP]
    bound = _BOUNDS.get(label)
    rows = [
        Measurement(
            name=f"{label}: {call_name}",
            unit="s",
            ours=spans[call_name],
            peer_name=_PEER,
            peer=peer,
        )
        for call_name in (_LOOP, _AGAIN, _OTHER)
    ]
    name = f"{label}: {_SIMULATE}"
    excess = np.subtract(call, loop).tolist()
    return [
        *rows,
        Measurement(
            name=name, unit="s", ours=call, peer_name=_PEER, peer=peer, bound=bound
        ),
        Measurement(
            name=name,
            unit="s",
            ours=call,
            peer_name="its loop",
            peer=loop,
            overhead=True,
        ),
        Measurement(f"{name} less its loop", "s", excess),
    ]
