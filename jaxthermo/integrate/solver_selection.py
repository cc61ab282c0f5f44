"""Which solver a run gets if none is given."""

from .solvers import TRBDF2, AbstractSolver, ForwardEuler, SuperTimeStepping


FEW = 2_000
"""Stable steps that are taken one by one."""

MANY = 5_000_000
"""Stable steps above which even their square root is too many."""


def choose(stable: float | None, t1: float | int) -> tuple[AbstractSolver, str]:
    """A solver and why, by how many stable explicit steps a run would take.

    Args:
        stable: the largest explicit step [s]; None if it is traced.
        t1: end of the run [s].
    """
    if stable is None:
        return ForwardEuler(), "the stable step is traced"
    if t1 <= FEW * stable:
        return ForwardEuler(), f"at most {FEW} stable steps"
    steps = f"{t1 / stable:.2g} stable steps of {stable:.3g} s"
    if t1 <= MANY * stable:
        return SuperTimeStepping(), steps
    return TRBDF2(), steps
