"""One row: a structure under a load, its cost, its error and its frames."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple
from unittest import mock

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from skimage.metrics import structural_similarity

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.config.camera_framing import build_camera
from jaxthermo.config.schema.image import PinholeConfig
from jaxthermo.image.render import draw
from jaxthermo.image.view import View, compute_view
from jaxthermo.integrate.run.plan import (
    Plan,
    initial_state,
    plan_run,
    save_intervals,
    step_table,
)
from jaxthermo.integrate.run.simulate import make_solution, take_steps
from jaxthermo.integrate.run.solution import Observation
from jaxthermo.integrate.surface_error import AnySolution, error_span, surface_error
from jaxthermo.scene.scene import SolvedSurface
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.timing import Timing

from ..harness.record import Row
from ..harness.timing import timed_call, timing_of
from .config import ComparisonConfig


# Takes every step from the start, and reads the surface at the saved times.
_Loop = Callable[[], Observation]


@dataclass(frozen=True, eq=False)
class _Runner:
    # All that comes before the first step is done; `compile` builds the loop of a run.
    scene: jt.Scene
    plan: Plan
    compile: Callable[[], _Loop]

    @property
    def held_bytes(self) -> int:
        # Arrays of the compiled scene and of its state.
        arrays = (self.plan.compiled.program, self.plan.compiled.state)
        leaves = (x for x in jax.tree.leaves(arrays) if isinstance(x, jax.Array))
        return sum(x.nbytes for x in leaves)

    def solution(self, seen: Observation) -> jt.Solution:
        with precision(self.scene.dtype):
            found = make_solution(self.plan, seen)
        if found.result != jt.RESULTS.successful:
            # Not finite, or below 0 K: a row that is refused, not one with an error.
            raise jt.InputError(jt.RESULTS[found.result])
        return found


def prepare(
    scene: jt.Scene, t1: float, save_at: tuple[float, ...], dt: float | None = None
) -> _Runner:
    """Compile a scene and lay out steps of `dt` [s], the stable one by default."""
    with precision(scene.dtype):
        todo = plan_run(scene, t1, save_at, jt.ForwardEuler(dt=dt))
        program, state = todo.compiled.program, initial_state(todo)
        layout = step_table(todo, save_intervals(todo.intervals))
        given = todo.stepper, program, state, layout
        jax.block_until_ready(given[1:])

    def compile_loop() -> _Loop:
        # A function of its own, so that nothing compiled before is used again.
        own = lambda *parts: take_steps(*parts)
        with precision(scene.dtype):
            made = eqx.filter_jit(own).lower(*given).compile()

        def loop() -> Observation:
            with precision(scene.dtype):
                return made(*given)[1]

        return loop

    return _Runner(scene, todo, compile_loop)


def finish(runner: _Runner) -> jt.Solution:
    """Run once, untimed."""
    return runner.solution(jax.block_until_ready(runner.compile()()))


def surface_at(solution: AnySolution, time: float) -> Float[np.ndarray, " s"]:
    """Temperatures of all fragments at a saved time [K]."""
    index = int(np.abs(np.asarray(solution.times) - time).argmin())
    return np.asarray(solution.surface_temperature[index], np.float32)


Timed = tuple[AbstractStructure, float]
"""A structure and how long it took to build [s]."""

# Repeats of a run take this long at most, or are one [s].
MAX_REPEATED_SECONDS = 20.0


class Baseline(NamedTuple):
    """The full volume's explicit loop at its own stable step, timed in this process."""

    solution: jt.Solution
    time: Timing
    row: Row


