"""A reduced model: a few modes, their loads and the surface that they make."""

import abc
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float

from ..arrays import (
    SplitTimes,
    Time,
    device_array,
    precision,
    product,
    split_times,
)
from ..errors import InputError
from ..integrate.run.abstract_solution import StoredSolution
from ..physics.time_varying import (
    SAMPLES,
    breakpoints,
    is_unknown_function,
    value_at,
)
from ..physics.windows import Window, over
from ..scene.compile.time_values import form_of
from ..scene.scene import Scene
from .modal_run import Schedule, doubled, is_left, schedule, traced_run
from .reduced_file import ModelFields, read_model, write_model


# Difference of loads that is none, over the largest of all [-].
_ROUNDING = 1e-9


class AbstractOffline(abc.ABC):
    """The scene that a model was made from, and its basis."""

    @abc.abstractmethod
    def run_of(self, model: "ReducedModel", scene: Scene) -> StoredSolution:
        """See `ReducedModel.simulate`."""

    @abc.abstractmethod
    def extended(self, model: "ReducedModel", scene: Scene) -> "ReducedModel":
        """See `ReducedModel.extend`."""


class _Function(Module):
    """Surface temperatures as a function of loads, for JAX to transform.

    y(t) = T_ref + C z(t) + D u(t),    dz/dt = A z + B u,    A diagonal.
    """

    rates: Float[Array, " m"]
    """-A [1/s]."""
    drive: Float[Array, "m k"]
    """B."""
    start: Float[Array, " m"]
    outputs: Float[Array, "m+k s"]
    """C and D in rows, each of which is read in one pass."""
    reference: Float[Array, " s"]
    """[K]"""
    plan: Schedule

    def __call__(self, amplitudes: Float[Array, "q k"]) -> Float[Array, "t s"]:
        """Temperature of every fragment at every saved time [K].

        Args:
            amplitudes: of every input at every knot, linear in between.
        """
        state, load = traced_run(
            self.rates,
            drive=self.drive,
            start=self.start,
            plan=self.plan,
            amplitudes=amplitudes,
        )
        above = product(jnp.concatenate([state, load], axis=1), self.outputs)
        # The reference is added last: differences keep their digits in float32.
        return self.reference[None] + above


# One program for all models of one size, which also returns the times as an array of
# JAX, without a dispatch of their own.
@jax.jit
def _evaluate(
    function: _Function, amplitudes: Float[Array, "q k"], times: Float[Array, " t"]
) -> tuple[Float[Array, "t s"], Float[Array, " t"]]:
    return function(amplitudes), times


