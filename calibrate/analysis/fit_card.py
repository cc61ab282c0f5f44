"""Fit cards: weights with the ranges that they were fitted in, and their validation."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

import jax.numpy as jnp
import numpy as np

from jaxthermo.accuracy.error_records import ReferenceErrors, TruthErrors
from jaxthermo.accuracy.surface_error import surface_error
from jaxthermo.arrays import precision
from jaxthermo.config.card_file import load_card
from jaxthermo.config.loader import load_config
from jaxthermo.config.schema.body import BodyConfig
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.scene.dimensionless_groups import scene_numbers
from jaxthermo.scene.scene import mechanism_names
from jaxthermo.structures.extrapolation import extrapolations, range_words
from jaxthermo.structures.kinds.sheet import Sheet
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.structures.weights import ConductionWeights, FitCard

from ..config.fit_record import (
    FitRecord,
    TruthRecord,
    each_group,
    number_of,
)
from ..config.frame_names import is_of_frames
from ..config.schema import CalibrationConfig
from ..problem.build import Calibration
from ..problem.parameters import find_paths, with_values
from ..problem.reference import full_volume_run
from ..solvers.fit import Fit


_SHEET = "sheet"
"""Kind of the structure of a card that has no weights."""

_MAX_ERROR_RATIO = 1.02
"""Largest error of a valid card's weights, over the error with weights of 1."""


def make_card(
    config: CalibrationConfig,
    calibration: Calibration,
    fit: Fit,
    result: FitRecord,
) -> FitCard:
    """Card of a fit; in a scene of several bodies, with the weights of the first."""
    problem = calibration.train
    first = problem.cases[0]
    fitted = calibration.scene_at(first.name, fit.z)
    weights = fitted.bodies[0].structure.weights
    with precision(problem.dtype.name):
        values = problem.parameters.values(jnp.asarray(fit.z, problem.dtype))
    arrays = {name: np.asarray(value, float) for name, value in vars(weights).items()}
    # Lists belong to the body that was fitted, not to others that take the card.
    coefficients = {
        name: float(value)
        for name, value in values.items()
        if "weights" not in name.split(".")
        and np.ndim(value) == 0
        and not is_of_frames(name)
    }
    numbers = calibration.numbers(problem)
    # Each mechanism once, in the order of the cases.
    mechanisms = [name for c in problem.cases for name in mechanism_names(c.scene)]
    bodies = [calibration.configs[case.name].bodies[0] for case in problem.cases]
    structure = first.scene.bodies[0].structure
    return FitCard(
        name=config.name or "",
        structure=_options_of(structure, bodies[0]),
        weights=ConductionWeights(**arrays),
        parameters=coefficients,
        ranges={
            name: (min(n[name] for n in numbers), max(n[name] for n in numbers))
            for name in numbers[0]
        },
        mechanisms=tuple(dict.fromkeys(mechanisms)),
        geometry=dict(body.geometry for body in bodies),
        error_percent={
            group: {"default": errors["default"], "fitted": errors["fitted"]}
            for group, errors in each_group(result["error_percent"])
        },
        error_kelvin=_truth_errors(result.get("truth")),
        surface_cells=_surface_cells(structure),
        origin=_origin(config, result),
    )


def _options_of(
    structure: AbstractStructure, config: BodyConfig
) -> Mapping[str, object]:
    """Kind and options of a structure, as a card has them."""
    if isinstance(structure, Sheet):
        return {"kind": _SHEET, "cells": structure.cells_through}
    return config.structure.options_of(structure)


def _surface_cells(structure: AbstractStructure) -> str:
    """Surface cells of a structure's voxels; empty for a sheet, which has none."""
    return "" if isinstance(structure, Sheet) else structure.voxels.surface_cells


def _truth_errors(truth: TruthRecord | None) -> dict[str, dict[str, float]]:
    # Largest of all cases and saved times.
    if truth is None:
        return {}
    return {
        group: {
            model: max(_worst_kelvin(case[model]) for case in cases.values())
            for model in ("default", "fitted", "reference")
        }
        for group, cases in each_group(truth["cases"])
    }


