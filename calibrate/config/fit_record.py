"""`fit.json`: the schema of a fit's results, their file and its damage."""

from pathlib import Path
from typing import Any, NotRequired

from pydantic import ConfigDict, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from jaxthermo.archive import read_record, signed
from jaxthermo.atomic import write_json
from jaxthermo.config.messages import dotted, explain
from jaxthermo.errors import InputError


_KIND = "calibration result"
_VERSION = 1
_REMEDY = "run `calibrate fit` again"
# Keys that a text has no words for.
_FORBID = ConfigDict(extra="forbid")


class _BothErrors(TypedDict):
    default: float
    fitted: float


class _BothCases(TypedDict):
    default: dict[str, dict[str, Any]]
    fitted: dict[str, dict[str, Any]]


class _ErrorGroups(TypedDict):
    __pydantic_config__ = _FORBID  # type: ignore[misc]
    train: _BothErrors
    held_out: NotRequired[_BothErrors]


class _CaseGroups(TypedDict):
    __pydantic_config__ = _FORBID  # type: ignore[misc]
    train: _BothCases
    held_out: NotRequired[_BothCases]


# No class: `with` is a word of Python.
_Parameter = TypedDict(
    "_Parameter",
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


class _Loss(TypedDict):
    initial: float
    final: float


class _Times(TypedDict):
    fit: float
    one_run: float
    compile: float


class _Advice(TypedDict):
    what: str
    gain_nats: float


class _Verdict(TypedDict):
    pays: bool
    words: str
    times: int
    worse: int
    truth: NotRequired[dict[str, Any] | None]


class _TruthCase(TypedDict):
    default: dict[str, Any]
    fitted: dict[str, Any]
    reference: dict[str, Any]


class _TruthGroups(TypedDict):
    __pydantic_config__ = _FORBID  # type: ignore[misc]
    train: dict[str, _TruthCase]
    held_out: NotRequired[dict[str, _TruthCase]]


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


class _Truth(TypedDict):
    """Errors against finer voxels."""

    refinement: float
    structure: str
    points: int
    cases: _TruthGroups
    cost: list[_Cost]


class _Result(TypedDict):
    """Keys that `calibrate show` reads; further ones are not checked."""

    name: str | None
    verdict: _Verdict
    parameters: dict[str, _Parameter]
    loss: _Loss
    ended: str
    error_percent: _ErrorGroups
    errors: _CaseGroups
    truth: NotRequired[_Truth | None]
    advice: list[_Advice]
    speedup: dict[str, Any]
    steps: list[dict[str, Any]]
    run_time_s: _Times
    reference: str


_SCHEMA = TypeAdapter(_Result)


def write_fit(path: Path, result: dict[str, Any]) -> None:
    """Write the results of a fit with their format, version and checksum.

    Raises:
        InputError: if the file cannot be written.
    """
    write_json(path, signed(_KIND, _VERSION, result))


def read_fit(path: Path) -> dict[str, Any]:
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
    return result
