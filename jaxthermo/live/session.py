"""A simulation that goes on while its values are changed by hand.

It takes the steps of `simulate`, of one pass and none longer than a frame of the view,
and keeps its state where numbers of the terms change: the compiled program serves all
numbers. Another structure starts again.
"""

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array
from typing_extensions import override

from ..arrays import precision
from ..config.loader import load_config
from ..config.schema.scene import SceneConfig
from ..errors import InputError
from ..integrate.ledger import empty_ledger
from ..integrate.run.abstract_solution import irradiance_at
from ..integrate.run.plan import (
    Plan,
    initial_state,
    observation_time,
    plan_run,
    window_of,
)
from ..integrate.run.schedule import Interval
from ..integrate.run.segments import take_segment
from ..integrate.run.solution import observe
from ..integrate.solvers import ForwardEuler, SuperTimeStepping
from ..integrate.stepper import RunState
from ..physics.radiation.irradiation import Irradiance
from ..physics.term import AbstractTerm
from ..physics.time_varying import just_before
from ..scene.scene import Scene, SolvedSurface
from .live_run import AbstractLiveRun, Curves


STEPS_A_SECOND = 20
"""Smallest number of steps in a second of wall time: one for each frame."""

# Stable steps in one frame up to which Euler steps take less time than stages.
_MAX_EULER_STEPS = 10


# Limits of the rows of temperatures stored for curves: number, and memory [bytes].
_MAX_ROWS = 400
_MAX_BYTES = 2**26


class _Change(NamedTuple):
    """A scene with other values, planned but not in use yet."""

    values: Mapping[str, str]
    """Values that were changed by hand, as YAML by their paths in the config."""
    config: SceneConfig
    scene: Scene
    plan: Plan
    restarts: bool
    """True if the bodies are others, so that the simulation starts again."""
    compiles: bool
    """True if the program has to be compiled, which takes seconds."""


def _signature(tree: Any) -> tuple[Any, ...]:
    """Structure, shapes and types of a pytree, on which a compiled program depends."""
    leaves, structure = jax.tree.flatten(tree)
    arrays = jax.Array, np.ndarray, np.generic
    typed = (
        (leaf.shape, leaf.dtype) if isinstance(leaf, arrays) else leaf
        for leaf in leaves
    )
    return structure, *typed


