"""A fit from its start to its end: steps, what is told of them, stops and goes on.

Whatever happens, the best point so far is kept: a Ctrl-C ends the fit there, and a
process that is killed goes on from the last step that it finished, to the same result.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxthermo.arrays import precision
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.parametric_run import Layout, with_more_steps

from ..problem.problem import Layouts, Problem, Seen, jacobian_rows
from .checkpoint import Progress, Step, kept
from .linearization import Program, residuals
from .multistart import searched_together
from .search import REVERSE, Search, Setting
from .starts import losses
from .stopping_rule import next_of


@dataclass
class Fit:
    """What a fit found."""

    z: Float[np.ndarray, " p"]
    loss: float
    """Evaluated at `z` itself."""
    initial_loss: float
    residual: Float[np.ndarray, " r"]
    jacobian: Float[np.ndarray, "p r"] | None
    """Of the misfits at `z` by the free numbers; None where there are too many."""
    errors: tuple[Float[np.ndarray, " t"], ...]
    """At `z`, of every case at every time, as `Seen` has them."""
    steps: list[Step] = field(default_factory=list)
    initial_errors: tuple[Float[np.ndarray, " t"], ...] = ()
    ended: str = "converged"
    """Or "step limit", or "interrupted"."""
    took: float = 0.0
    """Of the steps, without compiling [s]."""
    one_run: float = 0.0
    """Of all cases once at `z`, without derivatives, in the fit's own steps [s]."""
    compiling: float = 0.0


MOST_JUDGED = 200
"""Free numbers whose Jacobian is kept, to judge them by."""

MOST_STIFFER = 10.0
"""Than the start: trials beyond are refused."""

Tell = Callable[[Step, float], None]
"""Told of every step, with the seconds that steps took so far."""


