"""`fit.json`: the schema of a fit's results, their file and its damage."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Generic, Literal, NotRequired, Required, TypeVar, cast

from pydantic import ConfigDict, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from jaxthermo.accuracy.error_records import ReferenceErrors, TruthErrors
from jaxthermo.archive import read_record, signed
from jaxthermo.atomic import write_json
from jaxthermo.config.messages import dotted, explain
from jaxthermo.errors import InputError


_KIND = "calibration result"
_VERSION = 1
_REMEDY = "run `calibrate fit` again"
# Keys that a text has no words for.
_FORBID = ConfigDict(extra="forbid")
_T = TypeVar("_T")

Group = Literal["train", "held_out"]
"""Cases that are fitted to, or those of the validation."""


class CaseErrors(TypedDict):
    """Errors of one case at its saved times."""

    times_s: list[float]
    rms_percent: list[float | None]
    """Percent of the reference's temperature range, or of the pixel noise."""
    rms_kelvin: list[float | None]
    """In kelvin, or in the unit of the frames."""
    worst_percent: float | None


class Pair(TypedDict, Generic[_T]):
    """Something with the scene's own values and with the fitted values."""

    default: _T
    fitted: _T


class _Groups(TypedDict, Generic[_T]):
    """Something of the cases that were fitted to, and of those held out."""

    __pydantic_config__ = _FORBID  # type: ignore[misc]
    train: _T
    held_out: NotRequired[_T]


def each_group(groups: _Groups[_T]) -> Iterator[tuple[Group, _T]]:
    """Groups that a record has, each with its name."""
    yield "train", groups["train"]
    if "held_out" in groups:
        yield "held_out", groups["held_out"]


def number_of(value: float | None) -> float:
    """Number in a record, where one that is not finite is None."""
    return math.nan if value is None else value


# No class: `with` is a word of Python.
ParameterRow = TypedDict(
    "ParameterRow",
    {
        "value": float,
        "initial": float,
        "standard_error": float | None,
        "verdict": str,
        "with": list[str],
        "unit": str,
        # Of a field with a row for all of its values.
        "count": NotRequired[int],
        "min": NotRequired[float],
        "max": NotRequired[float],
    },
)


ErrorsByCase = _Groups[Pair[dict[str, CaseErrors]]]
"""Errors by the name of the case."""


class _Loss(TypedDict):
    initial: float
    final: float


class _Times(TypedDict):
    fit: float
    one_run: float
    compile: float


class Advice(TypedDict):
    """A further measurement and the information that it would add."""

    what: str
    gain_nats: float


class ResidualScale(TypedDict):
    """Residuals of frames in the mean over squares of pixels, in units of the noise."""

    pixels: int
    """Edge of the squares [pixels]."""
    through_time: bool
    """True for squares at all saved times together."""
    groups: int
    """Number of squares."""
    times_noise: float
    """Root mean square of their sums, over what independent noise leaves there."""
    allowed: float
    """Value that noise alone exceeds in one of 10 000 fits."""


class TruthVerdict(TypedDict):
    """Errors against finer voxels at the worst times, and those of the reference."""

    times: int
    before_kelvin: float
    after_kelvin: float
    before_percent: float | None
    after_percent: float | None
    own_kelvin: float
    own_is_bound: bool
    worse: int


class Verdict(TypedDict):
    """Judgement of a fit as a whole."""

    pays: bool
    words: str
    """The judgement in one sentence."""
    times: int
    """Number of saved times that were compared."""
    worse: int
    """Number of times at which the error is larger than before."""
    truth: NotRequired[TruthVerdict | None]
    differences: NotRequired[list[str]]
    """Differences between the model and the frames that their noise does not allow."""


class TruthCase(Pair[TruthErrors]):
    """Errors of a case against finer voxels, and the error of these."""

    reference: ReferenceErrors


class _Cost(TypedDict):
    case: str
    refinement: float
    pitch_m: list[float]
    nodes: int
    steps: int
    memory_bytes: int
    run_time_s: float
    cached: bool
    warnings: list[str]


class TruthRecord(TypedDict):
    """Errors against finer voxels."""

    refinement: float
    structure: str
    points: int
    cases: _Groups[dict[str, TruthCase]]
    cost: list[_Cost]


class SpeedRatio(TypedDict):
    """Run time of the full volume over that of a structure: median and range."""

    times_faster: float | None
    min: float | None
    max: float | None


class Speedup(SpeedRatio):
    """Run times of the full volume, the scene's own values and the fitted values."""

    default: SpeedRatio
    nodes: dict[str, int]
    steps: dict[str, int]
    solver: NotRequired[dict[str, str]]
    run_time_s: dict[str, list[float]]


class Step(TypedDict, total=False):
    """A step of a fit."""

    step: Required[int]
    loss: Required[float]
    accepted: Required[bool]
    jacobian_computed: bool
    values: list[float]


class _Shown(TypedDict):
    # Keys that `calibrate show` reads, which files of all versions have.
    name: str | None
    verdict: Verdict
    parameters: dict[str, ParameterRow]
    loss: _Loss
    ended: str
    error_percent: _Groups[Pair[float]]
    """Largest errors [%]."""
    errors: ErrorsByCase
    truth: NotRequired[TruthRecord | None]
    advice: list[Advice]
    speedup: Speedup
    steps: list[Step]
    run_time_s: _Times
    reference: str


class FitRecord(_Shown):
    """Results of a fit as they are written; reading checks those that are shown."""

    correlation: list[list[float]]
    singular_values: list[float]
    config: dict[str, Any]
    program_hash: str
    config_hash: str
    seed: int
    versions: dict[str, str]
    device: NotRequired[str]
    processor: NotRequired[str]
    commit: NotRequired[str]
    date: NotRequired[str]
    by_clusters: NotRequired[bool]
    """True if standard errors allow for residuals that are alike."""
    widening: NotRequired[float]
    """Factor on standard errors from noise alone, for what residuals have beyond it."""
    residuals: NotRequired[list[ResidualScale]]
    """Residuals of frames in units of the noise, by squares of pixels."""
    shared_errors: NotRequired[dict[str, float]]
    """Declared relative standard deviations of factors that no residual shows."""


_SCHEMA = TypeAdapter(_Shown)


def write_fit(path: Path, result: FitRecord) -> None:
    """Write the results of a fit with their format, version and checksum.

    Raises:
        InputError: if the file cannot be written.
    """
    write_json(path, signed(_KIND, _VERSION, dict(result)))


def read_fit(path: Path) -> FitRecord:
    """Read the results of a fit.

    Raises:
        InputError: if the file is missing, damaged, or of another version.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file; `calibrate fit` makes it")
    result = read_record(path, format_name=_KIND, version=_VERSION, remedy=_REMEDY)
    try:
        _SCHEMA.validate_python(result, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = dotted(first["loc"])
        message = f"{path}: {where}: {explain(first)}; {_REMEDY}"
        raise InputError(message) from error
    return cast(FitRecord, result)
