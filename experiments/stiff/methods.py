"""Solvers that run a scene, and the lengths of their steps."""

import jaxthermo as jt

from ..harness.case import Row, refusal
from .solved import Method, stable_step


STEPS = 5
"""Number of steps of most implicit runs."""

LONG = 100.0
"""Length of a step of super time stepping [stable steps]."""


def explicit(stable: float, steps: int = 200) -> list[Method]:
    """The explicit solvers: one at its limit, one far beyond.

    Args:
        stable: the largest explicit step [s].
        steps: of explicit Euler.
    """
    euler, long = jt.ForwardEuler(dt=stable), LONG * stable
    return [
        Method("ForwardEuler, at its limit", euler, steps * stable),
        Method(
            f"SuperTimeStepping, {LONG:g} limits",
            jt.SuperTimeStepping(dt=long),
            STEPS * long,
            "bounded",
        ),
    ]


def implicit(dt: float, note: str, steps: int = STEPS) -> list[Method]:
    """The implicit solvers at one step.

    Args:
        dt: the step [s].
        note: on it.
        steps: how many.
    """
    end = steps * dt
    return [
        Method(f"BackwardEuler, {note}", jt.BackwardEuler(dt=dt), end),
        Method(f"CrankNicolson, {note}", jt.CrankNicolson(dt=dt), end, "reported"),
        Method(f"TRBDF2, {note}", jt.TRBDF2(dt=dt), end, "bounded"),
    ]


def adaptive(end: float, error: float = 0.01) -> Method:
    """The solver that chooses its steps.

    Args:
        end: of the run [s].
        error: of a step [K].
    """
    return Method("TRBDF2, adaptive", jt.TRBDF2(error=error), end, "bounded")


def every_solver(stable: float, ratio: float = 1e3, steps: int = STEPS) -> list[Method]:
    """All of them once.

    Args:
        stable: the largest explicit step [s].
        ratio: of the implicit solvers' step to it.
        steps: of the implicit solvers.
    """
    dt = ratio * stable
    note = f"{ratio:g} limits"
    return [
        *explicit(stable),
        *implicit(dt, note, steps),
        adaptive(steps * dt),
    ]


def damping(stable: float, ratio: float = 1e3) -> list[Method]:
    """All but the trapezoidal rule, which is there for comparison.

    Args:
        stable: the largest explicit step [s].
        ratio: of the implicit solvers' step to it.
    """
    methods = every_solver(stable, ratio)
    return [m for m in methods if not isinstance(m.solver, jt.CrankNicolson)]


def too_long(what: str, scene: jt.Scene, ratio: float = 2.0) -> Row:
    """Explicit Euler above its limit, which it must refuse and name."""
    stable = stable_step(scene)
    solver = jt.ForwardEuler(dt=ratio * stable)
    return refusal(
        what,
        lambda: jt.simulate(scene, ratio * stable, solver=solver),
        f"the largest stable step of this scene is {stable:.6g} s",
        f"ForwardEuler, {ratio:g} limits",
        scene.dtype,
    )
