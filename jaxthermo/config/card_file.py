"""Fit cards on disk: a YAML file, and long lists of weights in an `.npz` beside it."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ..atomic import replacing
from ..errors import InputError
from ..structures.structure import ConductionWeights, FitCard
from .messages import quoted
from .strict_yaml import read_yaml, write_yaml


# Format 1 had other names of weights.
_FORMAT = 2
# Longer lists, such as one weight for each node, would bury the rest of the card.
_MAX_LISTED = 64


def write_card(path: Path, card: FitCard) -> None:
    """Write a card as YAML, and its long lists beside it."""
    weights: dict[str, Any] = {}
    arrays: dict[str, np.ndarray] = {}
    for name, value in vars(card.weights).items():
        numbers = np.asarray(value, float)
        if numbers.ndim and len(numbers) > _MAX_LISTED:
            arrays[name] = numbers.astype(np.float32)
            weights[name] = path.with_suffix(".npz").name
        else:
            weights[name] = numbers.tolist()
    if arrays:
        with replacing(path.with_suffix(".npz")) as temporary:
            np.savez_compressed(temporary, allow_pickle=False, **arrays)
    plain = {
        "card": _FORMAT,
        **vars(card),
        "weights": weights,
        # YAML has no tuples.
        "ranges": {name: list(ends) for name, ends in card.ranges.items()},
        "mechanisms": list(card.mechanisms),
    }
    with replacing(path) as temporary:
        temporary.write_text(write_yaml(plain), encoding="utf-8")


def load_card(path: str | Path) -> FitCard:
    """The fit card in a YAML file, with the arrays beside it.

    Args:
        path: of the YAML file.

    Raises:
        InputError: if it is missing, no card, or of another format.
    """
    path = Path(path)
    data = read_yaml(path)
    missing = sorted({"card", "name", "structure", "weights"} - set(data))
    if missing:
        raise InputError(
            f"{path}: is no fit card: it has no {', '.join(missing)}; `calibrate fit` "
            "makes them"
        )
    if data["card"] != _FORMAT:
        raise InputError(
            f"{path}: is a fit card of format {quoted(data['card'])}, and this version "
            f"reads format {_FORMAT}: fit it again with `calibrate fit`"
        )
    unknown = sorted(set(data) - {"card", *(f.name for f in fields(FitCard))})
    if unknown:
        raise InputError(f"{path}: a fit card has no {', '.join(unknown)}")
    try:
        return FitCard(
            name=str(data["name"]),
            structure=dict(data["structure"]),
            weights=ConductionWeights(**_weights(path, data["weights"])),
            parameters=dict(data.get("parameters", {})),
            ranges={
                name: (float(low), float(high))
                for name, (low, high) in data.get("ranges", {}).items()
            },
            mechanisms=tuple(data.get("mechanisms", ())),
            error_percent=data.get("error_percent", {}),
            origin=data.get("origin", {}),
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: is no fit card: {error}") from error


def _weights(path: Path, given: dict[str, Any]) -> dict[str, Any]:
    found = {}
    for name, value in given.items():
        if not isinstance(value, str):
            found[name] = value
            continue
        beside = path.with_name(value)
        try:
            # Opened by name first: `np.load` would leave a damaged file open.
            with beside.open("rb") as stream, np.load(stream) as kept:
                found[name] = kept[name]
        # A damaged archive makes the reader raise anything.
        except Exception as error:
            raise InputError(
                f"{beside} with the weights `{name}` cannot be read "
                f"({type(error).__name__}): keep it beside the card"
            ) from error
    return found
