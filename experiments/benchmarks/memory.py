"""Memory of a run: forecast against measured, for each structure and kind of steps.

A forecast counts what a run needs in addition to its bodies: findings, program and
states. It is measured in a new process for each run: the rise of its resident memory
from before the scene is compiled to the peak while the steps run. An earlier run has
compiled all programs, since the forecast holds neither the compiler's memory, 50 to
500 MB, nor the peak of searches in the geometry, such as shadows, which has a column of
its own. Some megabytes of what is measured are the interpreter's.
"""

import ctypes
import gc
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypedDict

import jax
import numpy as np

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.host_memory import readable_bytes
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.run.simulate import run_plan
from jaxthermo.memo.store import without_cache

from ..harness.measurement import MeasuredResult, Measurement, plain_rows
from ..harness.meshes import STEEL
from ..harness.present import show, table_of
from ..harness.processes import in_new_process


QUICK = {"height": 48, "solvers": ("explicit",)}
_RADIUS = 0.1
_END = 6.0
_SAVES = 3
_MOST_OFF = 10.0
"""Largest allowed difference of a forecast from what is measured [%]."""
_STRUCTURES: dict[str, Callable[[Any], Any]] = {
    "full volume": jt.FullVolume,
    "full volume, numba": lambda grid: jt.FullVolume(grid, kernels="numba"),
    "octree": jt.Octree,
    "aggregate": lambda grid: jt.Aggregate(grid, factor=2),
}
_SOLVERS: dict[str, Callable[[], Any]] = {
    "explicit": jt.ForwardEuler,
    "RKL2": lambda: jt.SuperTimeStepping(dt=_END / _SAVES),
    "implicit": lambda: jt.TRBDF2(dt=_END / _SAVES),
}
_LIBC = ctypes.CDLL(None)
_MMAP_THRESHOLD = -3
"""Number of that option of `mallopt`, in malloc.h."""
_TERMS = (
    jt.Sun((-1, 0, -0.4), 800.0),
    jt.Convection(10.0, 290.0),
    jt.Surroundings(280.0),
)


class _Sizes(TypedDict):
    """Size of a run, and its memory as it was forecast and measured."""

    nodes: int
    fragments: int
    values: int
    forecast_bytes: int
    measured_bytes: int
    search_bytes: int
    ratio: float
    value_bytes: float


class _Row(_Sizes):
    structure: str
    solver: str


class _Result(MeasuredResult):
    rows: list[_Row]


def run(
    folder: Path, height: int = 160, solvers: Sequence[str] = tuple(_SOLVERS)
) -> _Result:
    """Table of forecasts and measurements for a ball of `height` voxels across.

    Raises:
        InputError: where the system does not tell a process's peak memory.
    """
    if not Path("/proc/self/clear_refs").exists():
        raise InputError("memory: only Linux tells the peak of a part of a run")
    # A cache of findings would be measured as their search.
    with without_cache():
        rows = [
            in_new_process(_measured, structure, solver, height)
            for structure in _STRUCTURES
            for solver in solvers
        ]

    def size(name: str) -> Callable[[dict], str]:
        return lambda row: readable_bytes(row[name])

    columns = [
        ("structure", "{structure}"),
        ("steps", "{solver}"),
        ("nodes", "{nodes:,}"),
        ("forecast", size("forecast_bytes")),
        ("measured", size("measured_bytes")),
        ("forecast / measured", "{ratio:.2f}"),
        ("a value of the state", "{value_bytes:.1f} B"),
        ("searches before", size("search_bytes")),
    ]
    title = f"A ball of {height} voxels across in sun, air and surroundings, in float32"
    show(table_of(rows, columns, title))
    return {"rows": rows, "measurements": plain_rows(map(_measurement, rows))}


def _measurement(row: _Row) -> Measurement:
    forecast = readable_bytes(row["forecast_bytes"])
    peak = readable_bytes(row["measured_bytes"])
    return Measurement(
        f"{row['structure']}, {row['solver']}: forecast over or under measured",
        "%",
        [100 * abs(row["ratio"] - 1)],
        bound=_MOST_OFF,
        note=f"{forecast} forecast, {peak} measured",
    )


def _measured(structure: str, solver: str, height: int) -> _Row:
    """Forecast and measurement of one run in this process [bytes]."""
    # Arrays are given back to the system as soon as they are freed.
    _LIBC.mallopt(_MMAP_THRESHOLD, 2**18)
    _ran(_scene(structure, height), solver)
    _clear()
    scene = _scene(structure, height)
    _clear()
    return {"structure": structure, "solver": solver, **_ran(scene, solver)}


def _scene(structure: str, height: int) -> jt.Scene:
    grid = jt.voxelize(jt.shapes.sphere(_RADIUS), 2 * _RADIUS / height)
    body = jt.Body(_STRUCTURES[structure](grid), STEEL, temperature=300.0)
    return jt.Scene((body,), _TERMS)


def _ran(scene: jt.Scene, solver: str) -> _Sizes:
    resident_before = _memory("VmRSS")
    _reset_peak()
    saves = np.linspace(0, _END, _SAVES + 1)[1:].tolist()
    plan = plan_run(scene, t1=_END, save_at=saves, solver=_SOLVERS[solver]())
    gc.collect()
    searches = _memory("VmHWM") - resident_before
    _reset_peak()
    jax.block_until_ready(run_plan(plan).surface_temperature)
    took = _memory("VmHWM") - resident_before
    receipt = plan.compiled.receipt
    values = sum(state.size for state in plan.compiled.start)
    return {
        "nodes": receipt.nodes,
        "fragments": receipt.fragments,
        "values": values,
        "forecast_bytes": receipt.memory_bytes,
        "measured_bytes": took,
        "search_bytes": searches,
        "ratio": receipt.memory_bytes / took,
        "value_bytes": took / values,
    }


def _clear() -> None:
    """Give back all memory that is not in use."""
    gc.collect()
    jt.forget_findings()
    gc.collect()
    _LIBC.malloc_trim(0)


def _memory(name: str) -> int:
    """Resident memory now, VmRSS, or its peak, VmHWM [bytes]."""
    text = Path("/proc/self/status").read_text(encoding="ascii")
    match = re.search(rf"{name}:\s+(\d+)", text)
    assert match is not None
    return int(match[1]) * 1024


def _reset_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
