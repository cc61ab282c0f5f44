"""Schema of a calibration config: what is fitted, to which data, and how; in SI."""

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag

from jaxthermo.config.schema.image import CameraConfig
from jaxthermo.config.schema.scene import lowest_of, unit_of as unit_in_scene
from jaxthermo.config.schema.structure import FullVolume, StructureConfig
from jaxthermo.config.types.files import FoundPath
from jaxthermo.config.types.model import ByKind, KindModel, Mistake, Model, Short
from jaxthermo.config.types.quantities import (
    ANGLE,
    LENGTH,
    NUMBER,
    TEMPERATURE,
    TEMPERATURE_DIFFERENCE,
    Flag,
    Fraction,
    Length,
    NotEmpty,
    Number,
    PositiveLength,
    Temperature,
    Unit,
    Whole,
    refuse,
    to_si,
)
from jaxthermo.errors import InputError
from jaxthermo.temperatures import UNITS, LinearUnit, temperature_limits

from .frame_names import is_of_camera, is_of_frames


_DEFAULT_BOUNDS: dict[str, tuple[float, float]] = {
    **dict.fromkeys(("within", "between", "surface", "capacity"), (0.01, 100.0)),
    "links": (0.1, 10.0),
    "surface_distance": (0.01, 100.0),
    "nearest_capacity": (-3.0, 3.0),
    "non_orthogonal": (-1.0, 2.0),
    "emissivity": (0.0, 1.0),
    "absorptivity": (0.0, 1.0),
    "rotation": (-math.radians(10), math.radians(10)),
    "translation": (-0.1, 0.1),
}
"""Bounds in SI by the last word of a parameter's name that is one of these."""

_FRAME_UNITS = {
    "reflected_temperature": TEMPERATURE,
    "rotation": ANGLE,
    "translation": LENGTH,
}
"""Units of numbers of frames, which no scene has."""


def _unit(name: str) -> Unit | None:
    if not is_of_frames(name):
        return unit_in_scene(name)
    words = [word for word in name.split(".") if word in _FRAME_UNITS]
    return _FRAME_UNITS[words[-1]] if words else None


def is_temperature(name: str) -> bool:
    """True for a parameter that is a temperature [K]."""
    return _unit(name) is TEMPERATURE


def unit_of(name: str) -> str:
    """SI unit of a parameter; empty for a factor."""
    unit = _unit(name)
    return "" if unit is None else unit.symbol


def shown_unit_of(name: str) -> tuple[str, float]:
    """Unit in which a parameter is reported, and its size in SI."""
    in_si = unit_of(name)
    if not is_of_camera(name):
        return in_si, 1.0
    return ("deg", math.radians(1)) if in_si == "rad" else ("mm", 1e-3)


def deviation_in_si(value: Any, name: str) -> float:
    """Convert a standard deviation of a parameter to SI: 2 degC of one are 2 K."""
    if not is_temperature(name):
        return value_in_si(value, name)
    try:
        return to_si(value, TEMPERATURE_DIFFERENCE)
    except InputError as error:
        raise ValueError(str(error)) from error


def value_in_si(value: Any, name: str) -> float:
    """Convert a number of a config, such as 16 or "16 W/(m K)", to SI."""
    # A bound may be infinite, which `to_si` refuses for all other numbers.
    if isinstance(value, str) and value.strip() in ("inf", "-inf"):
        return float(value)
    try:
        return to_si(value, _unit(name) or NUMBER)
    except InputError as error:
        raise ValueError(str(error)) from error


def default_bounds(
    name: str, start: float, allow_extreme_temperatures: bool = False
) -> tuple[float, float]:
    """Bounds of a parameter whose config has none: by its name, definition or sign."""
    if is_temperature(name):
        return temperature_limits(allow_extreme_temperatures)
    words = [word for word in name.split(".") if word in _DEFAULT_BOUNDS]
    if words:
        return _DEFAULT_BOUNDS[words[-1]]
    lowest = None if is_of_frames(name) else lowest_of(name)
    if lowest is None:
        lowest = 0.0 if start > 0 else -math.inf
    return lowest, math.inf


# The scene's own schema checks them when a case is built.
Changes = dict[str, Any]
"""Values of the scene's config by dotted key, replacing those in its file."""
Name = Annotated[str, Field(min_length=1, max_length=80)]


class CaseConfig(Model):
    """One run: the scene with some of its values changed."""

    name: Name
    set: Changes = {}


class _CandidateConfig(CaseConfig):
    """A run without data, as a candidate for a further measurement."""

    views: tuple[CameraConfig, ...] = ()
    """Cameras for frames; those of the reference by default."""


