"""Configs of calibrations: every shipped one loads, and mistakes are one line each."""

from pathlib import Path

import numpy as np
import pytest

import jaxthermo as jt
from calibrate.config.loader import calibration_hash, load_calibration, scene_config
from calibrate.problem.build import _build_parameters


ROOT = Path(__file__).resolve().parents[3]
SHIPPED = sorted((ROOT / "configs" / "calibration").glob("*.yaml"))
QUICK = ROOT / "configs" / "calibration" / "figurine-quick.yaml"
NEEDS_FILES = ("buddha", "planck", "transfer")


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_shipped_configs_load_with_all_their_scenes(path):
    config = load_calibration(path)
    assert config.name == path.stem
    if path.stem.startswith(NEEDS_FILES):
        pytest.skip("needs meshes that are not part of the repository")
    for case in (*config.train, *config.held_out, *config.candidates):
        assert scene_config(config, case.set).time.save_times


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("parameters.0.name=weights.witin", "did you mean 'within'"),
        ("parameters.0.bounds=[2, 3]", "not between its bounds 2 and 3"),
        ("parameters.0.bounds=[1]", "expected two values"),
        ("parameters.0.start=warm", "expected a number"),
        ("parameters.1.smoothness=0.1", "is for `per: link` only"),
        ("parameters.0.prior={mean: 1, sd: 0}", "Prior.sd=0.0.: give a positive"),
        ("parameters.0.prior={mean: 1, sd: -1}", "Prior.sd=-1.0.: give a positive"),
        (
            "parameters.0.prior={mean: 0, sd: 1, log_normal: true}",
            "parameter weights.non_orthogonal: Prior.mean=0.0.: give a positive number",
        ),
        ("fit.method=newton", "did you mean 'gauss_newton'"),
        ("train=[]", "must not be empty"),
        ("held_out.0.name=+x", "'\\+x' is there twice"),
        ("reference=guess", "full_volume"),
        ("scene=nowhere.yaml", "there is no file"),
        ("colour=red", "unknown key"),
    ],
)
def test_mistakes_are_told_in_one_line(change, message):
    with pytest.raises(jt.InputError, match=message) as raised:
        config = load_calibration(QUICK, (change,))
        _build_parameters(config, _scene(config))
    assert "\n" not in str(raised.value)


def _scene(config, high=12):
    small = {"bodies.0.voxels_high": high}
    return scene_config(config, config.train[0].set, small).build()


def test_a_change_of_all_cases_is_set_from_the_command_line():
    overrides = (
        "set.bodies.0.voxels_high=30",
        "train.0.set.terms.0.direction=[1, 0, 0]",
    )
    config = load_calibration(QUICK, overrides)
    assert config.set["bodies.0.voxels_high"] == 30
    assert config.train[0].set["terms.0.direction"] == [1, 0, 0]
    assert scene_config(config, config.train[0].set).bodies[0].voxels_high == 30


def test_levels_and_starts_come_from_the_scene():
    names = "{name: weights.within, per: level}, {name: weights.between}"
    changes = (
        "set.bodies.0.structure={kind: shell_over_core, layers: 1, factor: 4}",
        f"parameters=[{names}, {{name: weights.capacity, per: level}}]",
    )
    config = load_calibration(QUICK, changes)
    parameters = _build_parameters(config, _scene(config, 48))
    assert parameters.labels == (
        "weights.within.0",
        "weights.within.1",
        "weights.between",
        "weights.capacity.1",
    )
    np.testing.assert_allclose(parameters.flat_values(np.zeros(4)), 1.0)


def test_units_are_read_at_the_edge():
    change = (
        "parameters=[{name: convection.heat_transfer_coefficient, "
        "start: '12 W/(m^2 K)', bounds: [1, '50 W/(m^2 K)']}]"
    )
    config = load_calibration(QUICK, (change,))
    parameter = _build_parameters(config, _scene(config)).parameters[0]
    assert (parameter.start, parameter.lower, parameter.upper) == ((12.0,), 1.0, 50.0)


def test_the_hash_goes_with_what_is_fitted():
    first = load_calibration(QUICK)
    second = load_calibration(QUICK, ("fit.seed=1",))
    assert calibration_hash(first) != calibration_hash(second)
    assert calibration_hash(first) == calibration_hash(load_calibration(QUICK))
