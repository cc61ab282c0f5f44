"""Contrasts of materials (S01, S02), steps of any length (S04) and odd ends (S22)."""

from collections.abc import Iterator

import numpy as np

import jaxthermo as jt

from ..harness.case import Bound, Case, Row, refusal
from .bodies import (
    AEROGEL,
    AIR,
    COLD,
    COPPER,
    DIAMOND,
    HOT,
    STEEL,
    block,
    labelled,
    two_halves,
)
from .methods import STEPS, damping, every_solver, too_long
from .solved import Method, judged, row_of, run_nodes, stable_step


CELLS, PITCH = (16, 6, 6), 1e-3
DTYPES = ("float64", "float32")
BOUNDS = (COLD, HOT)
PATTERNS = ("laminate", "checkerboard")
CAPACITIES = {
    "air and copper, rho c 2.9e3": (AIR, COPPER),
    "rho c 1e6": (jt.Material(1.0, 1.0, 1.0), jt.Material(1.0, 1e3, 1e3)),
}
LONGEST = 1e6
"""Stable steps in one."""


def insulated(name: str, pair, dtype: str, temperature=two_halves) -> jt.Scene:
    """A body of two materials that exchanges heat with nothing; one program for all."""
    body = labelled(block(*CELLS, PITCH), name, pair, temperature)
    return jt.Scene((body,), (), dtype=dtype)


def _backward(stable: float, ratio: float) -> Method:
    dt = ratio * stable
    return Method(f"BackwardEuler, {ratio:g} limits", jt.BackwardEuler(dt=dt), 5 * dt)


def through_all(what: str, scene: jt.Scene) -> Iterator[Row]:
    """Every solver, backward Euler up to the longest step, and the refusal."""
    stable = stable_step(scene)
    methods = every_solver(stable)
    methods[3:3] = [_backward(stable, LONGEST)]
    for method in methods:
        yield judged(what, scene, method, BOUNDS)
    yield too_long(what, scene)


def conductivities() -> Iterator[Row]:
    """S01."""
    for name in PATTERNS:
        for dtype in DTYPES:
            yield from through_all(name, insulated(name, (AEROGEL, DIAMOND), dtype))


def capacities() -> Iterator[Row]:
    """S02."""
    for words, pair in CAPACITIES.items():
        for name in PATTERNS:
            for dtype in DTYPES:
                scene = insulated(name, pair, dtype)
                yield from through_all(f"{words}, {name}", scene)


def _long_steps() -> Iterator[Row]:
    """S04."""
    for dtype in DTYPES:
        scene = insulated("uniform", (STEEL, STEEL), dtype)
        stable = stable_step(scene)
        for ratio in (1e-6, 1e-3, 1.0, 1e3, LONGEST):
            yield judged("a step", scene, _backward(stable, ratio), BOUNDS)
            yield judged("a step", scene, _trapezoidal(stable, ratio), BOUNDS)
        # (1 - theta) dt <= C / sum G: positive up to two explicit limits.
        yield judged("a step", scene, _trapezoidal(stable, 2.0, "kept"), BOUNDS)
    for z in (1e-6, 1.0, 1e3, 1e6):
        yield from _factors(z)


def _trapezoidal(stable: float, ratio: float, bounds: str = "reported") -> Method:
    dt, name = ratio * stable, f"CrankNicolson, {ratio:g} limits"
    return Method(name, jt.CrankNicolson(dt=dt), 5 * dt, bounds)


ROOT = float(np.sqrt(2.0))
FACTORS = {
    # Of a mode that decays at z / dt, in one step.
    "BackwardEuler": lambda z: 1 / (1 + z),
    "CrankNicolson": lambda z: (1 - z / 2) / (1 + z / 2),
    "TRBDF2": lambda z: (1 - (ROOT - 1) * z) / (1 + (1 - ROOT / 2) * z) ** 2,
}


def _factors(z: float) -> Iterator[Row]:
    """Amplification of the shortest mode by one step, against its formula."""
    cells = CELLS[0]
    shape = lambda points: np.cos(
        np.pi * (cells - 1) * (points[:, 0] / PITCH + cells / 2) / cells
    )
    start = lambda points: 350.0 + 50.0 * shape(points)
    scene = insulated("uniform", (STEEL, STEEL), "float64", start)
    mode = shape(scene.bodies[0].structure.nodes().centre)
    sine = float(np.sin(np.pi * (cells - 1) / (2 * cells)))
    dt = z / (4 * float(STEEL.diffusivity) / PITCH**2 * sine**2)
    for name, formula in FACTORS.items():
        solver = getattr(jt, name)(dt=dt)
        method = Method(f"{name}, z = {z:g}", solver, dt, "reported")
        ran = run_nodes(scene, solver, dt)
        found = float((ran.nodes[0] - 350.0) @ mode / (50.0 * mode @ mode))
        check = Bound("off the formula", abs(found - formula(z)), 1e-9)
        row = row_of("highest mode", "float64", method, ran, BOUNDS, more=(check,))
        yield row._replace(seen=f"factor {found:.9f}", if_met="pass")


def save_times() -> Iterator[Row]:
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
    checks = [Bound("off the save times", late, float(np.finfo(float).eps))]
    if given is not None:
        checks.append(Bound("step over its own", (run.dt or 0.0) / given, 1 + 1e-9))
    what, bounds, more = "end no multiple of dt", (COLD, HOT), tuple(checks)
    row = row_of(what, scene.dtype, method, ran, bounds, more=more)
    return row._replace(seen=f"{run.steps} steps to 3 save times")


_IMPLICIT = (jt.BackwardEuler, jt.CrankNicolson, jt.TRBDF2)


def _no_time(scene: jt.Scene, name: str, solver) -> Row:
    run = jt.simulate(scene, 0.0, solver=solver)
    surface = np.asarray(run.surface_temperature, float)[0]
    grid = scene.bodies[0].structure.grid
    x = grid.lattice.centres(grid.fragment_voxel)[:, 0]
    off = float(np.abs(surface - np.where(x < 0, HOT, COLD)).max())
    check = Bound("moved", off, 0.0)
    return Row("t1 = 0", name, scene.dtype, checks=(check,))


CASES = (
    Case(
        "S01",
        "conductivity 1.5e5 to 1: aerogel and diamond by turns",
        "maximum principle; rounding as measured on 200 alternating cells",
        "no overshoot beyond 1e-9 K (float64), 5e-3 K (float32); energy to 1e-12, 1e-4",
        "",
        conductivities,
    ),
    Case(
        "S02",
        "heat capacity 2.9e3 and 1e6 to 1",
        "maximum principle; rounding as measured on 200 alternating cells",
        "no overshoot beyond 1e-9 K (float64), 5e-3 K (float32); energy to 1e-12, 1e-4",
        "",
        capacities,
    ),
    Case(
        "S04",
        "steps of 1e-6 to 1e6 explicit limits",
        "Varga, Matrix Iterative Analysis, 8.2; Hosea and Shampine 1996",
        "backward Euler never overshoots; Crank-Nicolson does not up to 2 limits, and "
        "rings above by (1 - z/2)/(1 + z/2) a step; factors to 1e-9",
        "",
        _long_steps,
    ),
    Case(
        "S22",
        f"an end that {STEPS} steps do not reach, and an end at 0",
        "equal steps between save times",
        "lands on every save time exactly; no time changes nothing, bit by bit; dt = 0 "
        "is refused",
        "",
        save_times,
    ),
)
