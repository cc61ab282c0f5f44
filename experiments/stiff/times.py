"""Steps that do not divide the end, save times apart, no time at all (S22)."""

from collections.abc import Iterator

import numpy as np

import jaxthermo as jt

from .bodies import AEROGEL, COLD, DIAMOND, HOT
from .case import Case, Check, Row, refusal
from .contrasts import insulated
from .methods import STEPS, every_solver
from .solved import row_of, run_nodes, stable_step


def landings() -> Iterator[Row]:
    """S22."""
    for dtype in ("float64", "float32"):
        scene = insulated("laminate", (AEROGEL, DIAMOND), dtype)
        for method in every_solver(stable_step(scene)):
            end = method.end * np.sqrt(2.0) / 1.5
            saves = [end / np.pi, end / 2, end]
            ran = run_nodes(scene, method.solver, end, saves)
            times = np.asarray(ran.solution.times, float)
            late = float(np.abs(times / saves - 1).max())
            most = 1.0 if method.solver.dt is None else float(method.solver.dt)
            run = ran.solution.run
            checks = (
                Check("off the save times", late, float(np.finfo(dtype).eps)),
                Check("step over its own", (run.dt or 0.0) / most, 1 + 1e-9)
                if method.solver.dt is not None
                else Check("steps", run.steps, np.inf, 1),
            )
            what = "end no multiple of dt"
            row = row_of(what, dtype, method, ran, (COLD, HOT), more=checks)
            yield row._replace(seen=f"{run.steps} steps to 3 landings")
            yield _no_time(scene, method.name, method.solver)
    for solver in (jt.ForwardEuler, jt.SuperTimeStepping, *_IMPLICIT):
        given = solver(dt=0.0)
        call = lambda s=given: jt.simulate(scene, 1.0, solver=s)
        yield refusal("dt = 0", call, "is no step", solver.__name__, scene.dtype)


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
