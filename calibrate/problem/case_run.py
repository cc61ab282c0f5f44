"""The run of a case of a fit: steps that its file gives, or its error requires."""

from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.integrate.explicit import MIN_STAGES, stage_count
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.solvers import (
    TRBDF2,
    AbstractSolver,
    ErrorControl,
    SuperTimeStepping,
)
from jaxthermo.scene.scene import Scene


_CONTROL = ErrorControl(relative_error=1e-4)
"""Error in time of runs whose solver is not given.

A fit makes up for an error of the steps by wrong values: it has to be small compared
with that of the data.
"""

_STIFFER = 2.0
"""Stable step at the start of a fit over that up to which its steps stay."""


def case_run(config: SceneConfig, scene: Scene) -> ParametricRun:
    """Run of a case, by the solver of its file or with a small error in time."""
    solver = config.solver.build()
    if solver is None:
        solver = _CONTROL
    if isinstance(solver, ErrorControl):
        solver = _accurate_solver(solver, config, scene)
    return ParametricRun(config.time.save_times, solver)


def _accurate_solver(
    control: ErrorControl, config: SceneConfig, scene: Scene
) -> AbstractSolver:
    """Solver with as many steps as the error in time of a scene requires.

    A run with traced values cannot be repeated until its error holds. The stable step
    may be as long as the time in which a body warms: explicit steps of that length are
    stable, and not accurate.
    """
    saves = config.time.save_times
    run = simulate(scene, config.time.last, saves, solver=control, throw=False).run
    dt = config.time.last / run.steps
    if run.solver == TRBDF2.__name__ or run.stable_step is None:
        return TRBDF2(dt=dt)
    stages = stage_count(dt, run.stable_step / _STIFFER)
    return SuperTimeStepping(dt=dt, stages=max(stages, MIN_STAGES))