def run_timed(
    scene: jt.Scene, config: ComparisonConfig
) -> tuple[jt.Solution, Timing, Row]:
    """A run at the scene's own largest stable step, timed warm.

    The time is that of the compiled loop with the surface map at the saved times.
    """
    span = config.time
    runner, setup = timed_call(lambda: prepare(scene, span.end, span.save_times))
    loop, compiling = timed_call(runner.compile)
    seen, spans = _repeated(loop, config.repeats)
    timing, solution = timing_of(spans), runner.solution(seen)
    receipt, stable = runner.plan.compiled.receipt, solution.run.stable_step
    # A sun that the body does not see is no term of the scene.
    sun = solution.energy.mechanisms.get("sun", (0.0,))
    row = {
        "nodes": receipt.nodes,
        "links": receipt.links,
        "capacity_ratio": receipt.capacity_ratios[0],
        "held_bytes": runner.held_bytes,
        "peak_bytes_forecast": receipt.memory_bytes,
        "steps": solution.run.steps,
        # JSON has no infinity.
        "stable_step_s": stable if stable and np.isfinite(stable) else None,
        "setup_time_s": setup,
        "compile_time_s": compiling,
        "run_time_s": timing._asdict(),
        "sun_J": float(sun[-1]),
        "energy_residual": float(np.abs(solution.energy.residual_relative).max()),
        "timed_runs": len(spans),
    }
    return solution, timing, row


def _repeated(
    call: Callable[[], Any], repeats: int, max_seconds: float = MAX_REPEATED_SECONDS
) -> tuple[Any, list[float]]:
    """The result of a call, and its wall time of each repeat [s]."""
    # The first call warms up and does not count, unless all repeats would take
    # more than `max_seconds`: then there are fewer, and a long call hides it.
    seen, first = timed_call(call)
    fitting = max(1, int(max_seconds / first))
    if fitting >= repeats:
        return seen, [timed_call(call)[1] for _ in range(repeats)]
    return seen, [first, *(timed_call(call)[1] for _ in range(fitting))]


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
    """Time of the full volume over that of a structure, with the extremes of both."""
    return {
        "median": full.median / structure.median,
        "least": full.fastest / structure.slowest,
        "most": full.slowest / structure.fastest,
    }


def build_timed(make: Callable[[], AbstractStructure]) -> Timed:
    """A structure, built even if it is in the cache."""
    # The build time is part of the result. The cache reads its folder at every call.
    with mock.patch.dict(os.environ, {"JAXTHERMO_CACHE": "off"}):
        return timed_call(make)


class Scenery(NamedTuple):
    """One camera on one body, for all its structures."""

    view: View
    surface: SolvedSurface
    body: Bool[np.ndarray, "h w"]
    """Pixels that show the body."""

    def frame(self, temperature: Float[np.ndarray, " s"]) -> Float[np.ndarray, "h w"]:
        """The surface's temperature in every pixel [K]."""
        values = jnp.asarray(temperature)
        # What it reflects, and when, does not change its temperature.
        nothing, time = jnp.zeros_like(values), jnp.zeros((), values.dtype)
        image = draw(self.view, (self.surface,), (), values, nothing, time)
        return np.asarray(image.temperature)


def scenery(camera: PinholeConfig, surface: SolvedSurface) -> Scenery:
    """The camera of the config, looking at the body."""
    framed = build_camera(camera, surface.geometry.triangles)
    view = compute_view((surface,), (), framed)
    body = np.zeros(view.camera.size[::-1], bool)
    body.reshape(-1)[view.pixel] = True
    return Scenery(view, surface, body)


def frame_error(scene: Scenery, solution: AnySolution, reference: AnySolution) -> Row:
    """RMS [K] and SSIM over the body's pixels at each saved time after 0.

    The data range of the SSIM is what the surface error is divided by at that time.
    """
    later = np.asarray(reference.times) > 0
    found = np.asarray(solution.surface_temperature)[later]
    expected = np.asarray(reference.surface_temperature)[later]
    spans = np.asarray(error_span(jnp.asarray(expected)), float)
    rms, ssim = [], []
    for one, other, span in zip(found, expected, spans.tolist(), strict=True):
        images = [scene.frame(one), scene.frame(other)]
        square = (images[0] - images[1])[scene.body].astype(float) ** 2
        rms.append(float(np.sqrt(square.mean())))
        # Differences from the coldest pixel keep float32's digits.
        level = float(images[1].min())
        shifted = [np.asarray(image, float) - level for image in images]
        every = structural_similarity(*shifted, data_range=span, full=True)[-1]
        # Over the body's pixels: the background is the same in all and would flatter.
        ssim.append(float(np.asarray(every)[scene.body].mean()))
    return {
        "rms_kelvin": rms,
        "ssim": ssim,
        "ssim_data_range_K": spans.tolist(),
        "worst_rms_kelvin": max(rms),
        "worst_ssim": min(ssim),
    }