class Fitting:
    """A problem and how it is searched, traced once: its programs serve every run."""

    def __init__(self, problem: Problem, setting: Setting):
        """Nothing is compiled yet.

        Args:
            problem: parameters and cases.
            setting: of the search.
        """
        reverse = setting.method in REVERSE
        self.setting = setting
        self.problem = problem.with_fixed_steps() if reverse else problem
        with precision(problem.dtype.name):
            layouts = self.problem.layouts()
            traced = self.problem.trace(layouts)
            back = self.problem.backward(setting.memory) if reverse else None
            backward = None if back is None else back.trace(layouts)
            endless = jnp.asarray(jnp.inf, problem.dtype)
            none = jnp.zeros((), problem.dtype)
            self.program = Program(traced, layouts, endless, none, backward)
            self._search = Search(self.program, setting, self.problem.batch())
        self._evaluate = eqx.filter_jit(residuals)
        self._losses_of = eqx.filter_jit(losses)
        self._stable = eqx.filter_jit(self.problem.stable_steps)
        self._values = eqx.filter_jit(self.problem.parameters.flat_values)

    def run(
        self,
        *,
        start: Float[np.ndarray, " p"] | None = None,
        keep: Path | None = None,
        tell: Tell | None = None,
        stop: Callable[[], bool] = lambda: False,
        noise: Float[np.ndarray, " r"] | None = None,
    ) -> Fit:
        """Fit the parameters.

        Args:
            start: free numbers to start from; those of the values as given if None.
            keep: a file for the state after every step; a fit goes on from there.
            tell: of every step.
            stop: whether to end after this step.
            noise: added to the misfits, as of measurements that are repeated.

        Raises:
            InputError: if there are more parameters than misfits, or the misfits at the
                start are not finite.
        """
        with precision(self.problem.dtype.name):
            clock = time.perf_counter()
            dtype = self.problem.dtype
            z = self.problem.start() if start is None else jnp.asarray(start, dtype)
            program = self.program
            if noise is not None:
                given = jnp.asarray(noise, dtype)
                program = eqx.tree_at(lambda p: p.noise, program, given)
            program, first, seen = self._begin(program, z)
            search = self._search.with_program(program)
            at = Progress(search.begin(z), program.layouts, [])
            at = at if keep is None else kept(keep, at)
            search = search.compiled(at.point)
            jax.block_until_ready(self._stable(search.tried(at.point)))
            self._told(at.point.z)
            compiling = time.perf_counter() - clock
            at, ended = self._loop(search, program, at, keep, tell, stop)
            fit = self._found(program, at, z, first)
        fit.initial_errors = seen.known_errors()
        fit.ended, fit.took, fit.compiling = ended, at.took, compiling
        return fit

    def best_of(
        self,
        points: Float[np.ndarray, "n p"],
        stop: Callable[[], bool] = lambda: False,
    ) -> Float[np.ndarray, " p"]:
        """The best that is found from several starts, all searched together.

        Args:
            points: to start from; one whose misfits are not finite is left out.
            stop: whether to end with the best so far.

        Raises:
            InputError: if the misfits are finite at none of them.
        """
        dtype, batch = self.problem.dtype, self.problem.batch()
        with precision(dtype.name):
            tried = self._losses(jnp.asarray(points, dtype))
            points = points[np.isfinite(tried)]
            if not len(points):
                raise InputError("fit: starts: the misfits are finite at none of them")
            starts, room = jnp.asarray(points, dtype), max(1, batch // len(points[0]))
            several = searched_together(self._search, starts, room)
            program = self.program
            for _ in range(self.setting.most_steps):
                if several.done.all() or stop():
                    break
                stable = jax.lax.map(self._stable, several.tried()).min(axis=0)
                layouts = self._enough(program.layouts, stable)
                program = with_layouts(program, layouts)
                several = several.step(program)
            found = np.asarray(self._losses(several.z, program))
        return np.asarray(several.z[int(found.argmin())], float)

    def _losses(self, points, program: Program | None = None):
        program = self.program if program is None else program
        found = self._losses_of(program, points, self.problem.batch())
        return np.asarray(found, float)

    def _begin(self, program: Program, z) -> tuple[Program, Array, Seen]:
        """Checks, and where the loss starts to be robust."""
        first, seen = self._evaluate(program, z)
        _check(self.problem, first)
        if self.setting.huber is not None:
            knee = self.setting.huber * jnp.sqrt((first * first).mean())
            program = eqx.tree_at(lambda p: p.knee, program, knee)
            first, seen = self._evaluate(program, z)
        return program, first, seen

    def _loop(
        self, search: Search, program: Program, at: Progress, keep, tell, stop
    ) -> tuple[Progress, str]:
        """Steps, until one of them is the last, and why it is."""
        tolerance = self.setting.tolerance * self.problem.worst
        while True:
            size, dtype = len(at.point.z), self.problem.dtype
            then = next_of(at.steps, at.point.done, size, tolerance, dtype)
            if then == "end":
                return at, "converged"
            if at.point.steps >= self.setting.most_steps:
                return at, "step limit"
            if stop():
                return at, "interrupted"
            at = self._stepped(search, program, at, then == "look")
            if keep is not None:
                at.keep(keep)
            if tell is not None:
                tell(at.steps[-1], at.took)

    def _stepped(
        self, search: Search, program: Program, at: Progress, look: bool
    ) -> Progress:
        """After one step more, in as many steps in time as its trial needs."""
        clock = time.perf_counter()
        point = search.again(at.point) if look else at.point
        layouts = self._enough(at.layouts, self._stable(search.tried(point)))
        # More steps in time move misfits too, but less than the trial that needs them.
        fresh = look or not search.keeps
        search = search.with_program(with_layouts(program, layouts))
        reach = np.abs(np.asarray(search.tried(point)) - np.asarray(point.z)).max()
        point = search.step(point, fresh)
        loss = search.loss(point)
        took = at.took + time.perf_counter() - clock
        accepted = look or loss < at.steps[-1].loss
        told = self._told(point.z)
        step = Step(point.steps, loss, accepted, float(reach), told, fresh, look)
        return Progress(point, layouts, [*at.steps, step], took)

    def _told(self, z) -> tuple[float, ...]:
        """Values to be told of a step; of a field none."""
        if len(z) > MOST_JUDGED:
            return ()
        return tuple(np.asarray(self._values(z), float).tolist())

    def _enough(self, layouts: Layouts, stable) -> Layouts:
        return enough_steps(layouts, stable, self.program.layouts)

    def _found(self, program: Program, at: Progress, z, first: Array) -> Fit:
        """Evaluated at the point itself; never worse than where it began."""
        program, z_found = with_layouts(program, at.layouts), at.point.z
        initial = _loss(first)
        residual, seen = self._evaluate(program, z_found)
        if not bool(seen.finite) or not _loss(residual) <= initial * (1 + 1e-6):
            z_found = z
            residual, seen = self._evaluate(program, z)
        clock = time.perf_counter()
        jax.block_until_ready(self._evaluate(program, z_found))
        one_run = time.perf_counter() - clock
        rows = None
        if len(z) <= MOST_JUDGED:
            batch = self.problem.batch()
            rows = jacobian_rows(residuals, program, z_found, batch)
            rows = np.asarray(rows, float)
        return Fit(
            z=np.asarray(z_found, float),
            loss=_loss(residual),
            initial_loss=initial,
            residual=np.asarray(residual, float),
            jacobian=rows,
            errors=seen.known_errors(),
            steps=at.steps,
            one_run=one_run,
        )


def with_layouts(program: Program, layouts: Layouts) -> Program:
    """The program with other steps in time."""
    return eqx.tree_at(lambda p: p.layouts, program, layouts)


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


def enough_steps(
    layouts: Layouts, stable: Float[Array, " c"], first: Layouts | None = None
) -> Layouts:
    """Layouts whose explicit steps are stable.

    Args:
        layouts: of the cases.
        stable: step of each, infinite where the solver gives its own [s].
        first: those of a fit's start: a trial that is far stiffer than those keeps its
            layouts, so that it blows up and is refused; it would take for ever.
    """
    found, changed = [], False
    for n, (layout, limit) in enumerate(
        zip(layouts, np.asarray(stable, float), strict=True)
    ):
        longest = _longest(layout)
        least = 0.0 if first is None else _longest(first[n]) / MOST_STIFFER
        if np.isfinite(limit) and least < limit < longest:
            # More than is needed now: each change moves the misfits a little.
            layout, changed = with_more_steps(layout, 1.25 * longest / limit), True
        found.append(layout)
    return tuple(found) if changed else layouts


def _longest(layout: Layout) -> float:
    """Of the steps that are taken [s]."""
    spans, counts = np.asarray(layout[1]), np.asarray(layout[2])
    return float(spans[counts > 0].max())
