"""Fit cards on disk: a YAML file, and long lists of weights in an `.npz` beside it.

The last line of the YAML file is a checksum of all values, those in the other file too:
a card that is cut off, changed by hand, or beside another fit's lists is refused.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, NotRequired

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from ..archive import (
    arrays_checksum,
    check_regular,
    plain_checksum,
    read_archive,
    refuse_version,
    write_archive,
)
from ..atomic import replacing
from ..errors import InputError
from ..structures.weights import ConductionWeights, FitCard
from .messages import dotted, explain
from .shipped_cards import card_path
from .strict_yaml import read_yaml, write_yaml


# Format 2 had no checksum, format 3 weights for surface cells along the dominant axis
# without saying so.
_FORMAT, _KIND = 4, "fit card"
_REMEDY = "fit it again with `calibrate fit`, or copy the whole card again"
# Longer lists, such as one weight for each node, would bury the rest of the card.
_MAX_LISTED = 64


class _Card(TypedDict):
    """The schema of the YAML file, beside its format and checksum."""

    name: str
    structure: dict[str, Any]
    weights: dict[str, float | list[float] | str]
    parameters: NotRequired[dict[str, float]]
    ranges: NotRequired[dict[str, tuple[float, float]]]
    tolerance: NotRequired[Annotated[float, Field(ge=1)]]
    mechanisms: NotRequired[tuple[str, ...]]
    geometry: NotRequired[dict[str, str]]
    error_percent: NotRequired[dict[str, dict[str, float]]]
    error_kelvin: NotRequired[dict[str, dict[str, float]]]
    surface_cells: NotRequired[str]
    origin: NotRequired[dict[str, str]]


_SCHEMA = TypeAdapter(_Card)


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
        write_archive(beside, "list of weights", _FORMAT, arrays)
    plain = {
        "card": _FORMAT,
        **vars(card),
        "weights": weights,
        # YAML has no tuples.
        "ranges": {name: list(ends) for name, ends in card.ranges.items()},
        "mechanisms": list(card.mechanisms),
    }
    plain["checksum"] = _checksum(plain, arrays)
    with replacing(path) as temporary:
        temporary.write_text(write_yaml(plain), encoding="utf-8")


def _checksum(plain: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> str:
    # The name of the other file does not count: a card may be renamed with it.
    lists = dict.fromkeys(arrays, arrays_checksum(arrays))
    return plain_checksum({**plain, "weights": {**plain["weights"], **lists}})


def load_card(path: str | Path) -> FitCard:
    """The fit card in a YAML file, with the arrays beside it.

    Args:
        path: of the YAML file, or the name of a shipped card, "card://buddha/octree".

    Raises:
        InputError: if it is missing, no card, damaged, changed or of another format.
    """
    path = card_path(path)
    check_regular(path, "`calibrate fit` makes fit cards")
    data = read_yaml(path, needs="`calibrate fit` makes fit cards")
    if "card" not in data:
        raise InputError(
            f"{path}: is no fit card: it has no `card`; `calibrate fit` makes them"
        )
    if data["card"] != _FORMAT:
        refuse_version(path, _KIND, data["card"], _FORMAT, _REMEDY)
    given = data.pop("checksum", None)
    if given is None:
        raise InputError(f"{path}: is cut off: it has no `checksum`; {_REMEDY}")
    return _checked_card(path, data, given)


def _checked_card(path: Path, data: dict[str, Any], checksum: Any) -> FitCard:
    content = {key: value for key, value in data.items() if key != "card"}
    try:
        card = _SCHEMA.validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        message = f"{path}: {dotted(first['loc'])}: {explain(first)}; {_REMEDY}"
        raise InputError(message) from error
    arrays = _arrays_beside(path, card["weights"])
    if checksum != _checksum(data, arrays):
        raise InputError(
            f"{path}: damaged or changed, its checksum does not match; {_REMEDY} "
            "(weights of your own are given in the scene, as `weights: {within: 1.2}`)"
        )
    try:
        weights = ConductionWeights(**{**card["weights"], **arrays})
    # Names that this version does not know, and numbers out of range.
    except (TypeError, InputError) as error:
        raise InputError(f"{path}: weights: {error}; {_REMEDY}") from error
    return FitCard(**{**card, "weights": weights})


def _arrays_beside(
    path: Path, weights: Mapping[str, float | list[float] | str]
) -> dict[str, np.ndarray]:
    names = [name for name, value in weights.items() if isinstance(value, str)]
    if not names:
        return {}
    # One file for all lists; a card that was renamed names it by the old name.
    name = str(weights[names[0]])
    if name != Path(name).name:
        raise InputError(f"{path}: weights: {name!r} is no name of a file; {_REMEDY}")
    beside = path.parent / name
    found = read_archive(
        beside, "list of weights", _FORMAT, "keep it beside the card, of the same fit"
    )
    missing = [name for name in names if name not in found]
    if missing:
        raise InputError(f"{beside}: has no weights {', '.join(missing)}; {_REMEDY}")
    return {name: found[name] for name in names}
