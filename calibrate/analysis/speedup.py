"""Measurement of how much faster the fitted structure runs than the full volume."""

import time
from typing import Any

import jax
import numpy as np

from jaxthermo.arrays import precision
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.integrate.run.plan import Plan, plan_run
from jaxthermo.integrate.run.simulate import run_plan
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.scene.scene import Scene

from ..problem.reference import on_every_voxel


_REPEATS = 3
_MAX_REPEATED_SECONDS = 20.0
"""Time of one repeat, beyond which runs are timed once [s]."""


def measure_speed(config: SceneConfig, default: Scene, fitted: Scene) -> dict[str, Any]:
    """Time the compiled loops of a case, with its surface read at the saved times."""
    full = on_every_voxel(config).build()
    end = config.time.end
    saves = config.time.save_times
    solver = config.solver.build()
    with precision(config.dtype):
        plans = {
            "full_volume": plan_run(full, t1=end, save_at=saves, solver=ForwardEuler()),
            "default": plan_run(default, t1=end, save_at=saves, solver=solver),
            "fitted": plan_run(fitted, t1=end, save_at=saves, solver=solver),
        }
        # The first runs compile.
        total = sum(_seconds(planned) for planned in plans.values())
        repeats = _REPEATS if total < _MAX_REPEATED_SECONDS else 1
        spans: dict[str, list[float]] = {name: [] for name in plans}
        # One after the other, so that a slower moment of the machine meets all of them.
        for _ in range(repeats):
            for name, planned in plans.items():
                spans[name].append(_seconds(planned))
    return {
        **_ratios(spans, "fitted"),
        "default": _ratios(spans, "default"),
        "nodes": {n: p.compiled.receipt.nodes for n, p in plans.items()},
        "steps": {n: p.steps for n, p in plans.items()},
        "solver": {n: type(p.solver).__name__ for n, p in plans.items()},
        "run_time_s": spans,
    }


def _ratios(spans: dict[str, list[float]], name: str) -> dict[str, float]:
    ratios = np.array(spans["full_volume"]) / np.array(spans[name])
    summary = {
        "times_faster": np.median(ratios),
        "min": ratios.min(),
        "max": ratios.max(),
    }
    return {key: float(value) for key, value in summary.items()}


def _seconds(planned: Plan) -> float:
    clock = time.perf_counter()
    jax.block_until_ready(run_plan(planned).surface_temperature)
    return time.perf_counter() - clock
