"""Choices of a sweep: the points of its axes, and the cases of each."""

import importlib
import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from jaxthermo.errors import InputError
from jaxthermo.extras import missing_package

from ..config.loader import changed_config
from ..config.schema import Changes
from .case import Case
from .config import (
    Axis,
    AxisValue,
    FitValue,
    ListSampling,
    OptunaSampling,
    RandomSampling,
    RangeAxis,
    SobolSampling,
    SweepConfig,
    labels_of,
    value_within,
    values_of,
)


class Choice(NamedTuple):
    """A value on every axis."""

    labels: tuple[tuple[str, str], ...]
    """Label by the name of the axis."""
    set: Changes
    """All changes by dotted key."""
    fit: FitValue | None = None
    """Fit whose weights it has; the last one if several axes have fits."""


def choices(config: SweepConfig) -> list[Choice]:
    """All choices of a sweep, each once; none for a study, which finds them.

    Raises:
        InputError: if there are none.
    """
    match config.sampling:
        case ListSampling(points=points):
            found_choices = [
                choice for point in points for choice in _named(config.axes, point)
            ]
        case RandomSampling(count=count, seed=seed):
            generator = np.random.default_rng(seed)
            found_choices = _at(
                config.axes, generator.random((count, len(config.axes)))
            )
        case SobolSampling(count=count, seed=seed):
            sequence = qmc.Sobol(len(config.axes), rng=np.random.default_rng(seed))
            # Whole powers of two keep the balance of the sequence.
            sequence_points = sequence.random_base2(
                int(np.ceil(np.log2(max(count, 1))))
            )
            found_choices = _at(config.axes, sequence_points[:count])
        case OptunaSampling():
            return []
        case _:
            found_choices = list(_named(config.axes, {}))
    unique = {choice.labels: choice for choice in found_choices}
    if not unique:
        raise InputError("axes: an empty sweep: no choice is left")
    return list(unique.values())


def _named(axes: Mapping[str, Axis], point: Mapping[str, Any]) -> Iterator[Choice]:
    named_values = (_named_values(axes[name], point.get(name)) for name in axes)
    for combination in itertools.product(*named_values):
        yield _choice(tuple(axes), combination)


def _named_values(axis: Axis, names: Any) -> Sequence[AxisValue]:
    """Values of an axis with one of some labels; all of them for None."""
    values = values_of(axis)
    if names is None:
        return values
    labels = labels_of(names)
    return [value for value in values if value.label in labels]


def _at(axes: Mapping[str, Axis], unit: Float[np.ndarray, "n a"]) -> list[Choice]:
    """Choices at positions between 0 and 1 on every axis."""
    choices = []
    for row in unit:
        values = tuple(
            _value_at(axis, position)
            for axis, position in zip(axes.values(), row.tolist(), strict=True)
        )
        choices.append(_choice(tuple(axes), values))
    return choices


def _value_at(axis: Axis, position: float) -> AxisValue:
    if isinstance(axis, RangeAxis):
        return value_within(axis, position)
    listed = values_of(axis)
    return listed[min(int(position * len(listed)), len(listed) - 1)]


def _choice(names: tuple[str, ...], values: tuple[AxisValue, ...]) -> Choice:
    labels = tuple(
        (name, value.label) for name, value in zip(names, values, strict=True)
    )
    changes: Changes = {}
    for value in values:
        changes |= value.set
    fits = [value.fit for value in values if value.fit is not None]
    return Choice(labels, set=changes, fit=fits[-1] if fits else None)


def cases_of(
    config: SweepConfig, choice: Choice, find_meshes: bool = True
) -> list[Case]:
    """Cases of a choice, one for each load.

    Raises:
        InputError: for a change that the scene cannot have, such as an axis that
            names nothing.
    """
    cases = []
    for load in config.loads:
        scene = changed_config(
            config.scene, config.set, choice.set, load.set, find_meshes=find_meshes
        )
        case = Case(
            config=scene,
            names=choice.labels,
            load=load.name,
            truth=config.truth,
            set=tuple(choice.set.items()),
        )
        cases.append(case)
    return cases


class Study:
    """A study of optuna over the axes, which proposes choices from earlier results.

    Equal results in equal order give equal choices, so that a resumed sweep proposes
    its finished choices again.
    """

    def __init__(self, config: SweepConfig, sampling: OptunaSampling):
        """Begin a study.

        Raises:
            InputError: if optuna is not installed.
        """
        try:
            optuna = importlib.import_module("optuna")
        except ModuleNotFoundError as error:
            raise missing_package(
                "sampling: a study needs",
                package="optuna",
                extra="search",
                otherwise="use another kind",
            ) from error
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._axes = config.axes
        self._failed = optuna.trial.TrialState.FAIL
        self._is_front = sampling.objective == "front"
        directions = ["minimize"] * (2 if self._is_front else 1)
        sampler = optuna.samplers.TPESampler(seed=sampling.seed)
        self._study = optuna.create_study(directions=directions, sampler=sampler)

    def ask(self, count: int) -> list[tuple[Any, Choice]]:
        """Propose some choices, each with its trial."""
        asked = []
        for _ in range(count):
            trial = self._study.ask()
            values = tuple(
                self._suggested(trial, name=name, axis=axis)
                for name, axis in self._axes.items()
            )
            asked.append((trial, _choice(tuple(self._axes), values)))
        return asked

    def _suggested(self, trial: Any, name: str, axis: Axis) -> AxisValue:
        if isinstance(axis, RangeAxis):
            return _value_at(axis, trial.suggest_float(name, 0.0, 1.0))
        listed = {value.label: value for value in values_of(axis)}
        return listed[trial.suggest_categorical(name, list(listed))]

    def tell(self, trial: Any, error: float | None, work: float) -> None:
        """Report the error of a choice [%] and its work; None for a failed one."""
        if error is None:
            self._study.tell(trial, state=self._failed)
            return
        self._study.tell(trial, [error, work] if self._is_front else error)
