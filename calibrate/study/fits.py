"""Fits of a sweep: choices whose weights are fitted before their cases run.

A fit runs once, in the folder of the sweep under the hash of its calibration and of the
program; an interrupted one continues.
"""

import json
from pathlib import Path

from jaxthermo.archive import text_hash
from jaxthermo.config.card_file import load_card
from jaxthermo.errors import InputError

from ..config.loader import calibration_hash, load_calibration
from ..config.schema import Changes
from ..problem.reference import program_hash
from ..run import fit_config
from .config import SweepConfig
from .points import Choice


def check_fit(config: SweepConfig, choice: Choice) -> None:
    """Read the calibration of a choice that has one, before anything is run.

    Raises:
        InputError: for each mistake in it.
    """
    if choice.fit is not None:
        _calibration_hash(config, choice)


def with_fit(config: SweepConfig, choice: Choice, folder: Path) -> Choice:
    """Choice with the weights of its fit, which runs unless its results exist.

    Args:
        config: of the sweep.
        choice: any; one without a fit is returned as it is.
        folder: of the sweep.

    Raises:
        InputError: if the fit cannot be made.
    """
    if choice.fit is None:
        return choice
    path = choice.fit.calibration
    out = folder / "fits" / _calibration_hash(config, choice)
    card = out / "card.yaml"
    # Written last: a folder without one is of a fit that was interrupted.
    if not card.is_file():
        try:
            overrides = _overrides(config, choice)
            fit_config(path, out=out, overrides=overrides, report=False)
        except InputError as error:
            raise InputError(f"fit {path}: {error}") from error
    structure = {**load_card(card).structure, "weights": {"card": str(card.resolve())}}
    return choice._replace(set={**choice.set, "bodies.0.structure": structure})


def _calibration_hash(config: SweepConfig, choice: Choice) -> str:
    assert choice.fit is not None
    overrides = _overrides(config, choice)
    calibration = load_calibration(choice.fit.calibration, overrides)
    text = f"{calibration_hash(calibration)} {program_hash(with_calibrate=True)}"
    return text_hash(text)


def _overrides(config: SweepConfig, choice: Choice) -> tuple[str, ...]:
    assert choice.fit is not None
    # The fitted scene has the choice's structure, pitch and solver too.
    changes = {**config.set, **choice.set}
    scene: Changes = {f"set.{key}": value for key, value in changes.items()}
    overrides = scene | choice.fit.set
    return tuple(f"{key}={json.dumps(value)}" for key, value in overrides.items())
