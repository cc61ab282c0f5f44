"""A sweep over a small ball in the sun that is run in no time, shared by tests."""

from pathlib import Path

from calibrate.study.case import Case
from calibrate.study.config import load_sweep
from calibrate.study.points import cases_of, choices


BALL = """
bodies:
  - shape: {kind: sphere, radius: 0.1 m}
    voxels_high: 8
    # So coarse a ball by all crossings warns of its area.
    surface_cells: dominant_axis
    material: {conductivity: 160, density: 8000, specific_heat: 500, absorptivity: 1}
    temperature: 293.15
terms:
  - {kind: sun, direction: [-1, 0, 0], irradiance: 5000}
dtype: float64
solver: forward_euler
time: {end: 60, save_at: [30, 60]}
camera: {width: 40, height: 30}
"""
SWEEP = """
scene: ball.yaml
set: {bodies.0.structure: {kind: aggregate, factor: 2}}
loads:
  - {name: +x}
  - {name: +z, set: {terms.0.direction: [0, 0, -1]}}
axes:
  within: {key: bodies.0.structure.weights.within, values: [0.8, 1, 1.25]}
truth: {voxels_high: 16, points: 300, surface_cells: dominant_axis, dtype: float64}
repeats: 2
"""
"""Three choices under two loads."""


def sweep_file(folder: Path, text: str = SWEEP) -> Path:
    """The config of a sweep, with its scene beside it."""
    (folder / "ball.yaml").write_text(BALL, encoding="utf-8")
    path = folder / "sweep.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def sweep_cases(folder: Path, text: str = SWEEP) -> list[Case]:
    """Cases of all choices of a sweep."""
    config = load_sweep(sweep_file(folder, text))
    return [case for choice in choices(config) for case in cases_of(config, choice)]


TUNED = """
scene: ball.yaml
set: {bodies.0.structure: {kind: shell_over_core, layers: 1, factor: 2}}
axes:
  within:
    key: bodies.0.structure.weights.within
    between: [0.25, 4]
    log: true
    count: 5
  between:
    key: bodies.0.structure.weights.between
    between: [0.25, 4]
    log: true
    count: 5
truth: {voxels_high: 16, points: 300, surface_cells: dominant_axis, dtype: float64}
compare_with_fit: {calibration: fit.yaml}
"""
"""Two weights in 25 choices, beside a fit of both."""
FIT = """
scene: ball.yaml
set: {bodies.0.structure: {kind: shell_over_core, layers: 1, factor: 2}}
train: [{name: as given}]
reference: truth
truth: {refinement: 2, points: 300, surface_cells: dominant_axis}
parameters: [{name: weights.within}, {name: weights.between}]
"""