class LiveSession(AbstractLiveRun):
    """The running simulation of a config, in simulated time.

    Args:
        path: of the config.
        overrides: changes of the config, as of `--set`.
        rate: simulated seconds per second, for which steps are short enough.

    Raises:
        InputError: for a mistake in the config.
    """

    def __init__(self, path: Path, overrides: tuple[str, ...] = (), rate: float = 10.0):
        self._path = path
        self._overrides = overrides
        self._rate = _checked_rate(rate)
        self._compiled: set[tuple[Any, ...]] = set()
        config = load_config(path, overrides)
        with precision(config.dtype):
            self._in_use = self._planned(
                {}, config=config, scene=config.build(), restarts=True
            )
        self.reset()

    @property
    def config(self) -> SceneConfig:
        """The config with the values in use."""
        return self._in_use.config

    @property
    def scene(self) -> Scene:
        """The scene in use."""
        return self._in_use.scene

    @property
    def plan(self) -> Plan:
        """Steps from the start with the values in use: those of `simulate`."""
        return self._in_use.plan

    @property
    @override
    def surfaces(self) -> tuple[SolvedSurface, ...]:
        return self.plan.compiled.surfaces

    @property
    @override
    def terms(self) -> tuple[AbstractTerm, ...]:
        return self.scene.terms

    @property
    @override
    def end(self) -> float:
        return self.config.time.last

    @property
    @override
    def finished(self) -> bool:
        return not self._left

    @property
    @override
    def time(self) -> float:
        if not self._left:
            return self.end
        return self._left[0].start + self._taken * self._left[0].dt

    @property
    @override
    def temperature(self) -> Float[np.ndarray, " s"]:
        if self._seen is None:
            with precision(self.config.dtype):
                self._seen = self._observed()
            self._keep(self._seen)
        return self._seen

    @override
    def irradiance(self) -> Irradiance:
        kelvin = self.temperature
        time = self.time
        with precision(self.config.dtype):
            radiation = self.plan.compiled.radiation.at(time)
            now = jnp.asarray(time, self.plan.dtype)
            return irradiance_at(radiation, just_before(now), jnp.asarray(kelvin))

    @override
    def curves(self, weights: csr_array) -> Curves:
        rows = [*self._kept, (self.time, self.temperature)]
        if len(rows) > 1 and rows[-2][0] == rows[-1][0]:
            rows.pop()
        kelvin = np.stack([weights @ row for _, row in rows], axis=1)
        return Curves(np.asarray([at for at, _ in rows]), kelvin)

    @override
    def reset(self) -> None:
        self._kept: list[tuple[float, Float[np.ndarray, " s"]]] = []
        with precision(self.config.dtype):
            self._go_on(initial_state(self.plan), self.plan.intervals)

    @override
    def advance_to(self, time: float, budget: float = math.inf) -> None:
        with precision(self.config.dtype):
            while self._left and budget > 0:
                due = self._steps_due(time, budget)
                if due <= 0:
                    return
                budget -= self._take(due)

    def prepare(self, changes: Mapping[str, str | None]) -> _Change:
        """Plan the scene with other values, as YAML by their paths in the config.

        None stands for what the config gives itself.

        Raises:
            InputError: for a mistake in them; the simulation stays as it is.
        """
        joined = {**self._in_use.values, **changes}
        values = {path: text for path, text in joined.items() if text is not None}
        texts = (f"{path}={value}" for path, value in values.items())
        config = load_config(self._path, (*self._overrides, *texts))
        restarts = (config.bodies, config.dtype) != (
            self.config.bodies,
            self.config.dtype,
        )
        with precision(config.dtype):
            if restarts:
                scene = config.build()
            else:
                # The same bodies, whose voxels and structures are known.
                scene = config.scene(self.scene.bodies, config.build_terms())
            return self._planned(values, config=config, scene=scene, restarts=restarts)

    def use(self, change: _Change) -> None:
        """Go on with other values; with other bodies from the start."""
        now = self.time
        self._in_use = change
        if change.restarts:
            self.reset()
            return
        with precision(self.config.dtype):
            # Other mechanisms act: their heat is counted anew.
            ledger = empty_ledger(
                len(self.plan.compiled.program.entries), self.plan.dtype
            )
            state = self.plan.stepper.begin(RunState(self._state.theta, ledger))
            left = tuple(_remainder(i, now) for i in self.plan.intervals if i.end > now)
            self._go_on(state, left)

    def change(self, changes: Mapping[str, str | None]) -> None:
        """Prepare other values and use them."""
        self.use(self.prepare(changes))

    def set_rate(self, rate: float) -> None:
        """Make steps for another rate, simulated seconds per second."""
        self._rate = _checked_rate(rate)
        self.change({})

    def _keep(self, kelvin: Float[np.ndarray, " s"]) -> None:
        """Store a row for curves, at intervals that the memory allows."""
        rows = min(_MAX_ROWS, max(2, _MAX_BYTES // kelvin.nbytes))
        now = self.time
        if not self._kept or now - self._kept[-1][0] >= self.end / rows:
            self._kept.append((now, kelvin))

    def _planned(
        self,
        values: Mapping[str, str],
        config: SceneConfig,
        scene: Scene,
        restarts: bool,
    ) -> _Change:
        longest = self._rate / STEPS_A_SECOND
        configured_solver = config.solver.build()
        end = config.time.last
        plan = plan_run(
            scene, t1=end, save_at=(end,), solver=configured_solver or ForwardEuler()
        )
        if configured_solver is None:
            stable = plan.stable_step
            assert stable is not None
            if longest > _MAX_EULER_STEPS * stable:
                solver = SuperTimeStepping(dt=longest)
                plan = plan_run(scene, t1=end, save_at=(end,), solver=solver)
        plan = plan._replace(
            intervals=tuple(_finer(i, longest) for i in plan.intervals)
        )
        signature = _signature((plan.stepper, plan.compiled.program))
        return _Change(
            values=values,
            config=config,
            scene=scene,
            plan=plan,
            restarts=restarts,
            compiles=signature not in self._compiled,
        )

    def _go_on(self, state: RunState, left: tuple[Interval, ...]) -> None:
        """Go on from a state with the intervals that are left, compiled."""
        self._state = state
        self._left = list(left)
        self._taken = 0
        self._interval: Interval | None = None
        self._seconds_a_step = 0.0
        if left:
            self._take(0)
        self._seen: Float[np.ndarray, " s"] | None = None
        self._compiled.add(_signature((self.plan.stepper, self.plan.compiled.program)))

    def _steps_due(self, time: float, budget: float) -> int:
        """Whole steps to a time, within the interval and the seconds of work."""
        interval = self._left[0]
        # A time that is a step but for rounding counts.
        due = math.floor((time - interval.start) / interval.dt + 1e-6) - self._taken
        due = min(due, interval.steps - self._taken)
        if self._seconds_a_step == 0.0 or math.isinf(budget):
            # The time that a step takes is not known yet.
            return due if math.isinf(budget) else min(due, 1)
        return min(due, max(1, int(budget / self._seconds_a_step)))

    def _take(self, steps: int) -> float:
        """Take steps of the interval; returns the seconds that it took."""
        interval = self._left[0]
        plan = self.plan
        clock = time.perf_counter()
        self._state = take_segment(
            plan,
            interval=interval,
            state=self._state,
            steps_taken=self._taken,
            steps=steps,
        )
        spent = time.perf_counter() - clock
        if not steps:
            return spent
        self._seconds_a_step = spent / steps
        self._seen = None
        self._taken += steps
        end = interval.start + self._taken * interval.dt
        self._interval = replace(interval, end=end, steps=self._taken)
        if self._taken == interval.steps:
            self._interval = interval
            self._left.pop(0)
            self._taken = 0
        return spent

    def _observed(self) -> Float[np.ndarray, " s"]:
        plan = self.plan
        interval = self._interval
        time = None
        # At the start no load has acted yet.
        start = 0.0
        if interval is None and self.time > 0:
            start = self.time
            at = just_before(start, plan.dtype)
            interval = Interval(start=at, end=at, steps=1, saved=False)
            time = jnp.zeros((), plan.dtype)
        elif interval is not None:
            start = interval.start
            time = jnp.asarray(observation_time(plan, interval), plan.dtype)
        program = plan.compiled.programs[plan.compiled.number_at(start)]
        window = None if interval is None else window_of(interval, plan.dtype)
        observation = observe(program, self._state, time, window)
        return np.asarray(observation.surface_temperature)


def _checked_rate(rate: float) -> float:
    if not (rate > 0 and math.isfinite(rate)):
        raise InputError(f"rate {rate:g}: give simulated seconds per second, above 0")
    return rate


def _finer(interval: Interval, longest: float) -> Interval:
    """An interval without steps longer than a frame [s]."""
    steps = math.ceil((interval.end - interval.start) / longest * (1 - 1e-9))
    return replace(interval, steps=max(interval.steps, steps))


def _remainder(interval: Interval, now: float) -> Interval:
    """Remainder of an interval after a time [s]."""
    if interval.start >= now:
        return interval
    left = (interval.end - now) / interval.dt
    return replace(interval, start=now, steps=max(1, math.ceil(left * (1 - 1e-9))))
