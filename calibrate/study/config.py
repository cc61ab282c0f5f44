"""Schema of a sweep: a scene, its loads, axes of values, and the reference."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Discriminator, Field, Tag

from jaxthermo.archive import file_hash, text_hash
from jaxthermo.config.loader import load_model, resolved
from jaxthermo.config.types.files import FoundPath
from jaxthermo.config.types.model import ByKind, KindModel, Mistake, Model, Short
from jaxthermo.config.types.quantities import Flag, NotEmpty, Number, Whole, refuse

from ..config.schema import AbsoluteReference, Changes, Name


_Key = Annotated[str, Field(min_length=1, max_length=200)]
_Count = Annotated[Whole, Field(ge=1, le=100_000)]
_Seed = Annotated[Whole, Field(ge=0)]


class _LoadConfig(Model):
    """One set of changes under which every choice is run."""

    name: Name
    set: Changes = {}


class FitValue(Model):
    """A fit of weights, which precedes the cases that run with them."""

    calibration: FoundPath
    """Config of the calibration; the changes of a choice apply to its scene too."""
    set: Changes = {}
    """Changes of the calibration by dotted key, such as `fit.time_norm`."""


class AxisValue(Model):
    """One value of an axis: changes of the scene, by dotted key."""

    label: Name
    set: Changes = {}
    fit: FitValue | None = None
    """Fit whose structure and weights the first body takes."""


class _ListAxis(Model):
    """Values of one number or word of the scene."""

    key: _Key
    """Dotted key that takes the values."""
    values: Annotated[tuple[Any, ...], NotEmpty]


class RangeAxis(Model):
    """A number of the scene between two bounds, in SI."""

    key: _Key
    """Dotted key that takes the values."""
    between: Annotated[tuple[Number, Number], BeforeValidator(lambda v: _pair(v))]
    """Lower and upper bound."""
    log: Flag = False
    """Spread the values evenly in their logarithm."""
    count: Annotated[Whole, Field(ge=2, le=10_000)] | None = None
    """Number of values in a grid, both bounds included."""

    def mistakes(self) -> list[Mistake]:
        """Bounds out of order, or without a logarithm."""
        low, high = self.between
        if not low < high:
            return [(("between",), f"{high:g} is not above {low:g}")]
        if self.log and low <= 0:
            return [(("between",), f"{low:g} has no logarithm: leave out `log`")]
        return []


def _pair(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise refuse("expected two numbers, [lower, upper]")
    return tuple(value)


def _axis_form(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "<labelled>"
    is_range = isinstance(value, dict) and "between" in value
    return "<range>" if is_range or isinstance(value, RangeAxis) else "<values>"


Axis: TypeAlias = Annotated[
    Annotated[Annotated[tuple[AxisValue, ...], NotEmpty], Tag("<labelled>")]
    | Annotated[_ListAxis, Tag("<values>")]
    | Annotated[RangeAxis, Tag("<range>")],
    Discriminator(_axis_form),
]


class _GridSampling(KindModel, kind="grid"):
    """Every combination of the values of all axes."""


class RandomSampling(KindModel, kind="random"):
    """Independent random values on every axis."""

    count: _Count
    seed: _Seed = 0


class SobolSampling(KindModel, kind="sobol"):
    """Points of a scrambled Sobol' sequence, which fill the axes evenly."""

    count: _Count
    seed: _Seed = 0


class ListSampling(KindModel, kind="list"):
    """Points by their labels: one on each axis, a list of them, or all of an axis.

    Every combination of the labels of a point is a choice.
    """

    points: Annotated[tuple[dict[str, Any], ...], NotEmpty]
    """Labels by the names of axes; an axis that is left out takes all its values."""


class OptunaSampling(KindModel, kind="optuna"):
    """A study of optuna that looks for small errors at little work."""

    count: _Count
    seed: _Seed = 0
    batch: Annotated[Whole, Field(ge=1, le=1000)] = 4
    """Number of choices per request, for any number of workers."""
    objective: Literal["front", "error"] = "front"
    """Error together with nodes times steps, or the error alone."""


_Sampling = Annotated[
    _GridSampling | RandomSampling | SobolSampling | ListSampling | OptunaSampling,
    ByKind(),
    Short("kind"),
]


class _FitComparison(Model):
    """A fit of the axes' parameters, whose optimum is compared with the sweep's."""

    calibration: FoundPath
    """Config of the calibration, with `reference: truth`."""


class _GoalConfig(Model):
    """Largest error of the best choice within a number of nodes."""

    nodes: Annotated[Whole, Field(ge=1)]
    """Largest number of nodes."""
    error_percent: Annotated[Number, Field(gt=0)]
    """Largest error at all saved times under all loads [%]."""


