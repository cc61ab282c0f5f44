"""Measurement of how much faster the fitted structure runs than the full volume."""

from functools import partial
from typing import Any

from jaxthermo.arrays import precision
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.integrate.run.plan import Plan, initial_state, plan_run
from jaxthermo.integrate.run.simulate import integrate
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.scene.scene import Scene
from jaxthermo.timing import Spans, interleaved, ratio_of, timed_call

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
        calls = {name: partial(_run, planned) for name, planned in plans.items()}
        # The first runs compile.
        total = sum(timed_call(call)[1] for call in calls.values())
        repeats = _REPEATS if total < _MAX_REPEATED_SECONDS else 1
        spans = interleaved(calls, repeats, warm_up=False)
    return {
        **_ratios(spans, "fitted"),
        "default": _ratios(spans, "default"),
        "nodes": {n: p.compiled.receipt.nodes for n, p in plans.items()},
        "steps": {n: p.steps for n, p in plans.items()},
        "solver": {n: type(p.solver).__name__ for n, p in plans.items()},
        "run_time_s": spans,
    }


def _ratios(spans: Spans, name: str) -> dict[str, float]:
    ratio = ratio_of(spans["full_volume"], spans[name])
    return {"times_faster": ratio.median, "min": ratio.low, "max": ratio.high}


def _run(planned: Plan) -> Any:
    return integrate(planned, initial_state(planned))
