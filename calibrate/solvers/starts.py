"""Searches from several starts that advance together, of which the best goes on."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxthermo.archive import read_archive, write_archive
from jaxthermo.arrays import precision
from jaxthermo.errors import InputError
from jaxthermo.parallel.batch import on_every_device

from ..problem.time_steps import MAX_STIFFENING, Limits, StepTables, is_beyond
from .fit import Fitting
from .search import Objective, Search, batched, forward_only, losses, with_step_tables


_KIND = "searches from several starts"
_VERSION = 1
_REMEDY = "delete it to search again"


class SearchEnds(NamedTuple):
    """End points of searches from several starts."""

    points: Float[np.ndarray, "n p"]
    losses: Float[np.ndarray, " n"]
    """Half of the sum of squares."""

    @property
    def best(self) -> Float[np.ndarray, " p"]:
        """End with the least loss."""
        return self.points[int(self.losses.argmin())]

    def save(self, path: Path) -> None:
        """Write to a file, in one step, with a checksum."""
        arrays = {"points": self.points, "losses": self.losses}
        write_archive(path, format_name=_KIND, version=_VERSION, arrays=arrays)


def load_ends(path: Path) -> SearchEnds:
    """Read the ends of searches that an earlier process saved."""
    arrays = read_archive(path, format_name=_KIND, version=_VERSION, remedy=_REMEDY)
    return SearchEnds(points=arrays["points"], losses=arrays["losses"])


def search_starts(
    fitting: Fitting,
    points: Float[np.ndarray, "n p"],
    stop: Callable[[], bool] = lambda: False,
    log: Callable[[str], None] = lambda line: None,
) -> SearchEnds:
    """Search from several points together.

    Points whose runs are not finite, or far longer than those of the others, are
    left out; `log` is called with a line for each of them.

    Raises:
        InputError: if all points are left out.
    """
    with precision(fitting.problem.dtype.name):
        replicate = partial(on_every_device, fitting.mesh)
        batch = fitting.problem.batch()
        starts = _usable_starts(fitting, points, log)
        first_limits = np.max([fitting.limits(start) for start in starts], axis=0)
        z = starts
        done = np.zeros(len(starts), bool)
        search = _StartSearch(fitting, z, _first_objective(fitting, z))
        for _ in range(fitting.settings.max_steps):
            if done.all() or stop():
                break
            step_tables = _tables_of_all(
                fitting,
                search.objective.step_tables,
                best=z[~done],
                trials=search.states.y_eval[~done],
                first=first_limits,
            )
            if not fitting.make_room(step_tables):
                objective = replace(search.objective, reverse=fitting.objective.reverse)
                search = _StartSearch(fitting, z, objective)
            objective = with_step_tables(search.objective, step_tables)
            search.objective = objective
            *following, ended = search.advance(
                *replicate((z, search.states, objective))
            )
            # Finished searches still step (static shapes): their result is
            # discarded.
            keep = partial(_keep_finished, done)
            z, search.states = jax.tree.map(keep, [z, search.states], following)
            done = done | np.asarray(ended)
        limits = np.min([fitting.limits(point) for point in z], axis=0)
        step_tables = fitting.problem.time_steps.settled(
            search.objective.step_tables, limits
        )
        objective = with_step_tables(forward_only(search.objective), step_tables)
        objective, z = replicate((objective, z))
        final = losses(objective, points=z, batch=batch, mesh=fitting.mesh)
    return SearchEnds(np.asarray(z, float), losses=np.asarray(final, float))


def _first_objective(fitting: Fitting, starts: Float[Array, "n p"]) -> Objective:
    """Objective with the robust loss of the first start, if the fit has one."""
    limits = fitting.limits(starts[0])
    step_tables = fitting.problem.time_steps.at(limits)
    objective = with_step_tables(fitting.objective, step_tables)
    residual, _ = fitting.evaluate(starts[0], objective)
    return on_every_device(fitting.mesh, fitting.robust(objective, residual))


def _usable_starts(
    fitting: Fitting, points: Float[np.ndarray, "n p"], log: Callable[[str], None]
) -> Float[Array, "m p"]:
    """Starts whose residuals are finite, in runs of a bearable length."""
    count = len(points)
    starts = jnp.asarray(points, fitting.problem.dtype)
    limits = np.array([fitting.limits(start) for start in starts])
    typical = np.nanmedian(limits, axis=0)
    bearable = (limits * MAX_STIFFENING >= typical).all(axis=1)
    for number in np.flatnonzero(~bearable):
        log(
            f"start {number + 1} of {count} is left out: it is more than "
            f"{MAX_STIFFENING:g} times as stiff as the others, or not finite"
        )
    numbers = np.flatnonzero(bearable)
    if len(numbers):
        step_tables = fitting.problem.time_steps.at(limits[numbers].min(axis=0))
        objective = with_step_tables(forward_only(fitting.objective), step_tables)
        objective, tried = on_every_device(fitting.mesh, (objective, starts[numbers]))
        start_losses = losses(
            objective, points=tried, batch=fitting.problem.batch(), mesh=fitting.mesh
        )
        finite = np.isfinite(np.asarray(start_losses))
        for number in numbers[~finite]:
            log(
                f"start {number + 1} of {count} is left out: its residuals are "
                "not finite"
            )
        numbers = numbers[finite]
    if not len(numbers):
        raise InputError("fit: starts: the residuals are finite at none of them")
    return starts[numbers]


def _tables_of_all(
    fitting: Fitting,
    step_tables: StepTables,
    best: Float[Array, "n p"],
    trials: Float[Array, "n p"],
    first: Limits,
) -> StepTables:
    """Steps for all searches: those that the stiffest of them needs."""
    needed = np.min([fitting.limits(z) for z in best], axis=0)
    for trial in trials:
        limits = fitting.limits(trial)
        if not is_beyond(limits, first):
            needed = np.minimum(needed, limits)
    return fitting.problem.time_steps.followed(step_tables, needed)


class _StartSearch:
    """Searches from several starts that advance together."""

    def __init__(
        self, fitting: Fitting, starts: Float[Array, "n p"], objective: Objective
    ):
        """The starts are evaluated first."""
        mesh = fitting.mesh
        batch = fitting.problem.batch()
        self.objective = objective
        # A batch of searches runs both branches of a condition, so that keeping
        # Jacobians would save nothing.
        search = Search(
            objective=self.objective,
            settings=fitting.settings,
            batch=batch,
            use_broyden=False,
            mesh=mesh,
        )
        # At least one start on each device.
        fewest = 1 if mesh is None else mesh.size
        together = max(fewest, batch // len(starts[0]))
        self.states, self.advance = batched(search, starts=starts, batch=together)


def _keep_finished(done: np.ndarray, old: Array, new: Array) -> Array:
    return jnp.where(done.reshape((-1,) + (1,) * (new.ndim - 1)), old, new)
