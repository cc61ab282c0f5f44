"""Fit cards with their weights, from and to the files of `card_content`."""

from pathlib import Path

import numpy as np

from ..archive import write_archive
from ..atomic import replacing
from ..errors import InputError
from ..structures.weights import ConductionWeights, FitCard
from .card_content import FORMAT, LISTS, REMEDY, card_checksum, read_card
from .shipped_cards import card_path
from .strict_yaml import write_yaml


# Longer lists, such as one weight for each node, would bury the rest of the card.
_MAX_LISTED = 64


def write_card(path: Path, card: FitCard) -> None:
    """Write a card as YAML, and its long lists beside it.

    Raises:
        InputError: if a file cannot be written.
    """
    beside, weights = path.with_suffix(".npz"), {}
    arrays: dict[str, np.ndarray] = {}
    for name, value in vars(card.weights).items():
        numbers = np.asarray(value, float)
        if numbers.ndim and len(numbers) > _MAX_LISTED:
            arrays[name] = numbers.astype(np.float32)
            weights[name] = beside.name
        else:
            weights[name] = numbers.tolist()
    if arrays:
        write_archive(beside, format_name=LISTS, version=FORMAT, arrays=arrays)
    plain = {
        # Weights stand before the data of their fit.
        "card": FORMAT,
        "name": card.name,
        "structure": card.structure,
        "weights": weights,
        **{name: value for name, value in vars(card).items() if name != "weights"},
        # YAML has no tuples.
        "ranges": {name: list(ends) for name, ends in card.ranges.items()},
        "mechanisms": list(card.mechanisms),
    }
    plain["checksum"] = card_checksum(plain, arrays)
    with replacing(path) as temporary:
        temporary.write_text(write_yaml(plain), encoding="utf-8")


def load_card(path: str | Path) -> FitCard:
    """The fit card in a YAML file, with the arrays beside it.

    Args:
        path: of the YAML file, or the name of a shipped card, "card://buddha/octree".

    Raises:
        InputError: if it is missing, no card, damaged, changed or of another format.
    """
    path = card_path(path)
    found = read_card(path)
    try:
        weights = ConductionWeights(**found.weights)
    # Names that this version does not know, and numbers out of range.
    except (TypeError, InputError) as error:
        raise InputError(f"{path}: weights: {error}; {REMEDY}") from error
    return FitCard(weights=weights, **found.about)
