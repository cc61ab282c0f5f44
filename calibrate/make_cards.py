"""Fit cards of several structures on several bodies, fitted by one command.

A card's calibration is the YAML file of a body, with its scene and cases, and that of a
structure, with its parameters, or those in its `exceptions` for that body. A card is up
to date while these and the geometry of the body are unchanged.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jaxthermo.config.card_file import load_card, write_card
from jaxthermo.config.messages import close_match
from jaxthermo.config.strict_yaml import read_yaml
from jaxthermo.console.results_folder import results_folder
from jaxthermo.errors import InputError
from jaxthermo.progress import SILENT, Progress
from jaxthermo.structures.weights import FitCard

from .config.fit_record import FitRecord
from .config.loader import calibration_hash, load_calibration, scene_config
from .config.schema import CalibrationConfig
from .run import fit_config


class _Recipe(NamedTuple):
    """The calibration of one card."""

    name: str
    """BODY/STRUCTURE"""
    body: Path
    overrides: tuple[str, ...]

    def load(self) -> CalibrationConfig:
        """Config of the calibration."""
        return load_calibration(self.body, self.overrides)


def read_recipes(folder: Path, names: Sequence[str] = ()) -> list[_Recipe]:
    """Recipes of the cards in a folder with `bodies` and `structures`.

    Args:
        folder: that has both.
        names: of the cards, such as "buddha/octree"; all by default.

    Raises:
        InputError: if the folder has no such files, or there is no card of a name.
    """
    bodies = sorted((folder / "bodies").glob("*.yaml"))
    structures = sorted((folder / "structures").glob("*.yaml"))
    if not bodies or not structures:
        raise InputError(
            f"{folder}: has no YAML files in `bodies` and in `structures`, which cards "
            "are made of"
        )
    recipes = {
        recipe.name: recipe
        for structure in structures
        for recipe in _recipes_of(structure, bodies)
    }
    for name in names:
        if name not in recipes:
            raise InputError(f"there is no card '{name}'{close_match(name, recipes)}")
    return [recipes[name] for name in names or sorted(recipes)]


def _recipes_of(structure: Path, bodies: Sequence[Path]) -> Iterator[_Recipe]:
    values = read_yaml(structure, "it needs `parameters`")
    where = f"{structure}: exceptions"
    exceptions = _mapping(values.pop("exceptions", {}), where)
    body_names = [body.stem for body in bodies]
    for name in exceptions:
        if name not in body_names:
            missing = f"{where}: there is no body '{name}'"
            raise InputError(missing + close_match(name, body_names))
    for body in bodies:
        name = f"{body.stem}/{structure.stem}"
        entry = f"{where}: {body.stem}"
        exception = _mapping(exceptions.get(body.stem, {}), entry)
        texts = (
            *_overrides({"name": name} | values, str(structure)),
            # Later ones win.
            *_overrides(exception, entry),
        )
        yield _Recipe(name, body, texts)


def _overrides(values: dict[str, Any], where: str) -> Iterator[str]:
    changes = _mapping(values.get("set", {}), f"{where}: set")
    # One by one, or they would replace those of the body.
    settings = {f"set.{key}": value for key, value in changes.items()} | values
    return (f"{k}={json.dumps(v)}" for k, v in settings.items() if k != "set")


def _mapping(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{where}: expected `key: value` lines")
    return value


def make_cards(
    recipes: Sequence[_Recipe],
    out: Path,
    results: Path,
    again: bool = False,
    progress: Progress = SILENT,
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[str, FitCard, FitRecord | None]]:
    """Fit the cards one by one, each written to `out` when it is finished.

    A fit that was interrupted continues in its folder in `results`.

    Args:
        recipes: of the cards.
        out: folder for the cards.
        results: folder for the fits' results.
        again: True to fit those that are up to date as well.
        progress: receives the progress.
        stop: called before every step; if it returns True, all ends, and the same
            call continues later.

    Yields:
        Name and card, and the results of its fit, None if it was up to date.

    Raises:
        InputError: for a mistake in a recipe, before anything is fitted.
        KeyboardInterrupt: if `stop` ended a fit.
    """
    todo = [(recipe, recipe.load()) for recipe in recipes]
    for recipe, config in todo:
        path = out / f"{recipe.name}.yaml"
        current_card = None if again else _up_to_date(path, config)
        if current_card is not None:
            yield recipe.name, current_card, None
            continue
        folder = results / recipe.name
        result = fit_config(
            recipe.body,
            out=folder,
            overrides=recipe.overrides,
            progress=progress,
            stop=stop,
            report=False,
        )
        if result["ended"] == "interrupted":
            raise KeyboardInterrupt(
                f"stopped in {recipe.name}; the same command continues from there"
            )
        card = load_card(folder / "card.yaml")
        with results_folder(path.parent):
            write_card(path, card)
        yield recipe.name, card, result


def _up_to_date(path: Path, config: CalibrationConfig) -> FitCard | None:
    try:
        card = load_card(path)
    except InputError:  # missing, or damaged
        return None
    bodies = (scene_config(config, case.set).bodies[0] for case in config.train)
    # The name too, so that no card passes for one that it was copied from.
    is_current = (
        card.name == config.name
        and card.origin.get("config") == calibration_hash(config)
        and dict(card.geometry) == dict(body.geometry for body in bodies)
    )
    return card if is_current else None
