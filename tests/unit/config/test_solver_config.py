"""The solver of a configuration: kinds, short forms and mistakes."""

import pytest

import jaxthermo as jt
from jaxthermo.config.loader import load_config


SCENE = """
bodies:
  - shape: {kind: sphere, radius: 5 cm}
    pitch: 1 cm
    material: copper
    temperature: 300 K
time: {end: 10 s, save_at: [10 s]}
"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    return path


@pytest.mark.parametrize(
    ("text", "solver"),
    [
        ("auto", None),
        ("forward_euler", jt.ForwardEuler()),
        ("{dt: 20 ms}", jt.ForwardEuler(dt=0.02)),
        ("super_time_stepping", jt.SuperTimeStepping()),
        ("{kind: super_time_stepping, dt: 1, stages: 9}", jt.SuperTimeStepping(1.0, 9)),
        ("{kind: backward_euler, dt: 1 min}", jt.BackwardEuler(dt=60.0)),
        ("{kind: trbdf2, error: 0.1}", jt.TRBDF2(error=0.1)),
        (
            "{kind: crank_nicolson, dt: 1, tolerance: 1e-6}",
            jt.CrankNicolson(1.0, 1e-6),
        ),
        ("{kind: error_control, error: 0.01}", jt.ErrorControl(error=0.01)),
    ],
)
def test_each_kind_makes_its_solver(scene, text, solver):
    config = load_config(scene, (f"solver={text}",))
    assert config.solver.build() == solver


def test_without_a_solver_one_is_chosen(scene):
    assert load_config(scene).solver.build() is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{kind: trbdf2, error: 0}", "solver.error: must be more than 0"),
        ("{kind: super_time_stepping, stages: 2}", "stages"),
        ("{kind: backward_euler, error: 1}", "unknown key: backward_euler takes"),
        ("rk4", "solver"),
    ],
)
def test_mistakes_are_named(scene, text, message):
    with pytest.raises(jt.InputError, match=message):
        load_config(scene, (f"solver={text}",))
