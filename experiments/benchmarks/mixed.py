"""Cost of each mechanism in a scene of everything, against conduction alone.

In one run, in turn: every body's own conduction, the whole scene, and the scene without
each of its mechanisms. A mechanism's share is what the scene is faster without it.
Besides, one body whose terms all do nothing against the bare loop of its network:
these two alone, in turn, over more steps and more often, for they hardly differ.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

import jaxthermo as jt
from jaxthermo.config.loader import load_config
from jaxthermo.integrate.explicit.euler import EulerStepper
from jaxthermo.integrate.run.ledger import empty_ledger
from jaxthermo.integrate.stepper import RunState, advance
from jaxthermo.report.table import Table
from jaxthermo.scene.compile.compile import compile_scene

from ..harness.timing import Spans, interleaved, ratio_of, ratio_text


CONFIG = Path("configs/scenes/mixed.yaml")
STEPS = 100
MORE_STEPS = 500
"""Steps of one body with idle terms and of its bare loop, about a third of a
second."""
MORE_REPEATS = 4
"""Repeats of these two measurements, over those of the others."""


class Runner(NamedTuple):
    """A call that takes some steps."""

    call: Callable[[], Any]
    steps: int


@eqx.filter_jit
def _steps(program, state: RunState, dt, steps) -> RunState:
    start = jnp.zeros_like(dt)
    return advance(EulerStepper(), program, state, start, dt, steps)


def _runner(scene: jt.Scene, dt: float, steps: int = STEPS) -> Runner:
    """Steps of a scene."""
    compiled = compile_scene(scene, 1, dt * steps)
    program = compiled.program
    state = RunState(
        compiled.state, empty_ledger(len(program.entries), compiled.state[0].dtype)
    )
    step = jnp.asarray(dt, compiled.state[0].dtype)
    count = jnp.asarray(steps)
    return Runner(
        lambda: jax.block_until_ready(_steps(program, state, step, count)), steps
    )


def _bare(body: jt.Body, dt: float, steps: int) -> Runner:
    """Steps of a network alone, without scene, terms or ledger."""
    compiled = compile_scene(jt.Scene((body,)))
    network, state = compiled.program.bodies[0].network, compiled.state[0]
    step = jnp.asarray(dt, state.dtype)

    @eqx.filter_jit
    def loop(network, state):
        twice = lambda _, s: network.euler_step(network.euler_step(s, step), step)
        return jax.lax.fori_loop(0, steps // 2, twice, state)

    return Runner(lambda: jax.block_until_ready(loop(network, state)), steps)


def _measure(runners: dict[str, Runner], repeats: int) -> Spans:
    """Wall times of a step [s]; in turn, there and back."""
    calls = {name: runner.call for name, runner in runners.items()}
    spans = interleaved(calls, repeats, there_and_back=True)
    return {n: [t / runners[n].steps for t in each] for n, each in spans.items()}


def _runners(scene: jt.Scene, dt: float) -> dict[str, Runner]:
    """The scene, its bodies alone, and the scene without each term."""
    bodies = {
        f"conduction of body {n}": _runner(jt.Scene((body,), dtype=scene.dtype), dt)
        for n, body in enumerate(scene.bodies)
    }
    without = {
        f"without {term.name}": _runner(
            jt.Scene(
                scene.bodies,
                tuple(other for other in scene.terms if other is not term),
                dtype=scene.dtype,
            ),
            dt,
        )
        for term in scene.terms
    }
    return {"scene": _runner(scene, dt), **bodies, **without}


def _idle_runners(scene: jt.Scene, dt: float) -> dict[str, Runner]:
    """The first body with terms that do nothing, and its network alone."""
    idle = (
        jt.Sun((0.0, 0.0, -1.0), 0.0),
        jt.Wind((0.0, 0.0, 0.0), 300.0),
        jt.Contact(100.0),
    )
    first = scene.bodies[0]
    with_idle = jt.Scene((first,), idle, scene.dtype)
    return {
        "one body, idle terms": _runner(with_idle, dt, MORE_STEPS),
        "bare loop": _bare(first, dt, MORE_STEPS),
    }


def run(
    folder: Path, config: Path = CONFIG, height: int | None = None, repeats: int = 5
) -> dict[str, Any]:
    """Times, ratios with their spread, and shares."""
    del folder
    overrides = ()
    if height is not None:
        count = len(load_config(config).bodies)
        overrides = tuple(f"bodies.{n}.voxels_high={height}" for n in range(count))
    clock = time.perf_counter()
    scene = load_config(config, overrides).build()
    built = time.perf_counter() - clock
    clock = time.perf_counter()
    compiled = compile_scene(scene, 1, 1.0)
    set_up = time.perf_counter() - clock
    dt = float(compiled.stable_step)
    times = _measure(_runners(scene, dt), repeats)
    times |= _measure(_idle_runners(scene, dt), MORE_REPEATS * repeats)
    found = _results(scene, times)
    _show(scene, found, built, set_up)
    return {
        **found,
        "steps": STEPS,
        "dt_s": dt,
        "build_s": built,
        "set_up_s": set_up,
        "nodes": compiled.receipt.nodes,
        "fragments": compiled.receipt.fragments,
        "step_s": times,
    }


def _ratio(above: np.ndarray, below: np.ndarray) -> dict[str, float]:
    return dict(zip(("median", "low", "high"), ratio_of(above, below), strict=True))


def _results(scene: jt.Scene, times: Spans) -> dict[str, Any]:
    arrays = {name: np.array(each) for name, each in times.items()}
    conduction = sum(
        arrays[f"conduction of body {n}"] for n in range(len(scene.bodies))
    )
    whole = arrays["scene"]
    shares = {
        term.name: float(np.median(1 - arrays[f"without {term.name}"] / whole))
        for term in scene.terms
    }
    return {
        "over_conduction": _ratio(whole, np.asarray(conduction)),
        "shares": {"conduction": float(np.median(conduction / whole)), **shares},
        "idle_over_bare": _ratio(arrays["one body, idle terms"], arrays["bare loop"]),
        "step_ms": {
            name: 1e3 * float(np.median(each)) for name, each in arrays.items()
        },
    }


def _show(scene: jt.Scene, found: dict[str, Any], built: float, set_up: float) -> None:
    lines = []
    for name, step in found["step_ms"].items():
        share = found["shares"].get(name.removeprefix("without "))
        text = "" if share is None else f"{100 * share:.0f} %"
        lines.append([name, f"{step:.3f}", text])
    columns = ("", "ms a step", "share of the scene's time")
    table = Table(
        columns, lines, f"{len(scene.bodies)} bodies, {STEPS} steps, this host"
    )
    console = Console()
    console.print(table.rich())
    for what, key in (
        ("the scene over the sum of conduction", "over_conduction"),
        ("one body with idle terms over the bare loop", "idle_over_bare"),
    ):
        console.print(f"{what}: {ratio_text([*found[key].values()])}")
    console.print(f"built in {built:.1f} s, compiled and set up in {set_up:.1f} s")