class SweepConfig(Model):
    """A complete sweep."""

    scene: FoundPath
    """Config file of the scene."""
    set: Changes = {}
    """Changes of all cases, by dotted key as after `--set`."""
    loads: Annotated[tuple[_LoadConfig, ...], NotEmpty] = (
        _LoadConfig(name="as given"),
    )
    """The error of a choice is the largest over its loads."""
    axes: dict[Name, Axis]
    """Values by the name of the axis."""
    sampling: _Sampling = _GridSampling()
    truth: AbsoluteReference
    """Runs of finer voxels, the reference of all errors."""
    repeats: Annotated[Whole, Field(ge=2, le=100)] = 5
    """Number of times that every loop is timed."""
    goals: tuple[_GoalConfig, ...] | None = None
    """Errors to which the page compares the best choices within numbers of nodes."""
    compare_with_fit: _FitComparison | None = None
    """Fit that is compared with a sweep over one or two weights."""

    def mistakes(self) -> list[Mistake]:
        """No axes, names given twice, and points that name nothing."""
        mistakes: list[Mistake] = []
        if not self.axes:
            mistakes.append((("axes",), "an empty sweep: give an axis at least"))
        mistakes += _repeated([load.name for load in self.loads], ("loads",))
        for name, axis in self.axes.items():
            mistakes += _repeated(_labels(axis), ("axes", name))
            in_grid = isinstance(self.sampling, _GridSampling | ListSampling)
            if in_grid and isinstance(axis, RangeAxis) and axis.count is None:
                message = "missing: how many values a grid has of it"
                mistakes.append((("axes", name, "count"), message))
        return [*mistakes, *self._points()]

    def _points(self) -> list[Mistake]:
        if not isinstance(self.sampling, ListSampling):
            return []
        mistakes: list[Mistake] = []
        for i, point in enumerate(self.sampling.points):
            for name, point_labels in point.items():
                where = ("sampling", "points", i, name)
                if name not in self.axes:
                    axes = ", ".join(self.axes)
                    mistakes.append((where, f"names no axis; there are {axes}"))
                    continue
                axis_labels = _labels(self.axes[name])
                mistakes += [
                    (
                        where,
                        f"the axis has no '{label}'; it has {', '.join(axis_labels)}",
                    )
                    for label in labels_of(point_labels)
                    if label not in axis_labels
                ]
        return mistakes


def _repeated(names: list[str], path: tuple[str, ...]) -> list[Mistake]:
    return [
        ((*path, i), f"'{name}' is there twice")
        for i, name in enumerate(names)
        if name in names[:i]
    ]


def text_of(value: Any) -> str:
    """Label of a plain value."""
    return value if isinstance(value, str) else json.dumps(value)


def labels_of(values: Any) -> list[str]:
    """Labels of a plain value, or of several in a list."""
    return [text_of(v) for v in (values if isinstance(values, list) else [values])]


def _labels(axis: Axis) -> list[str]:
    return [value.label for value in values_of(axis)]


def values_of(axis: Axis) -> Sequence[AxisValue]:
    """Values that an axis lists; those of a range in a grid, none without a count."""
    match axis:
        case _ListAxis(key=key, values=values):
            return [_value(key, value) for value in values]
        case RangeAxis(count=count):
            steps = range(count or 0)
            return [value_within(axis, i / (len(steps) - 1)) for i in steps]
    return axis


def value_within(axis: RangeAxis, position: float) -> AxisValue:
    """Value of a range at a position from 0 to 1, of six digits."""
    low, high = axis.between
    value = low + (high - low) * position
    if axis.log:
        value = low * (high / low) ** position
    # Six digits: a label is the value, and tells two of them apart.
    return _value(axis.key, float(f"{value:.6g}"))


def _value(key: str, value: Any) -> AxisValue:
    # Not checked: the label may be as long as the value.
    return AxisValue.model_construct(label=text_of(value), set={key: value})


def load_sweep(path: str | Path, overrides: Sequence[str] = ()) -> SweepConfig:
    """Read and check the config of a sweep; each mistake is a line of an `InputError`.

    Args:
        path: of the file, beside which the scene is searched for.
        overrides: texts "a.b=c", applied in order.
    """
    needs = "a sweep needs `scene`, `axes` and `truth`"
    return load_model(SweepConfig, path, overrides=overrides, needs=needs)


def sweep_hash(config: SweepConfig) -> str:
    """Hash of the config with the content of its scene's file [16 hex digits]."""
    values = resolved(config)
    values["scene"] = file_hash(config.scene)
    axes = (axis for axis in config.axes.values() if isinstance(axis, tuple))
    fits = [value.fit for axis in axes for value in axis if value.fit is not None]
    compared = [] if config.compare_with_fit is None else [config.compare_with_fit]
    # The contents of the calibrations count, not their names.
    values["calibrations"] = [file_hash(fit.calibration) for fit in (*fits, *compared)]
    text = json.dumps(values, sort_keys=True)
    return text_hash(text)
