"""5.2: conduction weights tuned on two loads and tried on a third.

The calibrations are those of `configs/calibration`, in coarser voxels: the reference is
the full volume of the same voxels.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from PIL import Image

from calibrate.config.loader import changed_config, load_calibration
from calibrate.make_cards import read_recipes
from calibrate.problem.build import Calibration, build
from calibrate.problem.parameters import ParameterSet
from calibrate.report.pictures import difference_picture, runs_at
from calibrate.solvers.fit import Fitting
from jaxthermo.config.card_file import load_card
from jaxthermo.config.shipped_cards import SCHEME, shipped_cards
from jaxthermo.report.chart import Chart

from ...harness.line_chart import ALONE, CurvePoint, curves, log_chart
from ...harness.meshes import mesh_files
from ..bodies import CONFIGS, buddha, levels_at
from ..exhibit import Finding, exhibit, judged


_SHELL = "single shell"
_LEVELS = "10 levels"
_FILES = {
    _SHELL: "buddha-shell",
    _LEVELS: "buddha-multilevel-10",
    "irregular levels": "buddha-irregular",
}
_UNTUNED = "weights of 1"
_BY_HAND = "one weight"
_FITTED = "all weights"
_SETTINGS = (_UNTUNED, _BY_HAND, _FITTED)
_TRAIN = "train"
_HELD_OUT = "held_out"
_GROUPS = {_TRAIN: "training loads", _HELD_OUT: "load held out"}
# Of all conductances; that of 1 among them.
_FACTORS = np.logspace(-2.0, 0.5, 21)
_INDEX_OF_ONE = 16
_CONDUCTION = ("weights.within", "weights.between")
# Largest error of a surface that is near the full volume's [% of its range].
_NEAR = 2.0


class _Tuned(NamedTuple):
    """A structure with weights of 1, with one weight tuned, and with all fitted."""

    nodes: int
    calibration: Calibration
    curve: list[dict[str, float]]
    """Errors by a factor of all conductances [%]."""
    factor: float
    """The factor with the smallest error on the training loads."""
    weights: dict[str, Any]
    """Fitted weights by name."""
    worst: dict[str, dict[str, float]]
    """Largest errors by setting of the weights, and by group of loads [%]."""
    points: dict[str, Float[np.ndarray, " p"]]
    """Coordinates by setting of the weights."""

    @property
    def fitted_factor(self) -> float:
        """Geometric mean of the fitted weights of conductances."""
        conduction = [np.ravel(self.weights.get(name, ())) for name in _CONDUCTION]
        return float(np.exp(np.log(np.concatenate(conduction)).mean()))

    def numbers(self) -> dict[str, Any]:
        """Plain values of it."""
        return {
            "nodes": self.nodes,
            "factor": self.factor,
            "weights": self.weights,
            "curve": self.curve,
            "worst_percent": self.worst,
        }

    def picture(self) -> Image.Image:
        """Differences from the full volume under the load held out, at its end."""
        problem = self.calibration.held_out
        assert problem is not None
        (case,) = problem.cases
        camera = self.calibration.configs[case.name].camera
        last = [len(case.target.times) - 1]
        titled = replace(case, name=f"sun from {case.name}, held out")
        solutions = runs_at(problem, case, self.points)
        png = difference_picture(titled, camera, solutions, last)
        return Image.open(BytesIO(png))


@exhibit("section-5.2-weights", "5.2")
def _tuned_weights(quick: bool) -> Finding:
    """Tune one weight by hand and fit all, and compare on a load held out."""
    height = 60 if quick else 125
    names = (_SHELL,) if quick else tuple(_FILES)
    tuned = {name: _tune(name, height) for name in names}
    pictures: dict[str, Image.Image | Chart] = {}
    for name, result in tuned.items():
        file = f"weights-{name.replace(' ', '-')}"
        pictures[file] = _tuning_chart(name, result)
        pictures[f"{file}-difference"] = result.picture()
    gains = {
        setting: [
            1 - result.worst[setting][group] / result.worst[_UNTUNED][group]
            for result in tuned.values()
            for group in _GROUPS
        ]
        for setting in (_BY_HAND, _FITTED)
    }
    near = {
        setting: [
            name
            for name, result in tuned.items()
            if max(result.worst[setting].values()) <= _NEAR
        ]
        for setting in gains
    }
    is_tuned = min(gains[_BY_HAND]) > 0 and len(near[_BY_HAND]) == len(tuned)
    return Finding(
        judged(is_tuned, different=min(gains[_FITTED]) > 0),
        {
            **{name: result.numbers() for name, result in tuned.items()},
            "mesh": buddha().name,
            "height_voxels": height,
            "gains": {
                setting: [min(gain), max(gain)] for setting, gain in gains.items()
            },
            "near": near,
            "errors": [
                {
                    "structure": name,
                    "nodes": result.nodes,
                    "loads": words,
                    **{f"{key}_percent": result.worst[key][group] for key in _SETTINGS},
                    "one weight": result.factor,
                    "fitted weights": _listed(result.weights),
                }
                for name, result in tuned.items()
                for group, words in _GROUPS.items()
            ],
            **_card_numbers(),
        },
        pictures,
    )


@cache
def _tune(name: str, height: int) -> _Tuned:
    """Tune a structure of the statue, which is `height` voxels high."""
    path = CONFIGS / "calibration" / f"{_FILES[name]}.yaml"
    config = load_calibration(path, _overrides(name, height))
    calibration = build(config, lambda _: None)
    held_out = calibration.held_out
    train = calibration.train
    assert held_out is not None
    fit = Fitting(train, config.fit).run()
    points = [scaled(train.parameters, float(factor)) for factor in _FACTORS]
    points.append(fit.z)
    pairs = zip(train.errors_at(points), held_out.errors_at(points), strict=True)
    worst = [
        {
            _TRAIN: max(error.worst for error in of_train.values()),
            _HELD_OUT: max(error.worst for error in of_held_out.values()),
        }
        for of_train, of_held_out in pairs
    ]
    curve = [
        {"factor": float(factor), **by_group}
        for factor, by_group in zip(_FACTORS, worst, strict=False)
    ]
    best = min(range(len(curve)), key=lambda index: curve[index][_TRAIN])
    index_of = {_UNTUNED: _INDEX_OF_ONE, _BY_HAND: best, _FITTED: -1}
    values = train.parameters.values(np.asarray(fit.z, train.dtype))
    return _Tuned(
        nodes=train.cases[0].scene.bodies[0].structure.node_count,
        calibration=calibration,
        curve=curve,
        factor=curve[best]["factor"],
        weights={
            key: np.asarray(value, float).tolist() for key, value in values.items()
        },
        worst={setting: worst[index] for setting, index in index_of.items()},
        points={setting: points[index] for setting, index in index_of.items()},
    )


def _overrides(name: str, height: int) -> tuple[str, ...]:
    overrides = [f"set.bodies.0.voxels_high={height}"]
    if name == _LEVELS:
        overrides.append(f"set.bodies.0.structure.levels={levels_at(height, 10)}")
    file = mesh_files().get(buddha().name)
    if file is None:
        return ("scene=../scenes/figurine-steel.yaml", *overrides)
    return (f"set.bodies.0.mesh.path={file.resolve()}", *overrides)


def scaled(parameters: ParameterSet, factor: float) -> Float[np.ndarray, " p"]:
    """Coordinates of the start with all conductances times a factor."""
    start = parameters.values(np.zeros(parameters.size))
    values = {
        name: np.asarray(value, float) * (factor if name in _CONDUCTION else 1.0)
        for name, value in start.items()
    }
    return np.asarray(parameters.coordinates(values), float)


def _listed(weights: Mapping[str, Any]) -> str:
    texts = []
    for name, values in weights.items():
        short = name.removeprefix("weights.").replace("_", " ")
        digits = ", ".join(f"{value:.3g}" for value in np.atleast_1d(values))
        texts.append(f"{short} {digits}")
    return "; ".join(texts)


def _tuning_chart(name: str, tuned: _Tuned) -> Chart:
    """Errors by the one weight, on the training loads and on the load held out."""
    fitted = tuned.worst[_FITTED]
    points = [
        CurvePoint(
            words, x=tuned.fitted_factor, y=fitted[group], text=_FITTED, marks=ALONE
        )
        for group, words in _GROUPS.items()
    ]
    columns = {words: group for group, words in _GROUPS.items()}
    points += curves(tuned.curve, x="factor", y=columns)
    return log_chart(
        points=points,
        x_title="one factor of all conductances",
        y_title="largest error [% of the range]",
        title=f"{name}: tuned by hand, and all weights",
    )


def _card_numbers() -> dict[str, Any]:
    """Weights of the shipped cards, and what they take off the errors."""
    recipes = {recipe.name: recipe for recipe in read_recipes(CONFIGS / "cards")}
    rows = {}
    gains = []
    for name in shipped_cards():
        card = load_card(SCHEME + name)
        default = {"nearest_capacity": 0.0, "non_orthogonal": 0.0}
        weights = {
            key: np.asarray(value)
            for key, value in vars(card.weights).items()
            if np.any(np.asarray(value) != default.get(key, 1.0))
        }
        pitches = _pitches(recipes[name].load()) if name in recipes else ""
        errors = card.error_kelvin
        rows[name] = {
            "pitch_mm": pitches,
            "weights that are not 1 (or 0)": _listed(weights),
            "loads": f"{card.origin['train']}, held out {card.origin['held_out']}",
            "error with weights of 1_K": max(e["default"] for e in errors.values()),
            "error with the card_K": max(e["fitted"] for e in errors.values()),
        }
        gains += [
            1 - error["fitted"] / error["default"]
            for group, error in errors.items()
            if group == _HELD_OUT
        ]
    return {
        "cards": rows,
        "card_count": len(gains),
        "card_gains": [min(gains), max(gains)],
    }


def _pitches(config: Any) -> str:
    """Edges of the voxels of all cases [mm]."""
    pitches = []
    for case in (*config.train, *config.held_out):
        scene = changed_config(config.scene, config.set, case.set, find_meshes=False)
        body: Any = scene.bodies[0]
        height = (body.mesh or body.shape).height
        pitches.append(1e3 * height / body.voxels_high)
    return ", ".join(f"{pitch:.3g}" for pitch in sorted(pitches))
