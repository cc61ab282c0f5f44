"""The least-squares problem: coordinates in, residuals of all cases out."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, jaxpr_as_fun
from jaxtyping import Array, Bool, Float, Int

from jaxthermo.arrays import precision
from jaxthermo.errors import InputError
from jaxthermo.image.pose.derivative import LinearizedView
from jaxthermo.integrate.run.fixed_steps import fixed_loops, have_room
from jaxthermo.integrate.run.parametric_run import ParametricRun, ReverseMode
from jaxthermo.scene.scene import Scene

from ..config.frame_names import check_frame_names
from .alignment import Aligned
from .clusters import score_covariance
from .parameters import Coordinates, ParameterSet
from .targets import AbstractTarget, CaseError
from .time_steps import StepTables, TimeSteps, is_stable


_MAX_TANGENT_BYTES = 2**30
"""Memory for the states of a batch of derivatives [bytes]."""
_MIN_CLUSTERS = 2
"""Clusters of residuals for each coordinate, to tell a covariance by."""
_REVERSE_ROOM = 2
"""Steps that loops of reverse mode have room for, over those that they are made for."""


@dataclass(frozen=True, eq=False)
class Case:
    """One run that is compared with data."""

    name: str
    scene: Scene
    """Scene with its own values, those of its config."""
    run: ParametricRun
    target: AbstractTarget

    def __post_init__(self):
        if tuple(self.run.save_times) != tuple(self.target.times):
            raise InputError(
                f"case {self.name}: its data are of {list(self.target.times)} s and "
                f"the run saves {list(self.run.save_times)} s"
            )


class RunDiagnostics(NamedTuple):
    """Results of the runs at one point in addition to their residuals."""

    longest_steps: Float[Array, " c"]
    """Longest stable step of each case [s]."""
    finite: Bool[Array, ""]
    """True if the runs are stable, and their temperatures finite."""
    errors: tuple[Float[Array, " t"], ...]
    """Root of the sum of squared residuals, of each case at each saved time."""

    def host_errors(self) -> tuple[Float[np.ndarray, " t"], ...]:
        """Errors in float64 on the host."""
        return tuple(np.asarray(rows, float) for rows in self.errors)


Views = tuple[tuple[LinearizedView, ...], ...]
"""Views of each case's cameras near their poses; none where no pose is fitted."""


class Traced(eqx.Module):
    """A function traced once, with the arrays that it closes over as arguments."""

    constants: tuple[jax.Array, ...]
    jaxpr: Any = eqx.field(static=True)
    outputs: Any = eqx.field(static=True)

    def __call__(self, *args: Any) -> Any:
        """Run the traced function."""
        run = jaxpr_as_fun(ClosedJaxpr(self.jaxpr, self.constants))
        return jax.tree.unflatten(self.outputs, run(*jax.tree.leaves(args)))


def trace(function: Callable[..., Any], *args: Any) -> Traced:
    """Trace a function for arguments of these shapes."""
    # A simulation closes over tables as long as the body's links. XLA would try to
    # fold them as constants, and each derivative would be traced from the start.
    closed, shapes = jax.make_jaxpr(function, return_shape=True)(*args)
    constants = tuple(jnp.asarray(value) for value in closed.consts)
    return Traced(constants, closed.jaxpr, jax.tree.structure(shapes))