class FullVolumeReference(KindModel):
    """Runs of the same scene on every voxel, computed once and cached."""

    kind: Literal["full_volume"] = "full_volume"
    step: Annotated[Fraction, Field(gt=0)] = 0.25
    """Step over the stable one; of sheets, the root of its error in time over .16 %."""
    set: Changes = {}
    """Changes in all of them, such as the true values of the parameters."""


class _FinerRuns(Model):
    """Runs in fine voxels, once and cached, from which truth errors are measured.

    Their own error is estimated from two coarser runs each.
    """

    structure: StructureConfig = FullVolume()
    """Structure of the reference."""
    surface_cells: Literal["crossings", "dominant_axis"] = "crossings"
    """Surface of the reference's voxels, by default that of second order."""
    points: Annotated[Whole, Field(ge=100, le=10_000_000)] = 10_000
    """Number of points on the meshes at which temperatures are compared."""
    seed: Annotated[Whole, Field(ge=0)] = 0
    """Seed of the random points."""


class RefinedReference(_FinerRuns):
    """Runs of the same scenes in finer voxels, from which truth errors are measured.

    They are run once and cached, with two coarser runs each, from which their own error
    is estimated.
    """

    refinement: Annotated[Number, Field(ge=1, le=64)] = 2.0
    """Pitch of the judged scene over that of the reference."""


class AbsoluteReference(_FinerRuns):
    """One run of fine voxels under each load, the reference of all choices.

    It is run once and cached, with two coarser runs, from which its own error is
    estimated.
    """

    voxels_high: Annotated[Whole, Field(ge=8, le=4096)] | None = None
    """Number of voxels along z of the first body; others have the same pitch."""
    pitch: PositiveLength | None = None
    """Edge of a voxel of all bodies [m], instead of their number."""
    dtype: Literal["float32", "float64"] = "float32"
    """Precision of the reference, whatever that of the judged scene is."""

    exactly_one: ClassVar = (("voxels_high", "pitch"),)


class TruthRuns(KindModel):
    """The runs of finer voxels of the block `truth`, at the surface itself."""

    kind: Literal["truth"] = "truth"


class SolutionReference(KindModel):
    """Finished runs: the `solution.npz` of `jaxthermo simulate` for every case."""

    kind: Literal["solution"] = "solution"
    files: dict[str, FoundPath]
    """Files by the names of the cases."""


class FramesConfig(KindModel):
    """Frames of cameras, whatever their source."""

    views: tuple[CameraConfig, ...] = ()
    """Cameras; the scene's by default."""
    quantity: Literal["temperature", "radiance"] = "temperature"
    noise: Annotated[Number, Field(gt=0)] = 0.05
    """Standard deviation of a pixel [K or W/(m^2 sr)], known to the fit."""
    gain_uncertainty: Fraction = 0.0
    """Relative standard deviation of a factor that all radiances of the frames share:
    no residual shows it, and standard errors have it."""
    emissivity_uncertainty: Fraction = 0.0
    """Relative standard deviation of a factor that all emissivities of the scene share,
    likewise."""
    reflected_temperature: Temperature | None = None
    """Black surroundings that surfaces reflect [K]; those of the terms by default."""
    margin: Annotated[Number, Field(ge=0, le=1000)] = 3.0
    """Distance from outlines within which pixels are not compared where the poses of
    cameras are fitted [pixels]."""
    align: Flag = True
    """Find poses by the outlines first: the background has to be the scene's."""


class SimulatedFrames(FramesConfig):
    """Frames of runs with other values, made at the start, with noise."""

    kind: Literal["simulated_frames"] = "simulated_frames"
    set: Changes = {}
    """The truth: other parameters, a finer resolution, another structure."""
    noiseless: Flag = False
    """Do not add the noise, though the fit assumes it."""
    samples: Annotated[Whole, Field(ge=1, le=8)] = 1
    """Rays along each axis of a pixel, the mean of which a detector measures."""
    seed: Annotated[Whole, Field(ge=0)] = 0


class FramesOfCase(Model):
    """Frames of one case and one view, one file or page of a TIFF per saved time."""

    case: Name
    view: Annotated[Whole, Field(ge=0)] = 0
    files: Annotated[tuple[FoundPath, ...], NotEmpty]
    mask: FoundPath | None = None
    """Mask of these frames, instead of that of all."""


class _FlirConfig(Model, builds="FlirCalibration"):
    """Constants between temperatures and counts, which each file of a camera has."""

    r1: Annotated[Number, Field(gt=0)]
    b: Annotated[Number, Field(gt=0)]
    f: Number
    o: Number
    r2: Annotated[Number, Field(gt=0)]


