"""Fit card: fitted weights with the range of scenes that they were fitted on."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .weights import ConductionWeights


@dataclass(frozen=True, eq=False)
class FitCard:
    """Weights of one kind of structure, with the data of their fit."""

    name: str
    structure: Mapping[str, Any]
    """Kind and options of the structure, as in a config."""
    weights: ConductionWeights
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Other fitted values of the scene, by name."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Range of each number of `scene_numbers` over all fitted cases."""
    mechanisms: tuple[str, ...] = ()
    """Mechanisms of heat transfer in these cases."""
    error_percent: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Errors of "train" and "held_out", each "default" and "fitted" [%]."""
    origin: Mapping[str, str] = field(default_factory=dict)
    """Hashes and versions."""


# Factor by which a scene may leave a fitted range without a warning.
_TOLERANCE = 1.2


def extrapolations(
    card: FitCard, numbers: Mapping[str, float], mechanisms: tuple[str, ...]
) -> list[str]:
    """List where a scene is outside of the cases of a fit, one sentence each.

    Args:
        card: of the fit.
        numbers: of the scene, as from `scene_numbers`.
        mechanisms: of the scene.
    """
    found = []
    for name, (low, high) in card.ranges.items():
        value = numbers.get(name)
        if value is None:
            continue
        if not low / _TOLERANCE <= value <= high * _TOLERANCE:
            between = f"{low:.3g} to {high:.3g}" if low < high else f"{low:.3g}"
            words = name.replace("_", " ")
            found.append(f"{words} {value:.3g}: the card was fitted at {between}")
    new = [name for name in mechanisms if name not in card.mechanisms]
    if card.mechanisms and new:
        found.append(f"{', '.join(new)}: in no case that the card was fitted on")
    return found


def as_weights(given: ConductionWeights | FitCard) -> ConductionWeights:
    """Weights as given, or those of a card."""
    return given.weights if isinstance(given, FitCard) else given
