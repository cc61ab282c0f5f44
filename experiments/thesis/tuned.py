"""Weights of the thesis' structures, tuned on two loads and tried on a third (C16).

The calibrations are those of `configs/calibration`, in coarser voxels: the reference is
the full volume of the same voxels.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from PIL import Image

from calibrate.config.loader import load_calibration
from calibrate.problem.build import Calibration, build
from calibrate.problem.parameters import ParameterSet
from calibrate.problem.problem import Problem
from calibrate.problem.targets import CaseError
from calibrate.report.pictures import difference_picture
from calibrate.solvers.fit import Fitting
from jaxthermo.arrays import precision
from jaxthermo.integrate.run.parametric_run import ParametricSolution
from jaxthermo.report.chart import Chart

from ..harness.meshes import mesh_files
from .bodies import CONFIGS, buddha
from .heated import levels_at
from .line_chart import log_chart, point


SHELL, LEVELS, NESTED = "single shell", "10 levels", "irregular levels"
_FILES = {
    SHELL: "buddha-shell",
    LEVELS: "buddha-multilevel-10",
    NESTED: "buddha-irregular",
}
_FIGURINE = "scene=../scenes/figurine-steel.yaml"

UNTUNED, BY_HAND, FITTED = "weights of 1", "one weight", "all weights"
TRAIN, HELD_OUT = "train", "held_out"
# Of all conductances; that of 1 among them.
_FACTORS, _ONE = np.logspace(-2.0, 0.5, 21), 16
_CONDUCTION = ("weights.within", "weights.between")


class Tuned(NamedTuple):
    """A structure with weights of 1, with one weight tuned, and with all fitted."""

    name: str
    nodes: int
    calibration: Calibration
    curve: list[dict[str, Any]]
    """Errors by a factor of all conductances [%]."""
    factor: float
    """The factor with the smallest error on the training loads."""
    weights: dict[str, Any]
    """Fitted weights by name."""
    errors: dict[str, dict[str, dict[str, CaseError]]]
    """By kind of weights, by "train" or "held_out", by load."""
    solutions: dict[str, ParametricSolution]
    """Runs under the load held out, by kind of weights."""

    def worst(self, kind: str, group: str) -> float:
        """Largest error of the saved times and the loads of a group [%]."""
        return _worst(self.errors[kind][group])

    @property
    def fitted_factor(self) -> float:
        """Geometric mean of the fitted weights of conductances."""
        own = [np.ravel(v) for name, v in self.weights.items() if name in _CONDUCTION]
        return float(np.exp(np.log(np.concatenate(own)).mean()))

    def picture(self) -> Image.Image:
        """Differences from the full volume under the load held out, at its end."""
        problem = self.calibration.held_out
        assert problem is not None
        (case,) = problem.cases
        camera = self.calibration.configs[case.name].camera
        last = [len(case.target.times) - 1]
        titled = replace(case, name=f"sun from {case.name}, held out")
        return Image.open(
            BytesIO(difference_picture(titled, camera, self.solutions, last))
        )


@cache
def tuned(name: str, height: int) -> Tuned:
    """Tune a structure of the statue in voxels of so many along up."""
    config = load_calibration(_path(name), _overrides(name, height))
    calibration = build(config, lambda _: None)
    held_out, train = calibration.held_out, calibration.train
    assert held_out is not None
    fit = Fitting(train, config.fit).run()
    points = [_scaled(train.parameters, float(factor)) for factor in _FACTORS]
    both = Problem(train.parameters, (*train.cases, *held_out.cases))
    runs = list(_run(both, [*points, fit.z]))
    errors = [_errors(train, held_out, solutions) for solutions in runs]
    curve = [
        {"factor": float(factor), **{group: _worst(e) for group, e in each.items()}}
        for factor, each in zip(_FACTORS, errors, strict=False)
    ]
    best = min(range(len(curve)), key=lambda at: curve[at][TRAIN])
    kinds = {UNTUNED: _ONE, BY_HAND: best, FITTED: len(points)}
    values = train.parameters.values(np.asarray(fit.z, train.dtype))
    return Tuned(
        name,
        train.cases[0].scene.bodies[0].structure.node_count,
        calibration,
        curve,
        curve[best]["factor"],
        {key: np.asarray(value, float).tolist() for key, value in values.items()},
        {kind: errors[at] for kind, at in kinds.items()},
        {kind: runs[at][-1] for kind, at in kinds.items()},
    )


def _path(name: str) -> Path:
    return CONFIGS / "calibration" / f"{_FILES[name]}.yaml"


def _overrides(name: str, height: int) -> tuple[str, ...]:
    own, file = [f"set.bodies.0.voxels_high={height}"], mesh_files().get(buddha().name)
    if name == LEVELS:
        own.append(f"set.bodies.0.structure.levels={levels_at(height, 10)}")
    where = _FIGURINE if file is None else f"set.bodies.0.mesh.path={file.resolve()}"
    return where, *own


def _scaled(parameters: ParameterSet, factor: float) -> Float[np.ndarray, " p"]:
    """Coordinates of the start with all conductances times a factor."""
    start = parameters.values(np.zeros(parameters.size))
    values = {
        name: np.asarray(value, float) * (factor if name in _CONDUCTION else 1.0)
        for name, value in start.items()
    }
    return np.asarray(parameters.coordinates(values), float)


def _run(
    problem: Problem, points: Sequence[Float[np.ndarray, " p"]]
) -> Iterator[list[ParametricSolution]]:
    """Runs of all cases at each point, by one compiled program."""
    scene = lambda case, z: problem.parameters.insert(case.scene, z)
    run = eqx.filter_jit(
        lambda z, tables: [
            case.run(scene(case, z), table)
            for case, table in zip(problem.cases, tables, strict=True)
        ]
    )
    with precision(problem.dtype.name):
        tables = None
        for point in points:
            z = jnp.asarray(point, problem.dtype)
            tables = problem.step_tables_at(z, tables)
            yield run(z, tables)


def _errors(
    train: Problem, held_out: Problem | None, solutions: Sequence[ParametricSolution]
) -> dict[str, dict[str, CaseError]]:
    """Errors by group and load of the runs of all cases."""
    found, rest = {}, iter(solutions)
    for group, problem in ((TRAIN, train), (HELD_OUT, held_out)):
        found[group] = {}
        for case in () if problem is None else problem.cases:
            rows = np.asarray(case.target.residual(case.scene, next(rest)), float)
            # Squares of a row sum to a part of the mean over the times.
            root = np.sqrt(len(rows) * np.square(rows).sum(axis=1))
            found[group][case.name] = case.target.case_error(root)
    return found


def _worst(errors: Mapping[str, CaseError]) -> float:
    return max(error.worst for error in errors.values())


def tuning_chart(found: Tuned) -> Chart:
    """Errors by the one weight, on the training loads and on the load held out."""
    names = {TRAIN: "training loads", HELD_OUT: "load held out"}
    points = [
        point(
            words, row["factor"], row[group], f"{row['factor']:.3g}: {row[group]:.3g} %"
        )
        for group, words in names.items()
        for row in found.curve
    ]
    points += [
        point(words, found.fitted_factor, found.worst(FITTED, group), FITTED, mark=True)
        for group, words in names.items()
    ]
    x, y = "one factor of all conductances", "largest error [% of the range]"
    return log_chart(points, x, y, f"{found.name}: tuned by hand, and all weights")