class _LinearUnitConfig(Model):
    """Unit of numbers N whose temperatures are T = scale N + offset."""

    scale: Annotated[float, TEMPERATURE_DIFFERENCE, Field(gt=0)]
    """Kelvin for each number [K]."""
    offset: Annotated[float, TEMPERATURE] = 0.0
    """Temperature of the number 0 [K]."""


def _unit_tag(value: Any) -> str:
    return "<scale>" if isinstance(value, dict | Model) else "<name>"


_FrameUnit = Annotated[
    Annotated[
        Literal["kelvin", "K", "celsius", "degC", "°C", "centikelvin", "counts"],
        Tag("<name>"),
    ]
    | Annotated[_LinearUnitConfig, Tag("<scale>")],
    Discriminator(_unit_tag),
]


class _CorrectionConfig(Model):
    """Settings by which a program made temperatures of objects of those it measured."""

    emissivity: Annotated[Fraction, Field(gt=0)]
    """Emissivity of the object [-]."""
    reflected_temperature: Temperature = 293.15
    """Temperature of what it reflects [K]; programs take 20 degC by default."""


class _CameraSettingsConfig(Model):
    """Settings of a camera, instead of those that its files state."""

    emissivity: Annotated[Fraction, Field(gt=0)] | None = None
    """Emissivity of the object [-]; 1 leaves it, and what it reflects, to the scene."""
    reflected_temperature: Temperature | None = None
    """Temperature of what it reflects [K]."""
    distance: Annotated[Length, Field(ge=0)] | None = None
    """Distance of the object [m]."""
    air_temperature: Temperature | None = None
    """Temperature of the air between [K]."""
    relative_humidity: Fraction | None = None
    """Humidity of this air [-]."""
    window_transmissivity: Annotated[Fraction, Field(gt=0)] | None = None
    """Transmissivity of a window in front of the camera [-]."""
    window_temperature: Temperature | None = None
    """Temperature of the window [K]."""


class MeasuredFrames(FramesConfig):
    """EXR files of temperature or radiance, or TIFF, PNG, CSV or NPY of temperature.

    The JPEG files of FLIR cameras have a unit and constants of their own.
    """

    kind: Literal["frames"] = "frames"
    frames: Annotated[tuple[FramesOfCase, ...], NotEmpty]
    unit: _FrameUnit = "kelvin"
    """Unit of temperatures in the files, a name or its `scale` and `offset`; of counts
    `flir` has the constants."""
    flir: _FlirConfig | None = None
    camera_settings: _CameraSettingsConfig | None = None
    """Settings of the camera for counts, instead of those that JPEG files state."""
    corrected_for: _CorrectionConfig | None = None
    """Emissivity and reflection by which files hold temperatures of objects, which are
    turned back to the temperatures that the camera shows for an emissivity of 1."""
    mask: FoundPath | None = None
    """PNG, NPY or EXR of the frames' size; pixels that are 0 there, or not a number,
    are not compared."""

    def mistakes(self) -> list[Mistake]:
        """A unit, or settings of a camera, that do not fit the other values."""
        mistakes: list[Mistake] = []
        if (self.unit == "counts") != (self.flir is not None):
            mistakes.append(
                (("flir",), "goes with `unit: counts`: give both or neither")
            )
        if self.quantity == "radiance":
            for key in ("unit", "camera_settings", "corrected_for"):
                if getattr(self, key) not in (None, "kelvin", "K"):
                    message = "is of temperatures, and `quantity` is radiance"
                    mistakes.append(((key,), message))
        if self.unit == "counts" and self.corrected_for is not None:
            message = "is of temperatures: counts are never corrected"
            mistakes.append((("corrected_for",), message))
        return mistakes

    @property
    def linear_unit(self) -> LinearUnit | None:
        """Unit of temperatures; None for counts."""
        if isinstance(self.unit, _LinearUnitConfig):
            return LinearUnit(self.unit.scale, self.unit.offset)
        return UNITS.get(self.unit)


_ReferenceConfig = Annotated[
    FullVolumeReference
    | TruthRuns
    | SolutionReference
    | SimulatedFrames
    | MeasuredFrames,
    ByKind(),
    Short("kind", "full_volume"),
]


class PriorConfig(Model):
    """Normal prior of a parameter."""

    mean: Any
    sd: Any
    log_normal: Flag = False
    """Apply the prior to the logarithm; `sd` is then that of the logarithm."""


def _check_pair(value: Any) -> Any:
    if not isinstance(value, list) or len(value) != 2:
        raise refuse("expected two values, [lower, upper]")
    return value