def _worst_kelvin(errors: TruthErrors | ReferenceErrors) -> float:
    return number_of(errors.get("worst_rms_kelvin"))


def _origin(config: CalibrationConfig, result: FitRecord) -> dict[str, str]:
    speed = result["speedup"]

    def names(entries: Sequence[Any]) -> str:
        return "; ".join(entry.name for entry in entries)

    # Times are left out: the same config makes the same card.
    def pair(counts: Mapping[str, int]) -> str:
        return f"{counts['fitted']} for {counts['full_volume']}"

    return {
        "scene": config.scene.name,
        "train": names(config.train),
        "held_out": names(config.held_out),
        "reference": result["reference"],
        "fitted": names(config.parameters),
        "nodes": pair(speed["nodes"]),
        "steps": pair(speed["steps"]),
        "config": result["config_hash"],
        "program": result["program_hash"],
        **result["versions"],
    }


class _CardCheck(TypedDict):
    """Check of a card against a scene, as `calibrate check` prints it."""

    numbers: Mapping[str, float]
    """Dimensionless numbers of the scene [-]."""
    ranges: dict[str, str]
    """Range of the card in words, by number."""
    outside: Sequence[str]
    """Sentences on what is outside the ranges."""
    error_percent: dict[str, float]
    """Largest error of the default and of the fitted weights [%]."""
    valid: bool


def check_card(
    card_path: str | Path,
    scene_path: Path,
    overrides: tuple[str, ...],
    log: Callable[[str], None],
) -> _CardCheck:
    """Run a scene on every voxel, with the card's structure, and with its weights."""
    card = load_card(card_path)
    config = _with_structure(load_config(scene_path, overrides), card)
    log("building the scene")
    scene = config.build()
    numbers = scene_numbers(scene, config.time.last)
    warnings = extrapolations(
        card,
        numbers=numbers,
        mechanisms=mechanism_names(scene),
        geometry=config.bodies[0].geometry,
        surface_cells=_surface_cells(scene.bodies[0].structure),
    )
    reference = full_volume_run(config, 0.25, log)
    changes: dict[tuple[str | int, ...], Any] = {}
    if card.structure["kind"] != _SHEET:
        changes["bodies", 0, "structure", "weights"] = card.weights
    for name, value in card.parameters.items():
        for path in find_paths(scene, name):
            changes[path] = jnp.asarray(value)
    # Both runs share the scene's voxels and structure, which are slow to build.
    fitted = with_values(scene, changes)
    errors = {}
    for name, weighted in (("default", scene), ("fitted", fitted)):
        log(f"running the {name} weights")
        solution = simulate(
            weighted,
            t1=config.time.end,
            save_at=config.time.save_times,
            solver=config.solver.build(),
        )
        percent = surface_error(solution, reference).rms_percent
        errors[name] = float(np.asarray(percent).max())
    return {
        "numbers": numbers,
        "ranges": {name: range_words(card, name) for name in card.ranges},
        "outside": warnings,
        "error_percent": errors,
        "valid": errors["fitted"] <= _MAX_ERROR_RATIO * errors["default"],
    }


def _with_structure(config: SceneConfig, card: FitCard) -> SceneConfig:
    if len(config.bodies) != 1:
        raise InputError("check: the scene has several bodies; a card is of one")
    (body,) = config.bodies
    is_sheet = card.structure["kind"] == _SHEET
    if is_sheet != (body.wall is not None):
        kinds = ("a solid", "a sheet")
        raise InputError(
            f"check: the card is of {kinds[is_sheet]}, and the scene's body is "
            f"{kinds[not is_sheet]}"
        )
    if is_sheet:
        return config
    unknown = InputError(
        "check: this version does not know the card's structure "
        f"{card.structure}: fit again"
    )
    try:
        structured = type(body).model_validate(
            {**body.model_dump(mode="python"), "structure": dict(card.structure)}
        )
    except ValueError as error:
        raise unknown from error
    # A key that this version does not know would otherwise be lost in silence.
    if structured.structure.options != dict(card.structure):
        raise unknown
    return config.model_copy(update={"bodies": (structured,)})
