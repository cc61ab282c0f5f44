"""`model.npz`: a reduced model as matrices of a state space, to be handed over.

    dz/dt = A z + B u,    y = reference + C z + D u,    z(0) = start,

with the times and loads in which they hold, and the surface that y belongs to.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..archive import read_archive, select_arrays, write_archive
from ..choices import Dtype
from ..errors import InputError
from ..integrate.run.solution_arrays import BodyArrays, body_arrays, solved_surface
from ..scene.scene import SolvedSurface


_FORMAT_VERSION = 1
"""Version of the file's layout."""
_KIND = "reduced model"
_REMEDY = "reduce the scene again"


class LoadRange(NamedTuple):
    """An input of a reduced model and its range in the scene."""

    name: str
    unit: str
    low: float
    high: float


class About(NamedTuple):
    """Cost and accuracy of a reduced model in its own scene."""

    size: int
    nodes: int
    method: str
    offline_s: float
    """Time that it took to make [s]."""
    solves: int
    """Vectors that were solved for, from which the size was chosen."""
    estimate_kelvin: tuple[float, ...]
    """Estimate of the surface's root mean square error at each saved time [K]."""
    estimate_percent: float
    """Largest estimated error over the range of the surface at its time [%]."""
    residual_bound_kelvin: tuple[float, ...]
    """Bound of the root mean square error over the volume at each saved time, from the
    residual [K]."""
    scene_hash: str
    """16 digits of capacities, loads and readings."""


@dataclass(frozen=True, eq=False)
class ModelFields:
    """Fields of a `ReducedModel` that its file holds."""

    rates: Float[np.ndarray, " m"]
    """Decay of each mode [1/s]."""
    drive: Float[np.ndarray, "m k"]
    """B: growth of each mode by one unit of each input [1/s per unit]."""
    start: Float[np.ndarray, " m"]
    """Modes at time 0."""
    output: Float[np.ndarray, "s m"]
    """C: temperature of every fragment by each mode [K]."""
    direct: Float[np.ndarray, "s k"]
    """D: temperature of every fragment by one unit of each input [K per unit]."""
    reference: Float[np.ndarray, " s"]
    """Temperature of each fragment at modes and inputs of 0 [K]."""
    inputs: tuple[LoadRange, ...]
    knots: tuple[float, ...]
    """Times between which the scene's loads are linear; twice at a jump [s]."""
    amplitudes: Float[np.ndarray, "q k"]
    """The scene's loads at the knots."""
    times: tuple[float, ...]
    """Save times [s]."""
    surfaces: tuple[SolvedSurface, ...]
    about: About
    dtype: Dtype = "float32"


class _ModelArrays(NamedTuple):
    # The schema of the file.
    A: Float[np.ndarray, "m m"]
    B: Float[np.ndarray, "m k"]
    C: Float[np.ndarray, "s m"]
    D: Float[np.ndarray, "s k"]
    start: Float[np.ndarray, " m"]
    reference: Float[np.ndarray, " s"]
    knots: Float[np.ndarray, " q"]
    amplitudes: Float[np.ndarray, "q k"]
    times: Float[np.ndarray, " t"]
    input_low: Float[np.ndarray, " k"]
    input_high: Float[np.ndarray, " k"]


def write_model(path: Path, model: ModelFields) -> None:
    """Write the fields of a model in one step.

    Raises:
        InputError: if the file cannot be written.
    """
    arrays = _ModelArrays(
        A=np.diag(-model.rates),
        B=model.drive,
        C=model.output,
        D=model.direct,
        start=model.start,
        reference=model.reference,
        knots=np.asarray(model.knots, float),
        amplitudes=model.amplitudes,
        times=np.asarray(model.times, float),
        input_low=np.array([load.low for load in model.inputs], float),
        input_high=np.array([load.high for load in model.inputs], float),
    )
    words = {
        "input_names": [load.name for load in model.inputs],
        "input_units": [load.unit for load in model.inputs],
        "dtype": model.dtype,
        "about": model.about._asdict(),
    }
    # Texts are JSON, since an array of texts would need a longest length.
    stored: dict[str, np.ndarray] = arrays._asdict()
    stored["words"] = np.array(json.dumps(words))
    for b, surface in enumerate(model.surfaces):
        for name, value in body_arrays(surface, arrays.times).present().items():
            stored[f"body{b}_{name}"] = value
    write_archive(path, format_name=_KIND, version=_FORMAT_VERSION, arrays=stored)


def read_model(path: Path) -> ModelFields:
    """Read the fields of a model.

    Raises:
        InputError: if the file is missing, damaged, or of another version.
    """
    stored = read_archive(
        path, format_name=_KIND, version=_FORMAT_VERSION, remedy=_REMEDY
    )
    try:
        return _fields(stored)
    except InputError as error:
        raise InputError(f"{path}: {error}; {_REMEDY}") from error


def _number_type(name: object) -> Dtype:
    match name:
        case "float32":
            return "float32"
        case "float64":
            return "float64"
        case _:
            raise ValueError(f"{name!r} is no type of a model's numbers")


def _fields(stored: dict[str, np.ndarray]) -> ModelFields:
    arrays = select_arrays(_ModelArrays, stored)
    rates = -np.diagonal(arrays.A)
    if np.count_nonzero(arrays.A - np.diag(-rates)):
        raise InputError("A is not diagonal")
    try:
        words = json.loads(str(stored["words"]))
        about = About(**{k: _tuple(v) for k, v in words["about"].items()})
        inputs = tuple(
            LoadRange(name, unit=unit, low=float(low), high=float(high))
            for name, unit, low, high in zip(
                words["input_names"],
                words["input_units"],
                arrays.input_low,
                arrays.input_high,
                strict=True,
            )
        )
        dtype = _number_type(words["dtype"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError("its texts are missing or damaged") from error
    count = sum(name.endswith("_pitch") for name in stored)
    bodies = [select_arrays(BodyArrays, stored, f"body{b}_") for b in range(count)]
    surfaces = tuple(solved_surface(body, arrays.times) for body in bodies)
    return ModelFields(
        rates=rates,
        drive=arrays.B,
        start=arrays.start,
        output=arrays.C,
        direct=arrays.D,
        reference=arrays.reference,
        inputs=inputs,
        knots=tuple(arrays.knots.tolist()),
        amplitudes=arrays.amplitudes,
        times=tuple(arrays.times.tolist()),
        surfaces=surfaces,
        about=about,
        dtype=dtype,
    )


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