class ParameterConfig(Model):
    """A fitted number of the scene."""

    name: Name
    """Path, such as `weights.within`, `material.conductivity`, `sun.irradiance`."""
    start: Any = None
    """Start value; the scene's by default."""
    bounds: Annotated[list[Any] | None, BeforeValidator(_check_pair)] = None
    """[lower, upper]; by the kind of the parameter by default."""
    per: Literal["level", "link"] | None = None
    """Fit one value per level or per link of the structure."""
    tied: tuple[Name, ...] = ()
    """Further paths that take the same value."""
    prior: PriorConfig | None = None
    bijection: Literal["auto", "softplus"] = "auto"
    smoothness: Annotated[Number, Field(gt=0)] | None = None
    """Standard deviation of log(value) of a link from its neighbours' mean."""

    def mistakes(self) -> list[Mistake]:
        """Numbers that cannot be read, and smoothness without values per link."""
        mistakes: list[Mistake] = []
        for key, value in (("start", self.start), ("bounds", self.bounds)):
            for number in value if isinstance(value, list) else [value]:
                problem = _problem(number, self.name)
                if problem is not None:
                    mistakes.append(((key,), problem))
        if self.smoothness is not None and self.per != "link":
            mistakes.append((("smoothness",), "is for `per: link` only"))
        return mistakes


def _problem(value: Any, name: str) -> str | None:
    # The unit depends on the parameter's name, so that no field type can check it.
    if value is None:
        return None
    try:
        number = value_in_si(value, name)
    except ValueError as error:
        return str(error)
    return None if not math.isnan(number) else "is no number"


class FitConfig(Model):
    """Settings of the optimization."""

    method: Literal["levenberg_marquardt", "gauss_newton", "bfgs", "lbfgs"] = (
        "levenberg_marquardt"
    )
    tolerance: Annotated[Number, Field(gt=0, lt=1)] = 1e-3
    """Relative change of error or values in two steps that ends the fit."""
    max_steps: Annotated[Whole, Field(ge=1, le=10_000)] = 50
    huber: Annotated[Number, Field(gt=0)] | None = None
    """Residual beyond which it counts linearly [standard deviations of the noise; of
    references without noise, of the residuals at the start by their median]."""
    time_norm: Annotated[Number, Field(ge=2, le=16)] = 2.0
    """Exponent p of the mean of |error|^p over saved times: 2 for the mean square, more
    for the worst time."""
    memory: Annotated[Number, Field(gt=0)] = 1.0
    """Memory for the states of a run in reverse mode [GiB]."""
    starts: Annotated[Whole, Field(ge=1, le=1000)] = 1
    """Number of start points; the fit continues from the best."""
    spread: Annotated[Number, Field(gt=0, le=5)] = 0.5
    """Standard deviation of the start points in unconstrained coordinates."""
    seed: Annotated[Whole, Field(ge=0)] = 0


class CalibrationConfig(Model):
    """A complete calibration."""

    name: Name | None = None
    scene: FoundPath
    """Config file of the scene."""
    allow_extreme_temperatures: Flag | None = None
    """Accept temperatures below 150 K and above 6000 K here and in the scene: of
    frames, starts, bounds and priors."""
    set: Changes = {}
    """Changes in every case."""
    train: Annotated[tuple[CaseConfig, ...], NotEmpty]
    held_out: tuple[CaseConfig, ...] = ()
    """Cases for validation only."""
    candidates: tuple[_CandidateConfig, ...] = ()
    """Possible further measurements, ranked by the information they would add."""
    reference: _ReferenceConfig = FullVolumeReference()
    truth: RefinedReference | None = None
    """Finer runs: the verdict has the errors against them before and after the fit."""
    parameters: Annotated[tuple[ParameterConfig, ...], NotEmpty]
    fit: FitConfig = FitConfig()

    def mistakes(self) -> list[Mistake]:
        """Names given twice, and a truth of what was measured."""
        # Results, references and frames are found by the names of their cases.
        mistakes: list[Mistake] = []
        seen: list[str] = []
        for group in ("train", "held_out", "candidates"):
            for n, case in enumerate(getattr(self, group)):
                if case.name in seen:
                    mistakes.append(
                        ((group, n, "name"), f"'{case.name}' is there twice")
                    )
                seen.append(case.name)
        if self.truth is not None and isinstance(self.reference, FramesConfig):
            message = "needs a `reference` of runs: full_volume, truth or solution"
            mistakes.append((("truth",), message))
        moves = any(is_of_camera(p.name) for p in self.parameters)
        if moves and self.fit.method != "levenberg_marquardt":
            message = "poses of cameras need levenberg_marquardt"
            mistakes.append((("fit", "method"), message))
        if moves and self.fit.starts > 1:
            message = "poses of cameras are fitted from one start"
            mistakes.append((("fit", "starts"), message))
        if self.truth is None and isinstance(self.reference, TruthRuns):
            message = "`truth` needs the block `truth`: give `truth: {}`"
            mistakes.append((("reference",), message))
        return mistakes
