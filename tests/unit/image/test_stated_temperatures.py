"""Temperatures that noise, counts and isotherms are given have the limits of scenes."""

import numpy as np
import pytest
from pydantic import ValidationError

import jaxthermo as jt
from jaxthermo.config.schema.image import ImageConfig
from jaxthermo.config.types.model import build
from jaxthermo.image.radiance.band import LONG_WAVE
from jaxthermo.temperatures import ALLOW_EXTREME


MADE = {
    "detector_noise": lambda kelvin, **option: jt.DetectorNoise(
        reference_temperature=kelvin, **option
    ),
    "fixed_pattern_noise": lambda kelvin, **option: jt.FixedPatternNoise(
        reference_temperature=kelvin, **option
    ),
    "counts": lambda kelvin, **option: jt.Counts(kelvin, 8000.0, **option),
    "isotherm above": lambda kelvin, **option: jt.measurements.Isotherm(
        above=kelvin, **option
    ),
    "isotherm below": lambda kelvin, **option: jt.measurements.Isotherm(
        below=kelvin, **option
    ),
}


@pytest.mark.parametrize("make", MADE.values(), ids=MADE)
@pytest.mark.parametrize(
    ("kelvin", "message"),
    [
        (20.0, r"=20.0\): 20 K is below 150 K.*20 degC are 293.15 K"),
        (149.9, "149.9 K is below 150 K"),
        (6500.0, r"=6500.0\): 6500 K is above 6000 K"),
    ],
)
def test_extreme_ones_are_refused_unless_they_are_allowed(make, kelvin, message):
    with pytest.raises(jt.InputError, match=message) as caught:
        make(kelvin)
    assert f"if it is meant, {ALLOW_EXTREME}=True" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert make(kelvin, allow_extreme_temperatures=True)


@pytest.mark.parametrize("make", MADE.values(), ids=MADE)
@pytest.mark.parametrize("kelvin", [0.0, -20.0, np.nan, np.inf])
def test_what_is_no_temperature_is_never_allowed(make, kelvin):
    with pytest.raises(jt.InputError, match="give kelvin, finite and more than 0"):
        make(kelvin, allow_extreme_temperatures=True)


@pytest.mark.parametrize("kelvin", [150.0, 293.15, 6000.0])
def test_those_of_scenes_need_no_option(kelvin):
    assert jt.DetectorNoise(reference_temperature=kelvin)
    assert jt.measurements.Isotherm(above=kelvin)
    assert jt.FixedPatternNoise(reference_temperature=kelvin)


def test_both_ends_of_counts_are_checked():
    assert jt.Counts(150.0, 6000.0).high == 6000.0
    with pytest.raises(jt.InputError, match="high=6500.0.: 6500 K is above 6000 K"):
        jt.Counts(280.0, 6500.0)
    with pytest.raises(jt.InputError, match="two increasing"):
        jt.Counts(300.0, 280.0)


SETTINGS = [
    {"effects": [{"kind": "detector_noise", "reference_temperature": 100}]},
    {"effects": [{"kind": "fixed_pattern_noise", "reference_temperature": 7000}]},
    {"effects": [{"kind": "counts", "low": 100, "high": 300}]},
    {"effects": [{"kind": "counts", "low": 300, "high": 20_000}]},
    {"measurements": [{"kind": "isotherm", "above": 100}]},
    {"measurements": [{"kind": "isotherm", "above": 100, "below": 7000}]},
]


@pytest.mark.parametrize("settings", SETTINGS)
def test_the_option_of_a_file_is_that_of_python(settings):
    with pytest.raises(ValidationError, match=rf"`{ALLOW_EXTREME}: true`"):
        ImageConfig.model_validate(settings)
    config = ImageConfig.model_validate(settings, context={ALLOW_EXTREME: True})
    (built,) = build(config.effects) + build(config.measurements)
    assert built.allow_extreme_temperatures


def test_counts_of_a_cold_range_are_steps_of_radiance():
    """Of 8 bits between 90 and 140 K: within half a step, and the ends beyond them."""
    counts = jt.Counts(90.0, 140.0, bits=8, allow_extreme_temperatures=True)
    low, high = LONG_WAVE.radiance(np.array([90.0, 140.0]))
    radiance = LONG_WAVE.radiance(np.linspace(80.0, 150.0, 56).reshape(7, 8))
    read = np.asarray(counts.apply(radiance, 0.0, LONG_WAVE))
    step = (high - low) / 255
    inside = radiance.clip(low, high)
    assert np.abs(read - inside).max() <= step / 2 * (1 + 1e-9)
    whole = (read - low) / step
    np.testing.assert_allclose(whole, np.rint(whole), atol=1e-6)
