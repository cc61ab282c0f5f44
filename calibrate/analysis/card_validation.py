"""Whether a card holds for a scene: its ranges, and what it does to the error there."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxthermo.config.card_file import load_card
from jaxthermo.config.loader import load_config
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.surface_error import surface_error
from jaxthermo.scene.compile.compile import mechanism_names
from jaxthermo.scene.dimensionless_groups import scene_numbers
from jaxthermo.structures.fit_card import FitCard, outside

from ..problem.parameter_paths import find, put
from ..problem.reference import full_volume_run


WORSE = 1.02
"""Times the error of weights of 1, up to which a card holds."""


def check_card(
    card_path: Path,
    scene_path: Path,
    overrides: tuple[str, ...],
    doing: Callable[[str], None],
) -> dict[str, Any]:
    """Run a scene on every voxel, with the card's structure, and with its weights.

    Args:
        card_path: of the card.
        scene_path: of the scene's config; the structure is the card's.
        overrides: of the scene's config.
        doing: is told what takes a while.

    Raises:
        InputError: for a card or a scene that cannot be used.
    """
    card = load_card(card_path)
    config = with_structure(load_config(scene_path, overrides), card)
    doing("building the scene")
    scene = config.build()
    numbers = scene_numbers(scene, config.time.end)
    warnings = outside(card, numbers, mechanism_names(scene))
    reference = full_volume_run(config, 0.25, doing)
    fitted = put(scene, ("bodies", 0, "structure", "weights"), card.weights)
    for name, value in card.parameters.items():
        fitted = put(fitted, find(fitted, name), jnp.asarray(value))
    errors = {}
    for name, one in (("default", scene), ("fitted", fitted)):
        doing(f"running the {name} weights")
        found = simulate(
            one,
            config.time.end,
            config.time.save_times,
            solver=config.solver.build(),
        )
        errors[name] = float(
            np.asarray(surface_error(found, reference).rms_percent).max()
        )
    return {
        "card": card.name,
        "scene": config.name,
        "numbers": numbers,
        "ranges": {name: list(ends) for name, ends in card.ranges.items()},
        "outside": warnings,
        "error_percent": errors,
        "holds": errors["fitted"] <= WORSE * errors["default"],
    }


def with_structure(config: SceneConfig, card: FitCard) -> SceneConfig:
    """The scene with its first body as the structure that a card is of.

    Raises:
        InputError: for a scene of several bodies, or a kind that there is not.
    """
    if len(config.bodies) != 1:
        raise InputError("check: the scene has several bodies; a card is of one")
    (body,) = config.bodies
    made = type(body).model_validate(
        {**body.model_dump(mode="python"), "structure": dict(card.structure)}
    )
    if made.structure.options != dict(card.structure):
        raise InputError(
            f"check: the card's structure is not one of ours: {card.structure}"
        )
    return config.model_copy(update={"bodies": (made,)})
