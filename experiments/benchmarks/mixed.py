"""Cost of each mechanism in a scene of everything, against conduction alone.

In one run, in turn: every body's own conduction, the whole scene, and the scene without
each of its mechanisms. A mechanism's share is what the scene is faster without it.
Besides, one body whose terms all do nothing against the bare loop of its network:
these two alone, in turn, over more steps and more often, for they hardly differ; their
temperatures must be the same.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.config.loader import load_config
from jaxthermo.console.terminal import open_console
from jaxthermo.integrate.explicit import EulerStepper
from jaxthermo.integrate.ledger import empty_ledger
from jaxthermo.integrate.run.step_loop import Span, advance
from jaxthermo.integrate.stepper import RunState
from jaxthermo.physics.windows import Window
from jaxthermo.report.numbers import with_range
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.scene.compile.program import Compiled
from jaxthermo.timing import Spans, interleaved, ratio_of, timed_call

from ..harness.agreement import largest_difference
from ..harness.measurement import MeasuredResult, Measurement, compared, plain_rows
from ..harness.present import show, table_of
from .loops import per_item
from .steps import euler_steps


QUICK = {"config": Path("configs/scenes/mixed-small.yaml"), "repeats": 2}

_CONFIG = Path("configs/scenes/mixed.yaml")
_STEPS = 100
# Steps of one body with idle terms and of its bare loop, about a third of a second, and
# repeats of these two over those of the others.
_MORE_STEPS = 500
_MORE_REPEATS = 4
_MAX_DIFFERENCE = 1e-3
"""Largest difference of their temperatures [K]."""


class Runner(NamedTuple):
    """A call that takes steps of a scene, and what it was compiled to."""

    call: Callable[[], Any]
    steps: int
    compiled: Compiled


@eqx.filter_jit
def _steps(program, state: RunState, dt, steps) -> RunState:
    window = Window(jnp.zeros(2, dt.dtype), dt * steps.astype(dt.dtype))
    span = Span(window, dt=dt, steps=steps)
    return advance(EulerStepper(), program, state, span)


def scene_runner(scene: jt.Scene, dt: float, steps: int = _STEPS) -> Runner:
    """Steps of `dt` [s] of a scene, with all that acts in it and the ledger."""
    compiled = compile_scene(scene, 1, dt * steps)
    program = compiled.program
    dtype = compiled.start[0].dtype
    state = RunState(compiled.state, empty_ledger(len(program.entries), dtype))
    # Arrays: a Python number would be compiled into the loop.
    step = jnp.asarray(dt, dtype)
    count = jnp.asarray(steps)
    return Runner(lambda: _steps(program, state, step, count), steps, compiled)


def _bare(body: jt.Body, dt: float, steps: int) -> Runner:
    # Steps of a network alone, without scene, terms or ledger.
    compiled = compile_scene(jt.Scene((body,)))
    network = compiled.program.bodies[0].network
    state = compiled.state[0]
    step = jnp.asarray(dt, state.dtype)
    count = jnp.int32(steps)
    return Runner(lambda: euler_steps(network, state, step, count), steps, compiled)


def step_spans(runners: Mapping[str, Runner], repeats: int) -> Spans:
    """Wall times of a step of each [s], measured in turn."""
    calls = {name: runner.call for name, runner in runners.items()}
    steps = {name: runner.steps for name, runner in runners.items()}
    return per_item(interleaved(calls, repeats, there_and_back=True), steps)


def _runners(scene: jt.Scene, dt: float) -> dict[str, Runner]:
    scenes = {"scene": scene}
    for n, body in enumerate(scene.bodies):
        scenes[f"conduction of body {n}"] = jt.Scene((body,), dtype=scene.dtype)
    for term in scene.terms:
        remaining_terms = tuple(
            kept_term for kept_term in scene.terms if kept_term is not term
        )
        scenes[f"without {term.name}"] = jt.Scene(
            scene.bodies, remaining_terms, scene.dtype
        )
    return {
        name: scene_runner(runner_scene, dt) for name, runner_scene in scenes.items()
    }


def _idle_runners(scene: jt.Scene, dt: float) -> dict[str, Runner]:
    # Terms that do nothing, so that only what they add to the loop is measured.
    idle = (
        jt.Sun((0.0, 0.0, -1.0), 0.0),
        jt.Wind((0.0, 0.0, 0.0), 300.0),
        jt.Contact(100.0),
    )
    first = scene.bodies[0]
    with_idle = jt.Scene((first,), idle, scene.dtype)
    with_terms = scene_runner(with_idle, dt, _MORE_STEPS)
    bare = _bare(first, dt, _MORE_STEPS)
    largest_difference(
        f"states after {_MORE_STEPS} steps",
        {"bare loop": bare.call(), "idle terms": with_terms.call().theta[0]},
        tolerance=_MAX_DIFFERENCE,
        unit="K",
    )
    return {"one body, idle terms": with_terms, "bare loop": bare}


class _Costs(TypedDict):
    """Shares of the mechanisms, ratios with their spread, and times of a step [ms]."""

    over_conduction: dict[str, float]
    shares: dict[str, float]
    idle_over_bare: dict[str, float]
    step_ms: dict[str, float]


class _Result(_Costs, MeasuredResult):
    steps: int
    dt_s: float
    build_s: float
    set_up_s: float
    nodes: int
    fragments: int
    step_s: Spans


def run(
    folder: Path, config: Path = _CONFIG, height: int | None = None, repeats: int = 5
) -> _Result:
    """Times, ratios with their spread, and shares; `height` in voxels."""
    overrides = ()
    if height is not None:
        count = len(load_config(config).bodies)
        overrides = tuple(f"bodies.{n}.voxels_high={height}" for n in range(count))
    scene, built = timed_call(lambda: load_config(config, overrides).build())
    compiled, set_up = timed_call(lambda: compile_scene(scene, 1, 1.0))
    dt = float(compiled.stable_step)
    times = step_spans(_runners(scene, dt), repeats)
    times |= step_spans(_idle_runners(scene, dt), _MORE_REPEATS * repeats)
    results = _results(scene, times)
    _show(scene, results=results, built=built, set_up=set_up)
    return {
        **results,
        "steps": _STEPS,
        "dt_s": dt,
        "build_s": built,
        "set_up_s": set_up,
        "nodes": compiled.receipt.nodes,
        "fragments": compiled.receipt.fragments,
        "step_s": times,
        "measurements": plain_rows(_measurements(scene, times)),
    }


def _conduction(scene: jt.Scene, times: Spans) -> np.ndarray:
    """Sum of the bodies' own steps [s]."""
    names = [f"conduction of body {n}" for n in range(len(scene.bodies))]
    return np.sum([times[name] for name in names], axis=0)


