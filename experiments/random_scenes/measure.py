"""Energy, bounds and stated error in time of a scene that was drawn."""

import warnings
from dataclasses import replace
from typing import TypedDict

import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.choices import Dtype
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.run.simulate import run_plan
from jaxthermo.integrate.run.solution import result_name
from jaxthermo.integrate.run.time_error import of_pass
from jaxthermo.integrate.solvers import AbstractSolver

from .draw import Drawn


class RunRow(TypedDict):
    """One run of a scene."""

    solver: str
    steps: int
    result: str
    energy_residual: float
    """Largest |stored heat - heat of all mechanisms| over the heat that moved [-]."""
    overshoot: float
    """Largest excess over the bounds, over their range [-]."""
    warnings: list[str]


class SceneRow(TypedDict):
    """A scene with its runs: that of the default solver, and that of another one."""

    form: str
    dtype: Dtype
    runs: list[RunRow]
    stated_error: float
    """Error in time that the run by default states [K]."""
    true_error: float
    """Largest difference of a surface temperature from that of quarter steps [K]."""


def measure(drawn: Drawn) -> SceneRow:
    """Run a scene by default and by its solver, and measure its error in time."""
    scene = drawn.scene
    default_run, default = _run(drawn, None, drawn.save_at)
    by_solver, _ = _run(drawn, drawn.solver, (drawn.solver_end,))
    stated = default.run.time_error
    assert stated is not None
    difference = np.asarray(default.surface_temperature) - _by_quarter_steps(
        drawn, default
    )
    return {
        "form": drawn.form,
        "dtype": scene.dtype,
        "runs": [default_run, by_solver],
        "stated_error": stated,
        "true_error": float(np.abs(difference).max()),
    }


def _run(
    drawn: Drawn, solver: AbstractSolver | None, save_at: tuple[float, ...]
) -> tuple[RunRow, jt.Solution]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        solution = jt.simulate(
            drawn.scene, save_at[-1], save_at, solver=solver, throw=False
        )
    lowest, highest = drawn.bounds
    surface = np.asarray(solution.surface_temperature, float)
    excess = np.max([0.0, surface.max() - highest, lowest - surface.min()])
    residual = np.abs(np.asarray(solution.energy.residual_relative, float))
    row: RunRow = {
        "solver": solution.run.solver if solver else f"default: {solution.run.solver}",
        "steps": solution.run.steps,
        "result": result_name(solution.result),
        "energy_residual": float(residual.max()),
        "overshoot": float(excess / (highest - lowest)),
        "warnings": [str(warning.message) for warning in caught],
    }
    return row, solution


def _by_quarter_steps(drawn: Drawn, solution: jt.Solution) -> np.ndarray:
    """Surface temperatures in float64, by steps a quarter as long as a run's [K]."""
    precise = replace(drawn.scene, dtype="float64")
    with precision("float64"):
        plan = plan_run(
            precise,
            t1=drawn.save_at[-1],
            save_at=drawn.save_at,
            solver=None,
            control_error=True,
        )
        number = round(np.log2(solution.run.steps / plan.steps))
        finest = run_plan(of_pass(plan, number + 2))
    return np.asarray(finest.surface_temperature, float)
