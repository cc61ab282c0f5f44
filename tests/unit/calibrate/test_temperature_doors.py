"""Starts, bounds, priors and scenes of a fit take the temperatures that scenes take."""

import pytest

import jaxthermo as jt
from calibrate.config.loader import load_calibration, scene_config
from calibrate.config.schema import (
    CalibrationConfig,
    ParameterConfig,
    default_bounds,
    deviation_in_si,
)
from calibrate.problem.build import _parameter
from calibrate.problem.parameters import Parameter, ParameterSet, Prior
from calibrate.study.config import SweepConfig
from jaxthermo.config.schema.dataset import DatasetConfig
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.config.types.model import field_parts, models_within
from jaxthermo.config.types.quantities import TEMPERATURE
from jaxthermo.temperatures import ALLOW_EXTREME
from tests.calibrating import SPHERE, scene


NAME = "convection.temperature"


def refusal(built, **options):
    block = scene((1.0, 0.0, 0.0))
    parameters = ParameterSet((built,))
    with pytest.raises(jt.InputError) as caught:
        parameters.check(block)
    message = str(caught.value)
    assert "\n" not in message
    allowed = jt.Scene(
        block.bodies, block.terms, dtype="float64", allow_extreme_temperatures=True
    )
    parameters.check(allowed)
    return message


@pytest.mark.parametrize(
    ("parameter", "message"),
    [
        (Parameter(NAME, (20.0,)), f"parameter {NAME}: start: 20 K is below 150 K"),
        (Parameter(NAME, (300.0,), 0.0), "bounds: 0 K is below 150 K"),
        (Parameter(NAME, (300.0,), 200.0, 1e5), "bounds: 100000 K is above 6000 K"),
        (
            Parameter(name=NAME, start=(300.0,), prior=Prior(25.0, 2.0)),
            "prior: mean: 25 K is below 150 K",
        ),
        (Parameter("temperature", (20.0,)), "parameter temperature: start: 20 K"),
        (Parameter("reflected_temperature", (20.0,)), "start: 20 K is below"),
    ],
)
def test_extreme_temperatures_are_refused_unless_the_scene_allows_them(
    parameter, message
):
    assert message in refusal(parameter)


def test_numbers_of_other_units_have_no_limits():
    ParameterSet((Parameter("convection.heat_transfer_coefficient", (20.0,)),)).check(
        scene((1.0, 0.0, 0.0))
    )
    ParameterSet((Parameter(NAME, (300.0,)),)).check(scene((1.0, 0.0, 0.0)))


@pytest.mark.parametrize(
    "name",
    [
        NAME,
        "temperature",
        "bodies.1.temperature",
        "terms.0.temperature.values.2",
        "surroundings.ground",
        "reflected_temperature",
    ],
)
def test_bounds_by_default_are_the_limits(name):
    lower, upper = default_bounds(name, 300.0)
    assert (lower, upper) == (150.0, 6000.0)
    parameter = Parameter(name=name, start=(300.0,), lower=lower, upper=upper)
    parameter.check_temperatures()


def test_bounds_by_default_where_extremes_are_allowed():
    assert default_bounds(NAME, 4.0, True) == (0.0, float("inf"))


@pytest.mark.parametrize(
    "model", [SceneConfig, DatasetConfig, CalibrationConfig, SweepConfig]
)
def test_files_that_check_temperatures_have_the_option_that_messages_name(model):
    checked = [
        (inner.__name__, key)
        for inner in models_within(model)
        for key in inner.model_fields
        if any(part is TEMPERATURE for part in field_parts(inner, key))
    ]
    assert not checked or ALLOW_EXTREME in model.model_fields


@pytest.mark.parametrize("text", ["2 K", "2 degC", "2 celsius", "2 kelvin", 2])
def test_a_deviation_of_a_temperature_is_a_difference(text):
    assert deviation_in_si(text, NAME) == 2.0
    prior = {"mean": "20 degC", "sd": text}
    config = ParameterConfig.model_validate({"name": NAME, "prior": prior})
    built = _parameter(config, scene((1.0, 0.0, 0.0)))
    assert built.prior == Prior(mean=293.15, sd=2.0)


def test_the_option_of_a_calibration_holds_for_its_scene(tmp_path):
    (tmp_path / "scene.yaml").write_text(SPHERE)
    file = tmp_path / "calibration.yaml"
    text = (
        "scene: scene.yaml\n"
        "set: {bodies.0.temperature: 100}\n"
        "train: [{name: one}]\n"
        "reference: {kind: simulated_frames, reflected_temperature: 90}\n"
        "parameters: [{name: weights.within}]\n"
    )
    file.write_text(text)
    with pytest.raises(jt.InputError, match=r"reflected_temperature: 90 K.*allow_extr"):
        load_calibration(file)
    file.write_text(text + "allow_extreme_temperatures: true\n")
    config = load_calibration(file)
    assert scene_config(config).allow_extreme_temperatures
    file.write_text(text.replace("90", "290"))
    with pytest.raises(jt.InputError, match=r"temperature: 100 K.*allow_extreme"):
        scene_config(load_calibration(file))
