"""A fit from its start to its end.

The best point so far is never lost: Ctrl-C ends the fit there, and a process that was
killed continues from the last step that it finished, to the same result.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Float

from jaxthermo.arrays import precision
from jaxthermo.errors import InputError
from jaxthermo.parallel.batch import on_every_device, on_first_device
from jaxthermo.parallel.devices import check_devices, check_shared, mesh_of
from jaxthermo.report.numbers import count

from ..config.schema import FitConfig
from ..problem.problem import Problem, RunDiagnostics
from ..problem.time_steps import Limits, StepTables, is_beyond
from .levenberg_marquardt import restart
from .noise_scale import noise_scale
from .optimality import MAX_JUDGED, Slope, examine, relative_tolerance
from .progress import (
    FitState,
    StepRecord,
    is_improving,
    load_progress,
    next_action,
    was_stopped_by_limit,
)
from .search import (
    REVERSE_METHODS,
    Objective,
    Search,
    best_loss,
    forward_only,
    make_objective,
    residuals,
    with_step_tables,
    with_views,
)


@dataclass
class Fit:
    """Result of a fit."""

    z: Float[np.ndarray, " p"]
    """Best point."""
    loss: float
    """Half of the sum of squares at `z` itself."""
    initial_loss: float
    residual: Float[np.ndarray, " r"]
    jacobian: Float[np.ndarray, "p r"] | None
    """Rows of the exact Jacobian at `z`; None where there are too many coordinates."""
    errors: tuple[Float[np.ndarray, " t"], ...]
    """Errors at `z` of every case at every time, see `RunDiagnostics`."""
    steps: list[StepRecord] = field(default_factory=list)
    start: Float[np.ndarray, " p"] | None = None
    """Point that the fit started from."""
    initial_errors: tuple[Float[np.ndarray, " t"], ...] = ()
    """Errors there."""
    ended: str = "converged"
    """"converged", "step limit", "interrupted", "stalled" where no better point is near
    though the gradient is not 0, or "at the limit of its steps" in time."""
    step_seconds: float = 0.0
    """Time of the steps without compilation [s]."""
    run_seconds: float = 0.0
    """Time of all cases once at `z`, without derivatives [s]."""
    compile_seconds: float = 0.0


class Fitting:
    """A problem and its search, traced once: the compiled programs serve every run."""

    def __init__(
        self,
        problem: Problem,
        settings: FitConfig,
        use_broyden: bool = True,
        devices: int = 1,
    ):
        """Trace the problem; nothing is compiled yet.

        Several devices share the columns of a Jacobian, and searches from several
        starts.

        Raises:
            InputError: if there are fewer devices, or not as many columns or starts.
        """
        _check_devices(devices, problem.parameters.size, settings)
        self.mesh = mesh = None if devices == 1 else mesh_of(devices)
        self._use_broyden = use_broyden
        self.settings = settings
        self.problem = problem
        # One wrapper each, so that later runs find what is compiled.
        self._compiled_residuals = eqx.filter_jit(_residuals_once)
        self._longest_steps = eqx.filter_jit(problem.longest_steps)
        self._values = eqx.filter_jit(problem.parameters.flat_values)
        with precision(problem.dtype.name):
            step_tables = problem.step_tables_at(problem.start())
            objective = make_objective(problem, step_tables)
            self.objective = on_every_device(mesh, objective)
            self._reverse_problem = problem
            self._search = self._traced_search(step_tables)

    def _traced_search(self, step_tables: StepTables) -> Search:
        """Search whose reverse mode, if it needs that, has room for these steps."""
        settings = self.settings
        if settings.method in REVERSE_METHODS:
            self._reverse_problem = self.problem.with_reverse_mode(
                int(settings.memory * 2**30), step_tables
            )
            reverse = self._reverse_problem.trace(step_tables)
            reverse = on_every_device(self.mesh, reverse)
            self.objective = replace(self.objective, reverse=reverse)
        return Search(
            objective=self.objective,
            settings=settings,
            batch=self.problem.batch(),
            use_broyden=self._use_broyden,
            mesh=self.mesh,
        )

    def make_room(self, step_tables: StepTables) -> bool:
        """Trace the search again where it has no room for the steps; True if it had."""
        if self._reverse_problem.has_room(step_tables):
            return True
        self._search = self._traced_search(step_tables)
        return False

    def run(
        self,
        *,
        start: Float[np.ndarray, " p"] | None = None,
        checkpoint: Path | None = None,
        log: Callable[[StepRecord], None] | None = None,
        stop: Callable[[], bool] = lambda: False,
        noise: Float[np.ndarray, " r"] | None = None,
    ) -> Fit:
        """Fit the parameters.

        Args:
            start: coordinates to start from; 0, the start values, by default.
            checkpoint: file for the state after every step; a fit continues from it.
            log: called after every step.
            stop: called before every step; the fit ends if it returns True.
            noise: added to the residuals, as of a repeated measurement.

        Raises:
            InputError: if there are more parameters than residuals, or the residuals
                at the start are not finite.
        """
        dtype = self.problem.dtype
        with precision(dtype.name):
            clock = time.perf_counter()
            z = self.problem.start() if start is None else jnp.asarray(start, dtype)
            z = on_every_device(self.mesh, z)
            first_limits = self.limits(z)
            step_tables = self.problem.time_steps.at(first_limits)
            objective = with_step_tables(self.objective, step_tables)
            if noise is not None:
                added = jnp.asarray(noise, dtype)
                objective = eqx.tree_at(lambda o: o.noise, objective, added)
            objective = self._seen_from(objective, z)
            beginning = self._begin(objective, z)
            objective = beginning.objective
            progress = self._first_state(z, step_tables, checkpoint)
            objective = replace(objective, reverse=self.objective.reverse)
            # Compile all that the loop runs, so that its time is that of steps alone.
            self._host_values(progress.z)
            self._search.compile(progress.z, progress.solver_state)
            compile_seconds = time.perf_counter() - clock
            ending = self._loop(
                objective,
                progress=progress,
                first_limits=first_limits,
                checkpoint=checkpoint,
                log=log,
                stop=stop,
            )
            fit = self._finish(ending, start=z, first=beginning)
        fit.compile_seconds = compile_seconds
        return fit

    def _first_state(
        self, z: Float[Array, " p"], step_tables: StepTables, checkpoint: Path | None
    ) -> FitState:
        """State before the first step, or that of the checkpoint if there is one."""

        def at_start(step_tables: StepTables) -> FitState:
            self.make_room(step_tables)
            state = self._search.start(z)
            return FitState(z=z, solver_state=state, step_tables=step_tables, steps=[])

        progress = at_start(step_tables)
        if checkpoint is None:
            return progress
        loaded = load_progress(checkpoint, progress)
        if not self.make_room(loaded.step_tables):
            # States hold programs, which must be those that have room.
            loaded = load_progress(checkpoint, at_start(loaded.step_tables))
        return on_every_device(self.mesh, loaded)

    def _begin(self, objective: Objective, z: Float[Array, " p"]) -> "_Beginning":
        first, diagnostics = self.evaluate(z, objective)
        if not bool(jnp.isfinite(first).all()):
            raise InputError(
                "the residuals are not finite at the start: check the start values of "
                "the parameters, and the data"
            )
        if self.problem.parameters.size > len(first):
            raise InputError(
                f"{self.problem.parameters.size} parameters and {len(first)} "
                "residuals: leave out parameters, or add cases or save times"
            )
        if self.settings.huber is not None:
            objective = self.robust(objective, first)
            first, diagnostics = self.evaluate(z, objective)
        return _Beginning(objective, residual=first, diagnostics=diagnostics)

    def robust(self, objective: Objective, residual: Array) -> Objective:
        """Objective with its robust loss, by the residuals of squares at the start."""
        if self.settings.huber is None:
            return objective
        # With another norm over times residuals have no unit of noise.
        is_in_noise = self.problem.time_norm == 2
        known_sd = self.problem.known_sd if is_in_noise else None
        knee = self.settings.huber * noise_scale(residual, known_sd)
        knee = jnp.asarray(knee, self.problem.dtype)
        return eqx.tree_at(lambda o: o.knee, objective, knee)

    def _loop(
        self,
        objective: Objective,
        progress: FitState,
        first_limits: Limits,
        checkpoint: Path | None,
        log: Callable[[StepRecord], None] | None,
        stop: Callable[[], bool],
    ) -> "_Ending":
        size = self.problem.parameters.size
        while True:
            steps = progress.steps
            state = progress.solver_state
            action = next_action(
                steps,
                done=progress.done,
                size=size,
                tolerance=relative_tolerance(self.problem, self.settings),
                dtype=self.problem.dtype,
            )
            if action == "end":
                ending = self._examined(objective, progress)
                if ending.ended == "converged" or not is_improving(steps):
                    return ending
                # From here on with steps that do not depend on the way, and without
                # the solver's memory of it.
                objective = ending.objective
                progress = ending.progress
                state = self._search.start(progress.z)
            if len(steps) >= self.settings.max_steps:
                return self._examined(objective, progress, "step limit")
            if stop():
                return self._examined(objective, progress, "interrupted")
            clock = time.perf_counter()
            refresh = action != "try"
            z = progress.z
            if action == "refresh":
                state = restart(state, z)
            # Other time steps move the residuals too, but less than the trial that
            # needs them: the Jacobian is kept.
            step_tables, at_limit = self._followed(
                progress.step_tables,
                best=self.limits(z),
                trial=self.limits(state.y_eval),
                first=first_limits,
            )
            if not self.make_room(step_tables):
                state = self._search.start(z)
                refresh = True
                objective = replace(objective, reverse=self.objective.reverse)
            length = float(np.abs(np.asarray(state.y_eval) - np.asarray(z)).max())
            objective = with_step_tables(objective, step_tables)
            # Rendered again wherever the cameras are tried: residuals are exact there.
            objective = self._seen_from(objective, state.y_eval)
            advance = self._search.compile(z, state)
            z, state, done = advance(z, state, objective)
            loss = best_loss(state)
            seconds = progress.seconds + time.perf_counter() - clock
            accepted = refresh or loss < steps[-1].loss
            exact = refresh or not self._search.keeps_jacobian
            record = StepRecord(
                number=len(steps) + 1,
                loss=loss,
                accepted=accepted,
                length=length,
                values=self._host_values(z),
                exact=exact,
                refresh=refresh,
                at_limit=at_limit,
            )
            steps = [*steps, record]
            progress = FitState(
                z=z,
                solver_state=state,
                step_tables=step_tables,
                steps=steps,
                done=bool(done),
                seconds=seconds,
            )
            if checkpoint is not None:
                progress.save(checkpoint)
            if log is not None:
                log(record)

    def evaluate(
        self, z: Float[Array, " p"], objective: Objective
    ) -> tuple[Array, RunDiagnostics]:
        """Residuals at z, whose squares are minimized, and the errors of the runs."""
        arguments = on_every_device(self.mesh, (z, forward_only(objective)))
        return self._compiled_residuals(self.mesh, *arguments)

    def _seen_from(self, objective: Objective, z: Float[Array, " p"]) -> Objective:
        """Objective with the cameras where they are at z."""
        return with_views(objective, self.problem.views_at(z))

    def _host_values(self, z: Float[Array, " p"]) -> tuple[float, ...]:
        # Fields of thousands of values are not logged.
        if len(z) > MAX_JUDGED:
            return ()
        return tuple(np.asarray(self._values(z), float).tolist())

    def limits(self, z: Float[Array, " p"]) -> Limits:
        """Longest stable step of each case at z [s]."""
        return np.asarray(self._longest_steps(z), float)

    def _followed(
        self, step_tables: StepTables, best: Limits, trial: Limits, first: Limits
    ) -> "_Followed":
        """Steps for the best point and for a trial, by their longest stable steps.

        A trial that is far stiffer than the start has none: its residuals are infinite,
        and it is not accepted.
        """
        at_limit = is_beyond(trial, first)
        needed = best if at_limit else np.minimum(best, trial)
        followed = self.problem.time_steps.followed(step_tables, needed)
        return _Followed(followed, at_limit=at_limit)

    def _examined(
        self, objective: Objective, progress: FitState, ended: str = "stalled"
    ) -> "_Ending":
        """End of a search, which has converged where its gradient says so."""
        step_tables = self.problem.time_steps.settled(
            progress.step_tables, self.limits(progress.z)
        )
        if not self.make_room(step_tables):
            objective = replace(objective, reverse=self.objective.reverse)
        objective = with_step_tables(objective, step_tables)
        point = self._point(objective, progress.z)
        if ended != "interrupted":
            if point.slope.is_minimum:
                ended = "converged"
            elif was_stopped_by_limit(progress.steps):
                ended = "at the limit of its steps"
        progress = progress._replace(step_tables=step_tables)
        return _Ending(ended, objective=objective, progress=progress, point=point)

    def _point(self, objective: Objective, z: Float[Array, " p"]) -> "_Point":
        """Residuals and derivatives at a point."""
        objective = self._seen_from(objective, z)
        residual, diagnostics = self.evaluate(z, objective)
        slope = examine(
            self.problem,
            settings=self.settings,
            objective=objective,
            z=z,
            residual=np.asarray(residual, float),
            mesh=self.mesh,
        )
        return _Point(residual, diagnostics=diagnostics, slope=slope)

    def _finish(
        self, ending: "_Ending", start: Float[Array, " p"], first: "_Beginning"
    ) -> Fit:
        objective = ending.objective
        progress = ending.progress
        z = progress.z
        point = ending.point
        initial = _loss(first.residual)
        # Never worse than the start, whatever the last time steps are.
        if not _loss(point.residual) <= initial * (1 + 1e-6):
            z = start
            objective = with_step_tables(objective, first.objective.step_tables)
            point = self._point(objective, z)
        # Again, since the first evaluation may have compiled.
        clock = time.perf_counter()
        jax.block_until_ready(self.evaluate(z, self._seen_from(objective, z)))
        run_seconds = time.perf_counter() - clock
        return Fit(
            z=np.asarray(z, float),
            loss=_loss(point.residual),
            initial_loss=initial,
            residual=np.asarray(point.residual, float),
            jacobian=point.slope.jacobian,
            errors=point.diagnostics.host_errors(),
            steps=progress.steps,
            start=np.asarray(start, float),
            initial_errors=first.diagnostics.host_errors(),
            ended=ending.ended,
            step_seconds=progress.seconds,
            run_seconds=run_seconds,
        )


class _Point(NamedTuple):
    """Residuals and derivatives at a point."""

    residual: Array
    diagnostics: RunDiagnostics
    slope: Slope


class _Ending(NamedTuple):
    """End of a search."""

    ended: str
    """See `Fit.ended`."""
    objective: Objective
    """Objective with the steps of the last point."""
    progress: FitState
    point: _Point


class _Followed(NamedTuple):
    """Steps in time of a trial."""

    step_tables: StepTables
    at_limit: bool
    """True if the trial needs more steps than a run may take."""


class _Beginning(NamedTuple):
    """Objective of a fit, and its residuals at the start."""

    objective: Objective
    residual: Array
    diagnostics: RunDiagnostics


def _residuals_once(
    mesh: Mesh | None, z: Float[Array, " p"], objective: Objective
) -> tuple[Array, RunDiagnostics]:
    return on_first_device(
        mesh, lambda arguments: residuals(*arguments), (z, objective)
    )


def _check_devices(devices: int, size: int, settings: FitConfig) -> None:
    check_devices(devices)
    if devices > 1 and settings.method in REVERSE_METHODS:
        raise InputError(
            f"devices={devices}: {settings.method} computes one derivative after the "
            "other; use levenberg_marquardt, or leave devices out"
        )
    values = count(size, "value")
    starts = count(settings.starts, "start")
    shared = f"the derivatives of {values} and {starts}"
    check_shared(devices, max(size, settings.starts), shared)


def _loss(residual: Array) -> float:
    return float(0.5 * (np.asarray(residual, float) ** 2).sum())
