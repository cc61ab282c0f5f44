"""The config of a calibration: what is fitted, to what, and how; checked, in SI."""

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from jaxthermo.config.schema.image import CameraConfig
from jaxthermo.config.types.files import FoundPath
from jaxthermo.config.types.model import ByKind, KindModel, Mistake, Model, Short
from jaxthermo.config.types.quantities import (
    Flag,
    Fraction,
    NotEmpty,
    Number,
    Whole,
    refuse,
)

from ..problem.parameter_units import value_in_si


Settings = dict[str, Any]
"""Places of the scene's config, dotted, and what stands there instead."""

Name = Annotated[str, Field(min_length=1, max_length=80)]


class CaseConfig(Model):
    """One run: the scene with some of its values changed."""

    name: Name
    set: Settings = {}


class FurtherConfig(CaseConfig):
    """A run that might be measured too; there are no data of it."""

    views: tuple[CameraConfig, ...] = ()
    """Of frames; those of the reference if there are none."""


class FullVolumeReference(KindModel):
    """Runs of the same scene on every voxel, made once and kept."""

    kind: Literal["full_volume"] = "full_volume"
    step: Annotated[Fraction, Field(gt=0)] = 0.25
    """Of its stable step."""
    set: Settings = {}
    """Changed in all of them, as the true values of what is fitted."""


class SolutionReference(KindModel):
    """A finished run for every case: `solution.npz` of `jaxthermo simulate`."""

    kind: Literal["solution"] = "solution"
    files: dict[str, FoundPath]
    """By the names of the cases."""


Quantity = Literal["temperature", "radiance"]
Noise = Annotated[Number, Field(gt=0)]


class SimulatedFrames(KindModel):
    """Frames of runs that are made here, with other values and noise."""

    kind: Literal["simulated_frames"] = "simulated_frames"
    set: Settings = {}
    """The truth: other parameters, a finer resolution, another structure."""
    views: tuple[CameraConfig, ...] = ()
    """The scene's camera if there are none."""
    quantity: Quantity = "temperature"
    noise: Noise = 0.05
    """Standard deviation of a pixel [K or W/(m^2 sr)]; added, and known to the fit."""
    noiseless: Flag = False
    """Whether it is only known to the fit, and not added."""
    seed: Annotated[Whole, Field(ge=0)] = 0


class FramesOfCase(Model):
    """The frames of one case and one view, one file a saved time."""

    case: Name
    view: Annotated[Whole, Field(ge=0)] = 0
    files: Annotated[tuple[FoundPath, ...], NotEmpty]


class MeasuredFrames(KindModel):
    """EXR files, with a channel "apparent_temperature" or "radiance"."""

    kind: Literal["frames"] = "frames"
    frames: Annotated[tuple[FramesOfCase, ...], NotEmpty]
    views: tuple[CameraConfig, ...] = ()
    quantity: Quantity = "temperature"
    noise: Noise = 0.05
    mask: FoundPath | None = None
    """A PNG of the frames' size: only pixels that are not black count."""


ReferenceConfig = Annotated[
    FullVolumeReference | SolutionReference | SimulatedFrames | MeasuredFrames,
    ByKind(),
    Short("kind", "full_volume"),
]


class PriorConfig(Model):
    """What is known of a parameter beforehand: a normal distribution."""

    mean: Any
    sd: Any
    of_logarithm: Flag = False


def _listed(value: Any) -> Any:
    if not isinstance(value, list) or len(value) != 2:
        raise refuse("expected two values, [lower, upper]")
    return value


class ParameterConfig(Model):
    """A number of the scene that is fitted."""

    name: Name
    """Such as `weights.within`, `material.conductivity`, `sun.irradiance`."""
    start: Any = None
    """The scene's own value if not given."""
    bounds: Annotated[list[Any] | None, BeforeValidator(_listed)] = None
    """By what it is if not given."""
    each: Literal["level", "link"] | None = None
    """One value a level of the structure, or a link."""
    also: tuple[Name, ...] = ()
    """Places tied to the same value."""
    prior: PriorConfig | None = None
    bijection: Literal["auto", "softplus"] = "auto"
    smoothness: Annotated[Number, Field(gt=0)] | None = None
    """Of one value a link: standard deviation of a logarithm beside its neighbours'."""

    def mistakes(self) -> list[Mistake]:
        """Numbers that cannot be read, and a smoothness of what is no field."""
        found: list[Mistake] = []
        for key, value in (("start", self.start), ("bounds", self.bounds)):
            for item in value if isinstance(value, list) else [value]:
                problem = _problem(item, self.name)
                if problem is not None:
                    found.append(((key,), problem))
        if self.smoothness is not None and self.each != "link":
            found.append((("smoothness",), "is for `each: link` only"))
        return found


def _problem(value: Any, name: str) -> str | None:
    if value is None:
        return None
    try:
        number = value_in_si(value, name)
    except ValueError as error:
        return str(error)
    return None if not math.isnan(number) else "is no number"


class FitConfig(Model):
    """How the best values are looked for."""

    method: Literal["levenberg_marquardt", "gauss_newton", "bfgs", "lbfgs"] = (
        "levenberg_marquardt"
    )
    tolerance: Annotated[Number, Field(gt=0, lt=1)] = 1e-3
    """Relative change of the error by two steps, or of the values, at which it ends."""
    most_steps: Annotated[Whole, Field(ge=1, le=10_000)] = 50
    huber: Annotated[Number, Field(gt=0)] | None = None
    """Misfit, in root mean squares at the start, above which it counts linearly."""
    worst: Annotated[Number, Field(ge=2, le=16)] = 2.0
    """Power of the times' errors that is summed: 2 for their mean, more for the worst
    time."""
    memory: Annotated[Number, Field(gt=0)] = 1.0
    """For the states of a run in reverse mode [GiB]."""
    starts: Annotated[Whole, Field(ge=1, le=1000)] = 1
    """Points that are tried first; the fit goes on from the best."""
    spread: Annotated[Number, Field(gt=0, le=5)] = 0.5
    """Of these points, in free numbers."""
    seed: Annotated[Whole, Field(ge=0)] = 0


class CalibrationConfig(Model):
    """A fit, complete."""

    name: Name | None = None
    scene: FoundPath
    """The config of a scene."""
    set: Settings = {}
    """Changed in every case."""
    train: Annotated[tuple[CaseConfig, ...], NotEmpty]
    held_out: tuple[CaseConfig, ...] = ()
    """Not fitted to; their error is told beside."""
    further: tuple[FurtherConfig, ...] = ()
    """That might be measured too: advice says which would tell most."""
    reference: ReferenceConfig = FullVolumeReference()
    parameters: Annotated[tuple[ParameterConfig, ...], NotEmpty]
    fit: FitConfig = FitConfig()

    exactly_one: ClassVar = ()

    def mistakes(self) -> list[Mistake]:
        """Names given twice."""
        found: list[Mistake] = []
        seen: list[str] = []
        for group in ("train", "held_out", "further"):
            for n, case in enumerate(getattr(self, group)):
                if case.name in seen:
                    found.append(((group, n, "name"), f"'{case.name}' is there twice"))
                seen.append(case.name)
        return found
