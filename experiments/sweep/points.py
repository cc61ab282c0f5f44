"""Choices of a sweep: the points of its axes, and the cases of each."""

import importlib
import itertools
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from calibrate.runs.case import Case, changed_config
from jaxthermo.errors import InputError

from .config import (
    Axis,
    FitValue,
    ListAxis,
    ListSampling,
    OptunaSampling,
    RandomSampling,
    RangeAxis,
    SobolSampling,
    SweepConfig,
    range_values,
    text_of,
    value_within,
)


class Choice(NamedTuple):
    """A value on every axis."""

    labels: tuple[tuple[str, str], ...]
    """Label by the name of the axis."""
    set: dict[str, Any]
    """All changes by dotted key."""
    fit: FitValue | None = None
    """Fit whose weights it has; of several axes with one the last."""


class Value(NamedTuple):
    """A value of an axis: its label, its changes, and a fit."""

    label: str
    set: dict[str, Any]
    fit: FitValue | None = None


def values_of(axis: Axis) -> list[Value]:
    """Values that an axis lists; those of a range in a grid."""
    match axis:
        case ListAxis(key=key, values=values):
            return [Value(text_of(value), {key: value}) for value in values]
        case RangeAxis(key=key):
            return [Value(text_of(v), {key: v}) for v in range_values(axis)]
    return [Value(value.label, dict(value.set), value.fit) for value in axis]


def choices(config: SweepConfig) -> list[Choice]:
    """All choices of a sweep but of a study, each once.

    Raises:
        InputError: if there are none.
    """
    match config.sampling:
        case ListSampling(points=points):
            found = [made for point in points for made in _named(config.axes, point)]
        case RandomSampling(count=count, seed=seed):
            generator = np.random.default_rng(seed)
            found = _at(config.axes, generator.random((count, len(config.axes))))
        case SobolSampling(count=count, seed=seed):
            sequence = qmc.Sobol(len(config.axes), rng=np.random.default_rng(seed))
            # Whole powers of two keep the balance of the sequence.
            whole = sequence.random_base2(int(np.ceil(np.log2(max(count, 1)))))
            found = _at(config.axes, whole[:count])
        case OptunaSampling():
            return []
        case _:
            found = list(_named(config.axes, {}))
    unique = {choice.labels: choice for choice in found}
    if not unique:
        raise InputError("axes: an empty sweep: no choice is left")
    return list(unique.values())


def _named(axes: Mapping[str, Axis], point: Mapping[str, Any]) -> Iterator[Choice]:
    lists = []
    for name, axis in axes.items():
        given = point.get(name)
        wanted = given if isinstance(given, list | tuple) else [given]
        chosen = [text_of(label) for label in wanted]
        values = values_of(axis)
        lists.append([v for v in values if given is None or v.label in chosen])
    for combination in itertools.product(*lists):
        yield _choice(tuple(axes), combination)


def _at(axes: Mapping[str, Axis], unit: Float[np.ndarray, "n a"]) -> list[Choice]:
    """Choices at positions between 0 and 1 on every axis."""
    found = []
    for row in unit:
        pairs = zip(axes.values(), row.tolist(), strict=True)
        values = [_value_at(axis, position) for axis, position in pairs]
        found.append(_choice(tuple(axes), tuple(values)))
    return found


def _value_at(axis: Axis, position: float) -> Value:
    if isinstance(axis, RangeAxis):
        value = value_within(axis, position)
        return Value(text_of(value), {axis.key: value})
    listed = values_of(axis)
    return listed[min(int(position * len(listed)), len(listed) - 1)]


def _choice(names: tuple[str, ...], values: tuple[Value, ...]) -> Choice:
    labels = tuple(
        (name, value.label) for name, value in zip(names, values, strict=True)
    )
    changes: dict[str, Any] = {}
    for value in values:
        changes |= value.set
    fits = [value.fit for value in values if value.fit is not None]
    return Choice(labels, changes, fits[-1] if fits else None)


def cases_of(
    config: SweepConfig, choice: Choice, find_meshes: bool = True
) -> list[Case]:
    """Cases of a choice, one for each load.

    Raises:
        InputError: for a change that the scene cannot have, such as an axis that
            names nothing.
    """
    found = []
    for load in config.loads:
        changes = config.set, choice.set, load.set
        made = changed_config(config.scene, *changes, find_meshes=find_meshes)
        rest = choice.labels, load.name, config.truth
        found.append(Case(made, *rest, tuple(choice.set.items())))
    return found


class Study:
    """A study of optuna over the axes: asked for choices, told their results.

    The same results in the same order give the same choices, so that a sweep that is
    resumed asks for those that it has already.
    """

    def __init__(self, config: SweepConfig, sampling: OptunaSampling):
        """Begin a study.

        Raises:
            InputError: if optuna is not installed.
        """
        try:
            optuna = importlib.import_module("optuna")
        except ModuleNotFoundError as error:
            raise InputError(
                "sampling: a study needs optuna: install jaxthermo[search], or use "
                "another kind"
            ) from error
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._axes, self._pruned = config.axes, optuna.trial.TrialState.FAIL
        self._is_front = sampling.objective == "front"
        directions = ["minimize"] * (2 if self._is_front else 1)
        sampler = optuna.samplers.TPESampler(seed=sampling.seed)
        self._study = optuna.create_study(directions=directions, sampler=sampler)

    def ask(self, count: int) -> list[tuple[Any, Choice]]:
        """Ask for some choices, each with the trial that it belongs to."""
        found = []
        for _ in range(count):
            trial = self._study.ask()
            values = tuple(
                self._suggested(trial, name, axis) for name, axis in self._axes.items()
            )
            found.append((trial, _choice(tuple(self._axes), values)))
        return found

    def _suggested(self, trial: Any, name: str, axis: Axis) -> Value:
        if isinstance(axis, RangeAxis):
            return _value_at(axis, trial.suggest_float(name, 0.0, 1.0))
        listed = {value.label: value for value in values_of(axis)}
        return listed[trial.suggest_categorical(name, list(listed))]

    def tell(self, trial: Any, error: float | None, work: float) -> None:
        """Tell the error of a choice [%] and its work; no error for a failed one."""
        if error is None:
            self._study.tell(trial, state=self._pruned)
            return
        self._study.tell(trial, [error, work] if self._is_front else error)
