"""A fit from its start to its end: steps, what is told of them, stops and goes on.

Whatever happens, the best point so far is kept: a Ctrl-C ends the fit there, and a
process that is killed goes on from the last step that it finished, to the same result.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxthermo.atomic import replacing
from jaxthermo.errors import InputError
from jaxthermo.integrate.response import with_more_steps
from jaxthermo.precision import precision

from .problem import Layouts, Problem, with_jacobian
from .rules import Program, residuals
from .search import REVERSE, Point, Search, Setting


@dataclass(frozen=True)
class Step:
    """What is told of a step."""

    number: int
    loss: float
    """Half of the sum of squares, at the best point so far."""
    accepted: bool
    values: tuple[float, ...]


@dataclass
class Fit:
    """What a fit found."""

    z: Float[np.ndarray, " p"]
    loss: float
    """Evaluated at `z` itself."""
    initial_loss: float
    residual: Float[np.ndarray, " r"]
    jacobian: Float[np.ndarray, "p r"]
    """Of the misfits at `z` by the free numbers; no rows where there are too many."""
    errors: tuple[Float[np.ndarray, " t"], ...]
    """At `z`, of every case at every time, as `Seen` has them."""
    initial_errors: tuple[Float[np.ndarray, " t"], ...]
    steps: list[Step] = field(default_factory=list)
    ended: str = "converged"
    """Or "step limit", or "interrupted"."""
    took: float = 0.0
    """Of the steps, without compiling [s]."""
    compiling: float = 0.0


MOST_JUDGED = 200
"""Free numbers whose Jacobian is kept, to judge them by."""

STILL = 3
"""Steps without progress that end a fit: no more is to be had in this precision."""

Tell = Callable[[Step, float], None]
"""Told of every step, with the seconds that steps took so far."""


def run_fit(
    problem: Problem,
    setting: Setting,
    *,
    start: Float[np.ndarray, " p"] | None = None,
    keep: Path | None = None,
    tell: Tell | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> Fit:
    """Fit the parameters of a problem.

    Args:
        problem: parameters and cases.
        setting: of the search.
        start: free numbers to start from; those of the values as given if None.
        keep: a file for the state after every step; a fit goes on from there.
        tell: of every step.
        stop: whether to end after this step.

    Raises:
        InputError: if there are more parameters than misfits, or the misfits at the
            start are not finite.
    """
    with precision(problem.dtype.name):
        return _run(problem, setting, start, keep, tell, stop)


def _run(problem, setting, start, keep, tell, stop) -> Fit:
    clock = time.perf_counter()
    reverse = setting.method in REVERSE
    if reverse:
        problem = problem.with_fixed_steps()
    layouts = problem.layouts()
    traced = problem.trace(layouts)
    z = problem.start() if start is None else jnp.asarray(start, problem.dtype)
    knee = jnp.asarray(jnp.inf, problem.dtype)
    backward = problem.backward(setting.memory).trace(layouts) if reverse else None
    program = Program(traced, layouts, knee, backward)
    evaluate = eqx.filter_jit(residuals)
    first, before_all = evaluate(program, z)
    _check(problem, first)
    if setting.huber is not None:
        root = jnp.sqrt((first * first).mean())
        program = eqx.tree_at(lambda p: p.knee, program, setting.huber * root)
        first, _ = evaluate(program, z)
    initial = _loss(first)
    search = Search(program, setting, problem.batch())
    point = search.begin(z)
    steps: list[Step] = []
    point, layouts, steps = _kept(keep, point, layouts, steps)
    stable = eqx.filter_jit(problem.stable_steps)
    search = search.compiled(point)
    compiling, took = time.perf_counter() - clock, 0.0
    ended = "converged"
    while not (point.done or settled(steps, setting.tolerance, problem.dtype)):
        if point.steps >= setting.most_steps:
            ended = "step limit"
            break
        if stop():
            ended = "interrupted"
            break
        clock = time.perf_counter()
        longer = enough_steps(layouts, stable(search.tried(point)))
        if longer is not layouts:
            layouts = longer
        search = search.with_layouts(layouts)
        before = steps[-1].loss if steps else initial
        point = search.step(point)
        loss = search.loss(point)
        took += time.perf_counter() - clock
        values = tuple(map(float, problem.parameters.flat_values(point.z)))
        steps.append(Step(point.steps, loss, loss < before, values))
        _keep(keep, point, layouts, steps)
        if tell is not None:
            tell(steps[-1], took)
    program = eqx.tree_at(lambda p: p.layouts, program, layouts)
    residual, seen = evaluate(program, point.z)
    loss = _loss(residual)
    if not bool(seen.finite) or loss > initial * (1 + 1e-6):
        # Never worse than where it began.
        point = point._replace(z=z)
        residual, seen = evaluate(program, z)
        loss = _loss(residual)
    rows = np.zeros((0, len(residual)))
    if len(z) <= MOST_JUDGED:
        rows = eqx.filter_jit(with_jacobian_at)(program, point.z, problem.batch())
    arrays = lambda seen: tuple(np.asarray(e, float) for e in seen.errors)
    return Fit(
        z=np.asarray(point.z, float),
        loss=loss,
        initial_loss=initial,
        residual=np.asarray(residual, float),
        jacobian=np.asarray(rows, float),
        errors=arrays(seen),
        initial_errors=arrays(before_all),
        steps=steps,
        ended=ended,
        took=took,
        compiling=compiling,
    )


def with_jacobian_at(
    program: Program, z: Float[Array, " p"], batch: int
) -> Float[Array, "p r"]:
    """The Jacobian of the residuals at a point."""
    return with_jacobian(lambda y: residuals(program, y), z, batch)[1]


def _loss(residual: Array) -> float:
    return float(0.5 * (np.asarray(residual, float) ** 2).sum())


def _check(problem: Problem, first: Array) -> None:
    if not bool(jnp.isfinite(first).all()):
        raise InputError(
            "the misfits are not finite at the start: check the start values of the "
            "parameters, and the data"
        )
    if problem.parameters.size > len(first):
        raise InputError(
            f"{problem.parameters.size} parameters and {len(first)} misfits: leave out "
            "parameters, or add cases or save times"
        )


def settled(steps: list[Step], tolerance: float, dtype: Any) -> bool:
    """Whether steps no longer change the loss.

    Args:
        steps: so far.
        tolerance: of the fit; the loss, flat at its least, is told far better.
        dtype: whose rounding they cannot get below.
    """
    if len(steps) <= STILL:
        return False
    before, now = steps[-1 - STILL].loss, steps[-1].loss
    least = max(16 * float(jnp.finfo(dtype).eps), 1e-2 * tolerance)
    return before - now <= least * before


def enough_steps(layouts: Layouts, stable: Float[Array, " c"]) -> Layouts:
    """Layouts whose explicit steps are stable.

    Args:
        layouts: of the cases.
        stable: step of each, infinite where the solver gives its own [s].
    """
    found, changed = [], False
    for layout, limit in zip(layouts, np.asarray(stable, float), strict=True):
        spans, counts = np.asarray(layout[1]), np.asarray(layout[2])
        longest = float(spans[counts > 0].max())
        if np.isfinite(limit) and limit > 0 and longest > limit:
            # More than is needed now: each change moves the misfits a little.
            layout, changed = with_more_steps(layout, 1.25 * longest / limit), True
        found.append(layout)
    return tuple(found) if changed else layouts


def _keep(path: Path | None, point: Point, layouts: Layouts, steps: list[Step]) -> None:
    if path is None:
        return
    arrays = {
        f"leaf{n}": np.asarray(leaf) for n, leaf in enumerate(_leaves(point, layouts))
    }
    told = np.array([[s.number, s.loss, s.accepted, *s.values] for s in steps])
    with replacing(path) as temporary, open(temporary, "wb") as file:
        kept: dict[str, Any] = {
            "steps": told,
            "count": np.asarray(point.steps),
            "done": np.asarray(point.done),
            **arrays,
        }
        np.savez(file, allow_pickle=False, **kept)


def _leaves(point: Point, layouts: Layouts) -> list[Any]:
    return jax.tree.leaves(eqx.filter((point.z, point.state, layouts), eqx.is_array))


def _kept(
    path: Path | None, point: Point, layouts: Layouts, steps: list[Step]
) -> tuple[Point, Layouts, list[Step]]:
    """Where an earlier process was, or the start."""
    if path is None or not path.exists():
        return point, layouts, steps
    dynamic, static = eqx.partition((point.z, point.state, layouts), eqx.is_array)
    leaves, tree = jax.tree.flatten(dynamic)
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as kept:
            found = [kept[f"leaf{n}"] for n in range(len(leaves))]
            told = kept["steps"]
            count, done = int(kept["count"]), bool(kept["done"])
    except Exception as error:
        raise InputError(
            f"{path}: cannot be read ({type(error).__name__}): delete it to start anew"
        ) from error
    same = all(
        a.shape == b.shape and a.dtype == b.dtype
        for a, b in zip(found, leaves, strict=True)
    )
    if not same:
        raise InputError(f"{path}: is of another fit: delete it to start anew")
    dynamic = jax.tree.unflatten(tree, [jnp.asarray(a) for a in found])
    z, state, layouts = eqx.combine(dynamic, static)
    steps = [
        Step(int(row[0]), float(row[1]), bool(row[2]), tuple(map(float, row[3:])))
        for row in told
    ]
    return Point(z, state, count, done), layouts, steps
