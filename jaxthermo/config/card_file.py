"""Fit cards with their weights, from and to the files of `card_content`."""

from pathlib import Path
from typing import Any

import numpy as np

from ..archive import write_archive
from ..atomic import write_text
from ..errors import InputError
from ..structures.weights import ConductionWeights, FitCard
from .card_content import FORMAT, LISTS, REMEDY, card_checksum, read_card
from .shipped_cards import card_path
from .strict_yaml import write_yaml


# Longer lists, such as one weight for each node, would bury the rest of the card.
_MAX_LISTED = 64


def write_card(path: Path, card: FitCard) -> None:
    """Write a card as YAML, and its long lists to an `.npz` file of the same name.

    Raises:
        InputError: if a file cannot be written.
    """
    lists_path = path.with_suffix(".npz")
    weights = {}
    arrays: dict[str, np.ndarray] = {}
    for name, value in vars(card.weights).items():
        numbers = np.asarray(value, float)
        if numbers.ndim and len(numbers) > _MAX_LISTED:
            arrays[name] = numbers.astype(np.float32)
            weights[name] = lists_path.name
        else:
            weights[name] = numbers.tolist()
    if arrays:
        write_archive(lists_path, format_name=LISTS, version=FORMAT, arrays=arrays)
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
    write_text(path, write_yaml(plain))


def load_card(path: str | Path) -> FitCard:
    """The fit card in a YAML file, with the arrays of its `.npz` file.

    Args:
        path: the YAML file, or the name of a shipped card, "card://buddha/octree".

    Raises:
        InputError: if it is missing, no card, damaged, changed or of another format.
    """
    path = card_path(path)
    content = read_card(path)
    try:
        values: Any = content.weights
        weights = ConductionWeights(**values)
    # Names that this version does not know, and numbers out of range.
    except (TypeError, InputError) as error:
        raise InputError(f"{path}: weights: {error}; {REMEDY}") from error
    return FitCard(weights=weights, **vars(content.summary))
