"""One row: a structure under a load, its cost and its error."""

import os
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from jaxthermo.integrate.run.solution import Solution
from jaxthermo.integrate.surface_error import AnySolution, surface_error
from jaxthermo.scene.scene import Scene
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.timing import Timing

from .config import ComparisonConfig
from .record import Row
from .runner import Runner, finish, prepare


Timed = tuple[AbstractStructure, float]
"""A structure and how long it took to build [s]."""

LONG = 20.0
"""Repeats of a run take this long at most, or are one [s]."""


class Baseline(NamedTuple):
    """The full volume's explicit loop at its own stable step, timed in this process."""

    solution: Solution
    time: Timing
    row: Row


@contextmanager
def without_structure_cache() -> Iterator[None]:
    """Structures are built, not read back: their build time is part of the result."""
    before = os.environ.get("JAXTHERMO_CACHE")
    os.environ["JAXTHERMO_CACHE"] = "off"
    try:
        yield
    finally:
        if before is None:
            del os.environ["JAXTHERMO_CACHE"]
        else:
            os.environ["JAXTHERMO_CACHE"] = before


def timed_call(call: Callable[[], Any]) -> tuple[Any, float]:
    """What a call gives, and how long it took [s]."""
    clock = time.perf_counter()
    made = jax.block_until_ready(call())
    return made, time.perf_counter() - clock


def run_timed(scene: Scene, config: ComparisonConfig) -> tuple[Solution, Timing, Row]:
    """A run at the scene's own largest stable step, timed warm.

    The time is that of the compiled loop with the surface map at the saved times.
    """
    span = config.time
    runner, setup = timed_call(lambda: prepare(scene, span.end, span.save_times))
    loop, compiling = timed_call(runner.compile)
    seen, spans = repeated(loop, config.repeats)
    timing = Timing(statistics.median(spans), min(spans), max(spans))
    solution = runner.solution(seen)
    cost = _cost(runner, solution, timing, setup, compiling)
    return solution, timing, {**cost, "timed_runs": len(spans)}


def repeated(
    call: Callable[[], Any], repeats: int, most: float = LONG
) -> tuple[Any, list[float]]:
    """What a call gives, and how long it took each time [s].

    Args:
        call: gives the same each time; the first time it warms up and does not count.
        repeats: wanted of it.
        most: seconds for all repeats. Where it is too little for them there are fewer,
            one at least, and the first time counts too: a long call hides its warm-up.
    """
    seen, first = timed_call(call)
    fitting = max(1, int(most / first))
    if fitting >= repeats:
        return seen, [timed_call(call)[1] for _ in range(repeats)]
    return seen, [first, *(timed_call(call)[1] for _ in range(fitting))]


def _cost(
    runner: Runner, solution: Solution, timing: Timing, setup: float, compiling: float
) -> Row:
    receipt = runner.plan.compiled.receipt
    return {
        "nodes": receipt.nodes,
        "links": receipt.links,
        "capacity_ratio": receipt.capacity_ratios[0],
        "held_bytes": runner.held_bytes,
        "peak_bytes_forecast": receipt.memory_bytes,
        "steps": solution.run.steps,
        "stable_step_s": _finite(solution.run.stable_step),
        "setup_time_s": setup,
        "compile_time_s": compiling,
        "run_time_s": timing._asdict(),
        "sun_J": _last(solution.energy.mechanisms.get("sun")),
        "energy_residual": float(np.abs(solution.energy.residual_relative).max()),
    }


def _finite(value: float | None) -> float | None:
    """JSON has no infinity."""
    return value if value is not None and np.isfinite(value) else None


def _last(heat: Float[Array | np.ndarray, " t"] | None) -> float:
    """Heat brought by the end; none by a sun that the body does not see."""
    return 0.0 if heat is None else float(heat[-1])


def error_row(solution: AnySolution, reference: AnySolution) -> Row:
    """The error against the reference, at each saved time and at its worst."""
    error = surface_error(solution, reference)
    series = {
        name: np.asarray(getattr(error, name), float).tolist()
        for name in ("times", "rms_percent", "p99_percent", "max_percent", "rms_kelvin")
    }
    worst = {f"worst_{k}": max(v) for k, v in series.items() if k != "times"}
    return {**series, **worst}


def ratio_row(structure: Timing, full: Timing) -> Row:
    """How many times less time a structure takes; the ends of what was seen of both."""
    return {
        "median": full.median / structure.median,
        "least": full.fastest / structure.slowest,
        "most": full.slowest / structure.fastest,
    }


def build_timed(make: Callable[[], AbstractStructure]) -> Timed:
    """A structure, built anew even if it is in the cache."""
    with without_structure_cache():
        clock = time.perf_counter()
        structure = make()
        return structure, time.perf_counter() - clock


def run_reference(
    scene: Scene, config: ComparisonConfig, stable_step: float | None
) -> Solution:
    """The full volume, at the config's share of its stable step [s]."""
    span = config.time
    step = None if stable_step is None else config.reference_step * stable_step
    return finish(prepare(scene, span.end, span.save_times, step))
