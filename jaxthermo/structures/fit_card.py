"""A fit card: weights that were fitted, to what, and where they may be trusted."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .weights import ConductionWeights


Range = tuple[float, float]


@dataclass(frozen=True, eq=False)
class FitCard:
    """Weights of one kind of structure, with what the fit has seen."""

    name: str
    structure: Mapping[str, Any]
    """Its kind and options, as in a config."""
    weights: ConductionWeights
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Other values of the scene that were fitted, by name."""
    ranges: Mapping[str, Range] = field(default_factory=dict)
    """Of the numbers of `scene_numbers`, over all cases that were fitted."""
    mechanisms: tuple[str, ...] = ()
    """That these cases had."""
    error_percent: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """"train" and "held_out", each "default" and "fitted"."""
    origin: Mapping[str, str] = field(default_factory=dict)
    """Hashes and versions."""


SLACK = 1.2
"""Beyond its ends a range still holds by this factor."""


def outside(
    card: FitCard, numbers: Mapping[str, float], mechanisms: tuple[str, ...]
) -> list[str]:
    """Where a scene leaves what a card was fitted on, a sentence each.

    Args:
        card: of the fit.
        numbers: of the scene, as `scene_numbers` gives them.
        mechanisms: that it has.
    """
    found = []
    for name, (low, high) in card.ranges.items():
        value = numbers.get(name)
        if value is None:
            continue
        if not low / SLACK <= value <= high * SLACK:
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