@dataclass(frozen=True, eq=False)
class ReducedModel(ModelFields):
    """A linear scene by a few modes, from `reduce` or `load_reduced`.

        dz/dt = A z + B u,    y = T_ref + C z + D u,    A = -diag(rates),

    with loads u that are linear between knots, which it steps exactly.
    """

    offline: AbstractOffline | None = field(default=None, repr=False)
    """The scene and the basis; None for a model from a file."""

    @property
    def size(self) -> int:
        """Number of modes."""
        return len(self.rates)

    @cached_property
    def surface_temperature(self) -> Float[np.ndarray, "t s"]:
        """Surface temperatures of the model's own scene at its save times [K]."""
        return np.asarray(self().surface_temperature)

    def __call__(
        self, loads: Mapping[str, Any] | None = None, save_at: Any = None
    ) -> StoredSolution:
        """Run the model.

        Args:
            loads: other amplitudes of some inputs, by name: a number or a function of
                time, such as `Table` and `Until`, in the unit of the input.
            save_at: increasing times within the time of the model [s]; its own if None.

        Raises:
            InputError: for an unknown input, or times outside of the model's.
        """
        replaced_loads = {
            name: self._load(value) for name, value in (loads or {}).items()
        }
        names = [load.name for load in self.inputs]
        for name in replaced_loads:
            if name not in names:
                raise InputError(
                    f"reduced model: no input {name!r}; there are {', '.join(names)}"
                )
        times = self.times if save_at is None else tuple(map(float, save_at))
        knots = self._knots(list(replaced_loads.values()))
        columns = [
            self._own(column, knots)
            if name not in replaced_loads
            else sampled(replaced_loads[name], knots)
            for column, name in enumerate(names)
        ]
        rows = np.stack(columns, axis=1) if columns else np.zeros((len(knots), 0))
        return self.run(knots, rows, times)

    def simulate(self, scene: Scene) -> StoredSolution:
        """Run another scene of the same bodies, whose loads have the same patterns.

        It may have other amplitudes over time, and another start in the span of the
        model, at the same save times.

        Raises:
            InputError: naming what is outside of the model's span.
        """
        return self._known_offline("simulate").run_of(self, scene)

    def extend(self, scene: Scene) -> "ReducedModel":
        """The model with added vectors and inputs for the loads of another scene.

        Raises:
            InputError: if the other scene has other bodies, materials or coefficients,
                which need a model of their own.
        """
        return self._known_offline("extend").extended(self, scene)

    def _known_offline(self, method: str) -> AbstractOffline:
        if self.offline is None:
            raise InputError(
                f"reduced model: {method}() needs the scene, which its file does not "
                "have: reduce() the scene again"
            )
        return self.offline

    def save(self, path: str | Path) -> None:
        """Write the model as an `.npz` file: A, B, C, D and the range they hold in.

        Raises:
            InputError: if the file cannot be written.
        """
        write_model(Path(path), self)

    def _load(self, value: Any) -> Any:
        """A load of the caller in the form that steps use."""
        if not callable(value):
            return value
        end = self.knots[-1]
        return form_of(value, end=end, save_times=(end,), traced=False).value

    def _knots(self, values: list[Any]) -> tuple[float, ...]:
        """Knots of the scene's loads and of others."""
        events = [t for value in values for t in breakpoints(value)]
        varies = any(map(is_unknown_function, values))
        return knots_of(self.knots[-1], (*self.knots, *events), varies)

    def _own(self, column: int, knots: tuple[float, ...]) -> Float[np.ndarray, " q"]:
        """Amplitudes of an input of the scene at other knots."""
        at = np.asarray(knots)
        scene_knots = np.asarray(self.knots)
        values = self.amplitudes[:, column]
        first = np.minimum(
            np.searchsorted(scene_knots, at, "left"), len(scene_knots) - 1
        )
        last = np.maximum(np.searchsorted(scene_knots, at, "right") - 1, 0)
        at_knot = np.where(is_left(at), values[first], values[last])
        return np.where(
            scene_knots[first] == at, at_knot, np.interp(at, scene_knots, values)
        )

    def run(
        self,
        knots: tuple[float, ...],
        amplitudes: Float[np.ndarray, "q k"],
        times: tuple[float, ...],
    ) -> StoredSolution:
        """Run with the amplitudes of all inputs at knots, linear in between."""
        scene_rows = [self._own(n, knots) for n in range(len(self.inputs))]
        scene_amplitudes = np.reshape(scene_rows, (-1, len(knots))).T
        # Combined from the loads of another scene they have rounding errors.
        rounding = _ROUNDING * np.abs(scene_amplitudes).max(initial=0)
        if not np.allclose(amplitudes, scene_amplitudes, rtol=0, atol=rounding):
            self.warn_of_snapshots("loads")
        function = self._function(knots, times)
        with precision(self.dtype):
            surface, saved = _evaluate(
                function,
                np.array(amplitudes, self.dtype),
                np.array(times, self.dtype),
            )
        return StoredSolution(saved, surface, self.surfaces)

    def warn_of_snapshots(self, changed: str) -> None:
        """Warn that a model of snapshots runs with other loads, or another start."""
        if self.about.method == "pod":
            kelvin = max(self.about.estimate_kelvin)
            warnings.warn(
                "reduced model: it was made from snapshots of its scene's own run "
                f"(method='pod'), so that its stated error of {kelvin:.2g} K does not "
                f"hold for other {changed}, which may be off by much more: reduce() "
                f"the scene with method='krylov', or with these {changed}",
                stacklevel=4,
            )

    def as_function(
        self,
        knots: Sequence[float] | None = None,
        times: Sequence[float] | None = None,
    ) -> Callable[[Float[Array, "q k"]], Float[Array, "t s"]]:
        """The surface temperatures [K] as a function that JAX can transform.

        The function takes the amplitude of every input, in the order of `inputs`, at
        every knot.

        Args:
            knots: times between which the loads are linear, from 0 on, twice at a jump
                [s]; those of the scene, as in `knots`, if None.
            times: save times [s]; those of the model if None.
        """
        self.warn_of_snapshots("loads")
        function = self._function(knots, times)
        # A plain function, since jax.jit takes no module.
        return lambda amplitudes: function(amplitudes)

    def _function(
        self, knots: Sequence[float] | None, times: Sequence[float] | None
    ) -> _Function:
        run_knots = self.knots if knots is None else tuple(map(float, knots))
        saves = self.times if times is None else tuple(map(float, times))
        return replace(self._template, plan=schedule(run_knots, saves))

    @cached_property
    def _template(self) -> _Function:
        """The function with its arrays on the device, for the model's own plan."""
        # Evaluated, so that no array of a function that is being traced is kept.
        with precision(self.dtype), jax.ensure_compile_time_eval():
            return _Function(
                rates=device_array(self.rates, self.dtype),
                drive=device_array(self.drive, self.dtype),
                start=device_array(self.start, self.dtype),
                outputs=device_array(
                    np.concatenate([self.output.T, self.direct.T]), self.dtype
                ),
                reference=device_array(self.reference, self.dtype),
                plan=schedule(self.knots, self.times),
            )


def knots_of(t1: float, events: Iterable[float], varies: bool) -> tuple[float, ...]:
    """Knots at events within a run, and closer where values are unknown functions."""
    times = {0.0, t1, *(float(t) for t in events if 0 < t < t1)}
    if varies:
        times |= set(np.linspace(0.0, t1, SAMPLES + 1).tolist())
    return doubled(sorted(times))


def sampled(value: Any, knots: tuple[float, ...]) -> Float[np.ndarray, " q"]:
    """A number or a function of time at knots, before a jump at the first of a pair.

    Raises:
        InputError: if it is not one finite number at every time.
    """
    at = np.asarray(knots)
    starts = split_times(at[::2]).T
    lengths = at[1::2] - at[::2]

    def at_ends(start: SplitTimes, length: Time) -> Float[Array, "2 *_"]:
        local = over(value, Window(start, length))
        last = jnp.maximum(length - 8 * jnp.finfo(float).eps * start[0], 0)
        return jnp.stack(
            [value_at(local, jnp.zeros_like(length)), value_at(local, last)]
        )

    with precision("float64"):
        pairs = jax.vmap(at_ends)(jnp.asarray(starts), jnp.asarray(lengths))
        amplitudes = np.asarray(pairs, float).reshape(at.shape + pairs.shape[2:])
    if amplitudes.shape != at.shape or not np.isfinite(amplitudes).all():
        raise InputError("reduced model: a load is one finite number at every time")
    return amplitudes


def load_reduced(path: str | Path) -> ReducedModel:
    """Read a model from a file of `ReducedModel.save`.

    Raises:
        InputError: if it is missing, damaged, or of another version.
    """
    return ReducedModel(**vars(read_model(Path(path))))
