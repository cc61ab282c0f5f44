"""Effects of surfaces, air, optics and detector on the frames of a camera."""

from typing import Annotated

from pydantic import Field
from typing_extensions import override

from ..types import quantities as si
from ..types.model import ByKind, Mistake, Model, Short, TemperatureModel


_Netd = Annotated[float, si.TEMPERATURE_DIFFERENCE, Field(ge=0, le=100)]
_Seed = Annotated[si.Whole, Field(ge=0, lt=2**63)]


class _AngularEmissivityConfig(
    Model, builds="AngularEmissivity", kind="angular_emissivity"
):
    """Emissivity that falls towards grazing angles."""

    exponent: Annotated[si.Number, Field(ge=1, le=100)] = 5.0


class _SpecularReflectionConfig(
    Model, builds="SpecularReflection", kind="specular_reflection"
):
    """Glossy reflection of sources, sky and ground."""

    fraction: si.Fraction = 0.5
    """Fraction of the reflected radiation that is in the lobe [-]."""
    exponent: Annotated[si.Number, Field(ge=1, le=1e5)] = 20.0
    """Phong's exponent, 5 for satin to 1000 for a polished surface [-]."""


class _AirConstantsConfig(Model, builds="AirConstants"):
    """Constants of a camera's law of air, which its radiometric files have."""

    x: si.Number = 1.9
    """Weight of the first exponential [-]."""
    alpha1: si.Number = 0.006569
    """Attenuation of dry air in the first exponential [m^-1/2]."""
    alpha2: si.Number = 0.01262
    """Attenuation of dry air in the second exponential [m^-1/2]."""
    beta1: si.Number = -0.002276
    """Attenuation by the square root of the water content, in the first exponential."""
    beta2: si.Number = -0.00667
    """Attenuation by the square root of the water content, in the second one."""
    b: Annotated[si.Number, Field(gt=0)] = 1501.0
    """Constant B of the counts that air mixes [K]."""


class _AtmosphereConfig(Model, builds="Atmosphere", kind="atmosphere"):
    """Air that dims surfaces by their distance and adds its own radiation."""

    temperature: Annotated[si.Temperature, Field(ge=150, le=400)]
    relative_humidity: si.Fraction = 0.5
    transmissivity: si.Fraction | None = None
    """Transmissivity of the whole path [-]; by default by FLIR's formula."""
    constants: _AirConstantsConfig = _AirConstantsConfig()
    """Constants of FLIR's formula."""


class _BlurConfig(Model, builds="Blur", kind="blur"):
    """Gaussian blur of the lens."""

    sigma: Annotated[si.Number, Field(gt=0, le=100)]
    """Standard deviation [pixels]."""


class _DiffractionBlurConfig(Model, builds="DiffractionBlur", kind="diffraction_blur"):
    """Blur by the aperture."""

    f_number: Annotated[si.Number, Field(gt=0)] = 1.0
    pixel_pitch: si.PositiveLength = 12e-6
    """Distance of the detector's pixels [m]."""
    wavelength: si.PositiveLength = 10e-6


class _BolometerLagConfig(Model, builds="BolometerLag", kind="bolometer_lag"):
    """Lag of a bolometer over the saved times."""

    time_constant: Annotated[si.PositiveTime, Field(le=1e6)] = 0.01


class _DetectorNoiseConfig(
    TemperatureModel, builds="DetectorNoise", kind="detector_noise"
):
    """Noise that differs from frame to frame."""

    netd: _Netd = 0.05
    """Noise equivalent temperature difference [K]."""
    reference_temperature: si.Temperature = 300.0
    """Temperature of the black surface at which `netd` holds [K]."""
    seed: _Seed = 0


class _FixedPatternNoiseConfig(
    TemperatureModel, builds="FixedPatternNoise", kind="fixed_pattern_noise"
):
    """Offsets of pixels and columns that all frames share."""

    netd: _Netd = 0.02
    """Standard deviation over the pixels [K]."""
    columns: _Netd = 0.0
    """Standard deviation over the columns [K]."""
    reference_temperature: si.Temperature = 300.0
    """Temperature of the black surface at which `netd` and `columns` hold [K]."""
    seed: _Seed = 0


class _CountsConfig(TemperatureModel, builds="Counts", kind="counts"):
    """Integer counts, linear in the radiance between two temperatures."""

    low: si.Temperature
    """Temperature of a black surface at count 0 [K]."""
    high: si.Temperature
    """Temperature of a black surface at the last count [K]."""
    bits: Annotated[si.Whole, Field(ge=8, le=16)] = 14

    @override
    def mistakes(self) -> list[Mistake]:
        return range_mistakes(self.low, self.high)


def range_mistakes(low: float | None, high: float | None) -> list[Mistake]:
    """The mistake of a range of temperatures [K] whose ends do not increase."""
    if low is None or high is None or low < high:
        return []
    return [(("high",), f"{high:g} K is not above `low`, {low:g} K")]


EffectConfig = Annotated[
    _AngularEmissivityConfig
    | _SpecularReflectionConfig
    | _AtmosphereConfig
    | _BlurConfig
    | _DiffractionBlurConfig
    | _BolometerLagConfig
    | _DetectorNoiseConfig
    | _FixedPatternNoiseConfig
    | _CountsConfig,
    ByKind(),
    Short("kind"),
]
