"""How much faster the fitted structure runs than the full volume, in one run."""

import time
from typing import Any

import jax
import numpy as np

from jaxthermo.arrays import precision
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.integrate.run.simulate import Plan, plan, run, start
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.scene.scene import Scene

from ..problem.reference import on_every_voxel


REPEATS = 3
LONG = 20.0
"""Seconds of all repeats of a run, or it is timed once."""


def measure_speed(config: SceneConfig, default: Scene, fitted: Scene) -> dict[str, Any]:
    """Times of the compiled loops, in turn, with surfaces read at the saved times.

    The full volume takes its stable steps, the others what the config says.

    Args:
        config: of the case.
        default: its scene with the values that a fit started from.
        fitted: with those that were found.
    """
    full = on_every_voxel(config).build()
    end, saves = config.time.end, config.time.save_times
    own = config.solver.build()
    with precision(config.dtype):
        plans = {
            "full_volume": plan(full, end, saves, ForwardEuler()),
            "default": plan(default, end, saves, own),
            "fitted": plan(fitted, end, saves, own),
        }
        spans = {name: [_once(todo)] for name, todo in plans.items()}
        repeats = REPEATS if sum(s[0] for s in spans.values()) < LONG else 1
        spans = {name: [] for name in plans}
        for _ in range(repeats):
            for name, todo in plans.items():
                spans[name].append(_once(todo))
    return {
        **_faster(spans, "fitted"),
        "default": _faster(spans, "default"),
        "nodes": {n: p.compiled.receipt.nodes for n, p in plans.items()},
        "steps": {n: p.steps for n, p in plans.items()},
        "solver": {n: type(p.solver).__name__ for n, p in plans.items()},
        "run_time_s": spans,
    }


def _faster(spans: dict[str, list[float]], name: str) -> dict[str, float]:
    ratios = np.array(spans["full_volume"]) / np.array(spans[name])
    return {
        "times_faster": float(np.median(ratios)),
        "least": float(ratios.min()),
        "most": float(ratios.max()),
    }


def _once(todo: Plan) -> float:
    clock = time.perf_counter()
    jax.block_until_ready(run(todo, start(todo)))
    return time.perf_counter() - clock
