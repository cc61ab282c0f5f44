"""Parameters: their paths in a scene, their values, priors, and mistakes."""

import numpy as np
import pytest

import jaxthermo as jt
from calibrate.problem.parameters import (
    Parameter,
    ParameterSet,
    Prior,
    Smoothness,
    find_path,
    value_at,
)
from tests.calibrating import scene


@pytest.fixture(scope="module")
def loaded_scene():
    return scene((1.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("weights.within", 1.0),
        ("bodies.0.structure.weights.between", 1.0),
        ("material.conductivity", 16.0),
        ("convection.heat_transfer_coefficient", 30.0),
        ("terms.0.heat_flux", 2e4),
        ("temperature", 300.0),
    ],
)
def test_names_lead_to_their_values(loaded_scene, name, value):
    assert value_at(loaded_scene, find_path(loaded_scene, name)) == value


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("weights.witin", "did you mean 'within'"),
        ("wind.speed", "a scene has no 'wind'"),
        ("terms.7.heat_flux", "terms has no '7'"),
        ("material", "name one of its parts"),
    ],
)
def test_a_path_that_does_not_exist_is_reported(loaded_scene, name, message):
    with pytest.raises(jt.InputError, match=message):
        find_path(loaded_scene, name)


def test_the_scene_takes_the_values_of_coordinates(loaded_scene):
    parameter_set = ParameterSet(
        (
            Parameter(
                name="weights.within",
                start=(1.0, 1.0),
                lower=0.01,
                upper=100.0,
                is_scalar=False,
            ),
            Parameter("material.conductivity", (16.0,), 0.0, tied=("temperature",)),
        )
    )
    z = np.array([0.1, -0.2, 0.3])
    put = parameter_set.insert(loaded_scene, z)
    within = np.asarray(put.bodies[0].structure.weights.within)
    np.testing.assert_allclose(within, np.exp([0.1, -0.2]), rtol=0.02)
    k = float(np.asarray(value_at(put, find_path(put, "material.conductivity"))))
    assert k == pytest.approx(16 * np.exp(0.3))
    assert float(np.asarray(put.bodies[0].temperature)) == k
    np.testing.assert_allclose(
        parameter_set.coordinates(parameter_set.values(z)), z, atol=1e-12
    )


def test_of_capacities_only_ratios_count():
    """The first is fixed: a common factor would change nothing."""
    parameter = Parameter(
        name="weights.capacity",
        start=(1.0, 1.0),
        lower=0.01,
        upper=100.0,
        is_scalar=False,
        first_is_fixed=True,
    )
    parameter_set = ParameterSet((parameter,))
    assert parameter_set.labels == ("weights.capacity.1",)
    values = parameter_set.values(np.array([0.5]))["weights.capacity"]
    assert float(values[0]) == 1.0
    assert float(values[1]) > 1.4


def test_a_prior_counts_standard_deviations():
    normal = Prior(10.0, 2.0).residual(np.asarray(13.0))
    ratio = Prior(10.0, 0.1, log_normal=True).residual(np.asarray(11.0))
    assert float(normal) == pytest.approx(1.5)
    assert float(ratio) == pytest.approx(np.log(1.1) / 0.1)


def test_smoothness_is_0_where_all_are_alike_and_1_a_deviation_off():
    src = np.array([0, 0, 1, 2])
    dst = np.array([1, 2, 3, 3])
    smooth = Smoothness(src, dst, 0.5)
    assert float((smooth.residual(np.full(4, 3.0)) ** 2).sum()) < 1e-30
    # Links (0, 1) and (2, 3) above, the others below their nodes' means by 0.5.
    values = np.exp([0.5, -0.5, -0.5, 0.5])
    assert float((smooth.residual(values) ** 2).sum()) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Parameter(name="a", start=(5.0,), lower=0.0, upper=1.0),
            "not between its bounds 0 and 1",
        ),
        (
            lambda: Parameter(name="a", start=(0.5,), lower=1.0, upper=0.0),
            "lower one must be less",
        ),
        (lambda: ParameterSet(()), "nothing to fit"),
    ],
)
def test_mistakes_are_reported(make, message):
    with pytest.raises(jt.InputError, match=message):
        make()
