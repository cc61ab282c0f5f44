"""A small calibration whose truth is known: a block under two loads."""

import functools
from copy import copy
from typing import Any

import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from calibrate.problem.frame_data import frame_limits, frame_target
from calibrate.problem.frame_quantity import FrameQuantity
from calibrate.problem.parameters import Parameter, ParameterSet
from calibrate.problem.problem import Case, Problem
from calibrate.problem.targets import surface_target
from calibrate.solvers.cameras import build_aligned
from calibrate.solvers.fit import Fitting
from jaxthermo.choices import Dtype
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.integrate.run.parametric_run import ParametricRun
from tests.bodies import blocks


SAVES = (2.0, 6.0)
STABLE_STEPS = jt.ForwardEuler()
METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.8)
WITHIN = Parameter(name="weights.within", start=(1.0,), lower=0.01, upper=100.0)
BETWEEN = Parameter(name="weights.between", start=(1.0,), lower=0.01, upper=100.0)
SPHERE = """
bodies:
  - shape: {kind: sphere, radius: 0.1 m}
    voxels_high: 8
    # So coarse a ball by all crossings warns of its area.
    surface_cells: dominant_axis
    structure: {kind: aggregate, factor: 2}
    material: {conductivity: 16, density: 8000, specific_heat: 500, absorptivity: 1}
    temperature: 293.15
terms:
  - {kind: sun, direction: [-1, 0, 0], irradiance: 5000}
dtype: float64
time: {end: 60, save_at: [30, 60]}
camera: {width: 40, height: 30}
"""
"""A config of a scene that is built and run in no time."""
TRUTH = {"weights.within": 1.7, "weights.between": 0.6}
ERRORS = {"default": 2.0, "fitted": 1.0}
RESULT: Any = {
    "name": "one",
    "verdict": {"pays": True, "words": "the fit pays", "times": 0, "worse": 0},
    "parameters": {
        "weights.within": {
            "value": 1.2, "initial": 1.0, "standard_error": None, "verdict": "fine",
            "with": [], "unit": "",
        }
    },
    "loss": {"initial": 2.0, "final": 1.0},
    "ended": "converged",
    "error_percent": {"train": ERRORS},
    "errors": {"train": {"default": {}, "fitted": {}}},
    "advice": [],
    "speedup": {
        "times_faster": None, "min": None, "max": None,
        "default": {"times_faster": None, "min": None, "max": None},
        "nodes": {}, "steps": {}, "run_time_s": {},
    },
    "steps": [],
    "run_time_s": {"fit": 1.0, "one_run": 0.1, "compile": 1},
    "reference": "full_volume",
    "versions": {"jaxthermo": "0.1"},
}  # fmt: skip
"""Results of a fit, as `fit.json` has them."""


FAST: Any = {"times_faster": 5.0, "min": 4.0, "max": 6.0}
"""Run time of a full volume over that of a structure."""


def errors_of(default, fitted, group="train") -> Any:
    """Errors [%] of a case at two times, as `fit.json` has them."""
    case_errors = {
        values: {"+x": {"times_s": [30.0, 60.0], "rms_percent": percent}}
        for values, percent in (("default", default), ("fitted", fitted))
    }
    return {group: case_errors}


def scene(side, dtype: Dtype = "float64", weights=None):
    """A block of fine voxels over a core, heated from one side."""
    used_weights = jt.ConductionWeights() if weights is None else weights
    solid = np.ones((7, 6, 5), bool)
    structure = jt.ShellOverCore(blocks(solid, 0.01), factor=2, weights=used_weights)
    body = jt.Body(structure, METAL, temperature=300.0)
    terms = (jt.HeatFlux(2e4, on=jt.Side(side)), jt.Convection(30.0, 300.0))
    return jt.Scene((body,), terms, dtype=dtype)


def seen_block(
    temperature, surroundings, conductivity=16.0, coefficient=30.0, emissivity=0.8
):
    """A block of fine voxels over a core that radiates, and is heated from one side."""
    structure = jt.ShellOverCore(blocks(np.ones((6, 6, 6), bool), 0.01), factor=2)
    metal = jt.Material(conductivity, 8000.0, 500.0, emissivity=emissivity)
    body = jt.Body(structure, metal, temperature=temperature)
    terms = (
        jt.HeatFlux(2e4, on=jt.Side((1.0, 0.0, 0.0))),
        jt.Convection(coefficient, 300.0),
        jt.Surroundings(surroundings),
    )
    return jt.Scene((body,), terms, dtype="float64")


def camera_of_block(width, height):
    """A camera that sees three sides of the block."""
    return jt.Camera(
        position=(0.16, -0.11, 0.11),
        look_at=(0.03, 0.03, 0.03),
        width=width,
        height=height,
    )


def frames_of(view, scene, solution, times, quantity="temperature"):
    """Frames of a run at its save times, on the host."""
    frames = FrameQuantity(quantity).frames(view, scene, solution=solution, times=times)
    return np.asarray(frames, float)


def values_of_aligned_fit(config):
    """Values by name that a fit of the poses of cameras, and of others, ends at."""
    calibration = build_aligned(config, lambda stage: None)
    fit = Fitting(calibration.train, config.fit).run()
    z = jnp.asarray(fit.z, calibration.train.dtype)
    return calibration.parameters.values(z)


def assert_poses_are_the_truth(values):
    """Corrections of two cameras are 0, to 0.1 degrees and 0.5 mm."""
    for camera in (0, 1):
        turn, move = (
            float(np.linalg.norm(values[f"cameras.{camera}.{motion}"]))
            for motion in ("rotation", "translation")
        )
        assert turn < np.deg2rad(0.1)
        assert move < 0.5e-3


def target_of(
    view, frames, times, quantity="temperature", masks=(), moving=None, allow=False
):
    """Frames with a noise of 50 mK as the data of a fit."""
    frame_quantity = FrameQuantity(quantity)
    return frame_target(
        times,
        views=(view,),
        frames=[frames],
        noise=0.05,
        frame_quantity=frame_quantity,
        limits=frame_limits(frame_quantity, None, allow),
        masks=masks,
        dtype=jnp.float64,
        moving=moving,
    )


@functools.cache
def data(side, dtype, truth):
    """A run of a scene as the data of a fit."""
    true_scene = scene(side, dtype, jt.ConductionWeights(**dict(truth)))
    run = ParametricRun(SAVES)
    solution = run(true_scene, run.step_table(true_scene))
    surface = solution.surface_temperature
    stored = StoredSolution(jnp.asarray(SAVES), surface, solution.surfaces)
    return surface_target(stored, jnp.dtype(dtype))


def twin(
    parameters=(WITHIN, BETWEEN),
    dtype: Dtype = "float64",
    truth=TRUTH,
    solver=STABLE_STEPS,
):
    """A problem whose data come of the same model at the truth."""
    parameter_set = ParameterSet(tuple(parameters))
    cases = []
    for side in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)):
        names = ((name.removeprefix("weights."), v) for name, v in truth.items())
        # A copy, since tests change it.
        target = copy(data(side, dtype, tuple(names)))
        run = ParametricRun(SAVES, solver)
        cases.append(
            Case(name=str(side), scene=scene(side, dtype), run=run, target=target)
        )
    return Problem(parameter_set, tuple(cases))
