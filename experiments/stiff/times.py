"""Steps that do not divide the end, save times apart, no time at all (S22)."""

from collections.abc import Iterator

import numpy as np

import jaxthermo as jt

from .bodies import AEROGEL, COLD, DIAMOND, HOT
from .case import Case, Check, Row, refusal
from .contrasts import insulated
from .methods import STEPS, damping
from .solved import Method, row_of, run_nodes, stable_step


def landings() -> Iterator[Row]:
    """S22."""
    scene = insulated("laminate", (AEROGEL, DIAMOND), "float64")
    for method in damping(stable_step(scene)):
        yield _landed(scene, method)
        yield _no_time(scene, method.name, method.solver)
    for solver in (jt.ForwardEuler, jt.SuperTimeStepping, *_IMPLICIT):
        given = solver(dt=0.0)
        call = lambda s=given: jt.simulate(scene, 1.0, solver=s)
        yield refusal("dt = 0", call, "is no step", solver.__name__, scene.dtype)


def _landed(scene: jt.Scene, method: Method) -> Row:
    """Three save times, none of them a multiple of the step."""
    end = method.end * float(np.sqrt(2.0)) / 1.5
    saves = [end / np.pi, end / 2, end]
    ran = run_nodes(scene, method.solver, end, saves)
    late = float(np.abs(np.asarray(ran.solution.times) / saves - 1).max())
    run, given = ran.solution.run, method.solver.dt
    checks = [Check("off the save times", late, float(np.finfo(float).eps))]
    if given is not None:
        checks.append(Check("step over its own", (run.dt or 0.0) / given, 1 + 1e-9))
    what, bounds, more = "end no multiple of dt", (COLD, HOT), tuple(checks)
    row = row_of(what, scene.dtype, method, ran, bounds, more=more)
    return row._replace(seen=f"{run.steps} steps to 3 landings")


_IMPLICIT = (jt.BackwardEuler, jt.CrankNicolson, jt.TRBDF2)


def _no_time(scene: jt.Scene, name: str, solver) -> Row:
    run = jt.simulate(scene, 0.0, solver=solver)
    surface = np.asarray(run.surface_temperature, float)[0]
    grid = scene.bodies[0].structure.grid
    x = grid.lattice.centres(grid.fragment_voxel)[:, 0]
    off = float(np.abs(surface - np.where(x < 0, HOT, COLD)).max())
    check = Check("moved", off, 0.0)
    return Row("t1 = 0", name, scene.dtype, checks=(check,))


CASES = (
    Case(
        "S22",
        f"an end that {STEPS} steps do not reach, and an end at 0",
        "lands on every save time exactly; no time changes nothing, bit by bit; dt = 0 "
        "is refused",
        "equal steps between landings",
        landings,
    ),
)