@dataclass(frozen=True, eq=False)
class Problem:
    """Parameters and the cases that they are fitted to."""

    parameters: ParameterSet
    cases: tuple[Case, ...]
    time_norm: float = 2.0
    """Exponent p of the mean over saved times of |error|^p that is minimized."""
    aligned: Mapping[int, Aligned] = field(default_factory=dict)
    """Poses of cameras that their outlines gave, which count as data."""

    def __post_init__(self):
        if not self.cases:
            raise InputError("a fit needs one case at least")
        for case in self.cases:
            self.parameters.check(case.scene)
            check_frame_names(self.parameters.paths, case.target.camera_count)

    @property
    def dtype(self) -> Any:
        """Floating-point type of all runs."""
        return jnp.dtype(self.cases[0].scene.dtype)

    @property
    def known_sd(self) -> float | None:
        """Standard deviation of a residual due to noise; None if it is not known."""
        information = self._information
        return None if information is None else 1 / math.sqrt(sum(information))

    @property
    def _prior_unit(self) -> float:
        """Residual of a prior that is off by its own standard deviation.

        That of the noise, so that priors count as the data do.
        """
        return 1.0 if self.known_sd is None else self.known_sd

    @property
    def case_weights(self) -> tuple[float, ...]:
        """Factors of the residuals of each case, whose squares sum to 1 [-].

        Equal ones, so that priors weigh the same for any number of cases; where noise
        is known, those that make it alike in all residuals.
        """
        information = self._information or (1.0,) * len(self.cases)
        total = sum(information)
        return tuple(math.sqrt(value / total) for value in information)

    @property
    def _information(self) -> tuple[float, ...] | None:
        """Inverse variance of a residual of each case; None without known noise."""
        deviations = [case.target.known_sd for case in self.cases]
        information = tuple(1 / sd**2 for sd in deviations if sd is not None)
        # Percent of a reference and noise of a pixel have no common scale.
        if 0 < len(information) < len(deviations):
            raise InputError("cases: fit to references or to frames, not to both")
        return information or None

    @property
    def edges(self) -> tuple[int, ...]:
        """Edges of squares of the images, from a pixel to whole views."""
        return max((case.target.edges for case in self.cases), key=len)

    def clusters(
        self, edge: int | None = None, through_time: bool = True
    ) -> Int[np.ndarray, " r"] | None:
        """Numbers of the squares of images that data residuals belong to.

        None where there are no images. See `view_clusters` for the arguments.
        """
        clusters = []
        first = 0
        for case in self.cases:
            numbers = case.target.clusters(edge, through_time)
            if numbers is None:
                return None
            clusters.append(first + numbers)
            first += int(numbers.max()) + 1
        return np.concatenate(clusters)

    def start(self) -> Float[Array, " p"]:
        """Coordinates of the start values."""
        return jnp.zeros(self.parameters.size, self.dtype)

    def default(self) -> Float[np.ndarray, " p"]:
        """Coordinates of the values that the scene of the first case has itself."""
        return self.parameters.coordinates_of(self.cases[0].scene)

    @cached_property
    def time_steps(self) -> TimeSteps:
        """Steps in time of all runs, by the values."""
        return TimeSteps(
            runs=tuple(case.run for case in self.cases),
            fewest=tuple(case.run.fewest_steps(case.scene) for case in self.cases),
        )

    def step_tables_at(self, z: Coordinates) -> StepTables:
        """Steps that are stable at z, and somewhat beyond."""
        return self.time_steps.at(np.asarray(self.longest_steps(z), float))

    def views_at(self, z: Coordinates) -> Views:
        """Views of the cameras in their poses at z, rendered on the host."""
        if not self.parameters.moves_cameras:
            return ()
        count = self.cases[0].target.camera_count
        poses = np.asarray(self.parameters.poses(z, count), float)
        return tuple(case.target.views_at(poses, self.dtype) for case in self.cases)

    def residuals(
        self, z: Coordinates, step_tables: StepTables, views: Views = ()
    ) -> tuple[Float[Array, " r"], RunDiagnostics]:
        """Residuals of all cases, one after the other, then those of the priors.

        With poses of cameras among the parameters they are exact at the z of the
        `views`, and of the first order near it.
        """
        rows = []
        steps = []
        errors = []
        finite = jnp.asarray(True)
        weights = self.case_weights
        for n, (case, table) in enumerate(zip(self.cases, step_tables, strict=True)):
            scene = self.parameters.insert(case.scene, z)
            solution = case.run(scene, table)
            values = self.parameters.frame_values(z, views[n] if views else ())
            residual = case.target.residual(scene, solution, values)
            weighted = weights[n] * _emphasize_times(residual, self.time_norm)
            rows.append(weighted.reshape(-1))
            errors.append(jnp.sqrt(len(residual) * (residual * residual).sum(axis=1)))
            solver = case.run.solver
            longest = solver.longest_stable_step(solution.stable_step)
            steps.append(longest)
            # A run of longer steps may end in finite temperatures that are wrong.
            finite = finite & solution.finite & is_stable(table, longest)
        z = jnp.asarray(z)
        data = jnp.concatenate(rows)
        prior = self.parameters.prior_residual(z, "prior")
        unit = self._prior_unit
        smoothness = self.parameters.prior_residual(z, "smoothness")
        outlines = self._outline_rows(z)
        rows = [data, unit * prior, unit * smoothness, unit * outlines]
        all_rows = jnp.concatenate(rows)
        diagnostics = RunDiagnostics(
            longest_steps=jnp.stack([jnp.asarray(s, z.dtype) for s in steps]),
            finite=finite,
            errors=tuple(errors),
        )
        return jnp.where(finite, all_rows, jnp.inf).astype(z.dtype), diagnostics

    def _outline_rows(self, z: Coordinates) -> Float[Array, " q"]:
        """Deviations of cameras from where their outlines are [sd], as they weigh."""
        if not self.aligned:
            return jnp.zeros(0, z.dtype)
        poses = self.parameters.poses(z, max(self.aligned) + 1)
        rows = []
        for camera, aligned in self.aligned.items():
            if aligned.whiten is not None:
                weights = math.sqrt(aligned.effect) * aligned.whiten
                away = poses[camera] - jnp.asarray(aligned.pose, z.dtype)
                rows.append(jnp.asarray(weights, z.dtype) @ away[aligned.numbers])
        return jnp.concatenate([jnp.zeros(0, z.dtype), *rows])

    def has_enough_clusters(self, size: int) -> bool:
        """True if there are clusters for a covariance of so many coordinates."""
        clusters = self.clusters()
        if clusters is None or self.known_sd is None:
            return False
        return int(clusters.max()) + 1 >= _MIN_CLUSTERS * size

    def scatter(
        self, rows: Float[np.ndarray, "p r"], residual: Float[np.ndarray, " r"]
    ) -> Float[np.ndarray, "p p"] | None:
        """Covariance of the gradient J^T r, of a fit's residuals and `rows` of J^T.

        None where there are not enough clusters, see `has_enough_clusters`.
        """
        clusters = self.clusters()
        if clusters is None or not self.has_enough_clusters(len(rows)):
            return None
        data = len(clusters)
        data_scatter = score_covariance(rows[:, :data], residual[:data], clusters)
        return data_scatter + self.prior_scatter(rows[:, data:])

    def prior_scatter(self, rows: Float[np.ndarray, "p q"]) -> Float[np.ndarray, "p p"]:
        """Covariance of the gradient by priors and outlines, whose variance is known.

        `rows` are those of J^T of the residuals that follow the data's.
        """
        variance = np.ones(rows.shape[1])
        sharpened = [a for a in self.aligned.values() if a.whiten is not None]
        effects = [effect for a in sharpened for effect in [a.effect] * len(a.numbers)]
        variance[len(variance) - len(effects) :] = effects
        return (rows * (variance * self._prior_unit**2)) @ rows.T

    def case_errors(
        self, errors: tuple[Float[np.ndarray, " t"], ...]
    ) -> dict[str, CaseError]:
        """Errors of each case by its name, from those at its saved times."""
        return {
            case.name: case.target.case_error(at_times)
            for case, at_times in zip(self.cases, errors, strict=True)
        }

    def errors_at(
        self, points: Sequence[Float[np.ndarray, " p"]]
    ) -> list[dict[str, CaseError]]:
        """Errors of each case by its name, at each of some coordinates."""
        # One compiled program for all points.
        errors = []
        with precision(self.dtype.name):
            traced = self.trace(self.time_steps.fewest)

            @eqx.filter_jit
            def diagnose(traced, *arguments):
                _, diagnostics = traced(*arguments)
                return diagnostics

            for point in points:
                z = jnp.asarray(point, self.dtype)
                step_tables = self.step_tables_at(z)
                diagnostics = diagnose(traced, z, step_tables, self.views_at(z))
                errors.append(self.case_errors(diagnostics.host_errors()))
        return errors

    def longest_steps(self, z: Coordinates) -> Float[Array, " c"]:
        """Longest stable step of each case at z [s]; infinite for any step."""
        steps = [
            case.run.longest_step(self.parameters.insert(case.scene, z))
            for case in self.cases
        ]
        return jnp.stack([jnp.asarray(step, z.dtype) for step in steps])

    def with_reverse_mode(self, memory: int, step_tables: StepTables) -> "Problem":
        """Problem for reverse-mode derivatives, with memory for a run's states [bytes].

        Its loops have room for more steps than these, see `has_room`.
        """
        cases = []
        for case, table in zip(self.cases, step_tables, strict=True):
            room = 1 if case.run.is_always_stable else _REVERSE_ROOM
            loops = fixed_loops(table, room)
            run = replace(case.run, reverse=ReverseMode(memory, loops))
            cases.append(replace(case, run=run))
        return replace(self, cases=tuple(cases))

    def has_room(self, step_tables: StepTables) -> bool:
        """True if the loops of reverse mode have room for these steps."""
        return all(
            case.run.reverse is None or have_room(case.run.reverse.loops, table)
            for case, table in zip(self.cases, step_tables, strict=True)
        )

    def trace(self, step_tables: StepTables) -> Traced:
        """`residuals` as a traced function of coordinates, step tables and views."""
        start = self.start()
        return trace(self.residuals, start, step_tables, self.views_at(start))

    def batch(self) -> int:
        """Number of derivatives that the memory holds at once."""
        values = sum(
            int(np.prod(body.structure.state_shape))
            for case in self.cases
            for body in case.scene.bodies
        )
        # An estimate: a time loop keeps four arrays of the state's size per tangent.
        per_tangent = 4 * values * self.dtype.itemsize
        fitting = _MAX_TANGENT_BYTES // max(per_tangent, 1)
        return int(max(1, min(self.parameters.size, fitting)))


def _emphasize_times(rows: Float[Array, "t r"], power: float) -> Float[Array, "t r"]:
    """Scale residuals so that their squares sum to the mean over times of |e_t|^p.

    r' = r |e_t|^(p/2 - 1) n^(p/4 - 1/2) for n times, where e_t is the root of the sum
    of squares at time t. p = 2 changes nothing; a larger p weighs the worst times more.
    """
    if power == 2:
        return rows
    square = (rows * rows).sum(axis=1, keepdims=True)
    # The root has no slope at 0, where there is nothing to weigh.
    safe = jnp.where(square > 0, square, 1.0)
    weight = jnp.where(square > 0, safe ** (power / 4 - 0.5), 0.0)
    return rows * weight * len(rows) ** (power / 4 - 0.5)
