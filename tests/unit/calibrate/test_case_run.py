"""Runs of fits have a small error in time, with sheets and without."""

import numpy as np
import pytest

import jaxthermo as jt
from calibrate.problem.build import _build_scenes
from calibrate.problem.case_run import case_run
from jaxthermo.config.loader import load_config
from jaxthermo.errors import InputError
from tests.shallow import SHALLOW


pytestmark = SHALLOW


PLATE = """
bodies:
  - shape: {kind: box, size: [4 cm, 4 cm, 1 cm]}
    pitch: 1 cm
    material: {conductivity: 0.3, density: 1200, specific_heat: 1500, emissivity: 0.9}
    temperature: 60 degC
terms:
  - {kind: convection, heat_transfer_coefficient: 50, temperature: 20 degC,
     on: {side: {normal: [0, 0, 1]}}}
dtype: float64
time: {end: 11 min, save_at: [2 min, 11 min]}
"""


@pytest.fixture
def config_of(tmp_path):
    def load(*overrides):
        path = tmp_path / "scene.yaml"
        path.write_text(PLATE)
        return load_config(path, overrides)

    return load


def test_a_solid_of_few_stable_steps_cools_exponentially(config_of):
    config = config_of()
    scene = config.build()
    run = case_run(config, scene)
    solution = run(scene, run.step_table(scene))
    assert float(solution.stable_step) > 100.0
    grid = scene.bodies[0].structure.grid
    top = grid.fragment_normal[:, 2] > 0.9
    # One node through the thickness, below half a cell.
    transmittance = 1 / (1 / 50.0 + 0.005 / 0.3)
    decay = np.exp(-transmittance * np.array(run.save_times) / (1200 * 1500 * 0.01))
    exact = 293.15 + 40.0 * transmittance / 50.0 * decay
    error = np.asarray(solution.surface_temperature)[:, top] - exact[:, None]
    assert np.abs(error).max() < 3e-4 * 40.0


def test_a_solver_of_the_file_is_kept(config_of):
    for name, kind in (("forward_euler", jt.ForwardEuler), ("trbdf2", jt.TRBDF2)):
        config = config_of(f"solver={name}")
        assert isinstance(case_run(config, config.build()).solver, kind)


def test_an_error_that_is_given_determines_the_steps(config_of):
    steps = []
    for error in (1e-2, 1e-5):
        config = config_of(f"solver={{kind: error_control, relative_error: {error}}}")
        solver = case_run(config, config.build()).solver
        assert isinstance(solver, jt.SuperTimeStepping)
        steps.append(solver.dt)
    assert steps[1] <= steps[0] / 4


def test_a_fit_has_no_body_that_starts_at_a_steady_state(config_of):
    config = config_of("bodies.0.temperature=steady")
    message = "cooling: body 0 has `temperature: steady`, .*: give a number"
    with pytest.raises(InputError, match=message):
        _build_scenes({"cooling": config})