def _measurements(scene: jt.Scene, times: Spans) -> list[Measurement]:
    terms = ", ".join(term.name for term in scene.terms)
    return [
        *compared(
            name="step of a scene of everything",
            ours=times["scene"],
            peers={"conduction of its bodies": _conduction(scene, times).tolist()},
            overhead=True,
            note=f"{len(scene.bodies)} bodies; {terms}",
        ),
        *compared(
            name="step of a body with idle terms",
            ours=times["one body, idle terms"],
            peers={"bare loop of its network": times["bare loop"]},
            overhead=True,
        ),
    ]


def _results(scene: jt.Scene, times: Spans) -> _Costs:
    def ratio(above: np.ndarray, below: np.ndarray) -> dict[str, float]:
        return ratio_of(above, below)._asdict()

    arrays = {name: np.array(term_spans) for name, term_spans in times.items()}
    conduction = _conduction(scene, times)
    scene_spans = arrays["scene"]
    shares = {
        term.name: float(np.median(1 - arrays[f"without {term.name}"] / scene_spans))
        for term in scene.terms
    }
    return {
        "over_conduction": ratio(scene_spans, conduction),
        "shares": {"conduction": float(np.median(conduction / scene_spans)), **shares},
        "idle_over_bare": ratio(arrays["one body, idle terms"], arrays["bare loop"]),
        "step_ms": {
            name: 1e3 * float(np.median(term_spans))
            for name, term_spans in arrays.items()
        },
    }


def _show(scene: jt.Scene, results: _Costs, built: float, set_up: float) -> None:
    percent = {name: f"{100 * x:.0f} %" for name, x in results["shares"].items()}
    columns = [
        ("", "{name}"),
        ("ms a step", "{ms:.3f}"),
        (
            "share of the scene's time",
            lambda row: percent.get(row["name"].removeprefix("without "), ""),
        ),
    ]
    rows = [{"name": name, "ms": step} for name, step in results["step_ms"].items()]
    title = f"{len(scene.bodies)} bodies, {_STEPS} steps, this host"
    show(table_of(rows, columns, title))
    console = open_console()
    for comparison, ratio in (
        ("the scene over the sum of conduction", results["over_conduction"]),
        ("one body with idle terms over the bare loop", results["idle_over_bare"]),
    ):
        console.print(f"{comparison}: {with_range(*ratio.values())}")
    console.print(f"built in {built:.1f} s, compiled and set up in {set_up:.1f} s")
