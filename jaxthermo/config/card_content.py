"""Fit cards on disk: a YAML file, and an `.npz` file for long lists of weights.

The last line of the YAML file is a checksum of all values in both files: a card that is
cut off, changed by hand, or stored with another fit's lists is refused.
This module works without JAX, which only the weights of a card need.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple, NotRequired

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from ..archive import (
    arrays_checksum,
    check_regular,
    plain_checksum,
    read_archive,
    refuse_version,
)
from ..errors import InputError
from ..structures.card import CardSummary
from .messages import dotted, explain
from .strict_yaml import read_yaml


FORMAT = 4
"""Version of the layout; format 2 had no checksum, format 3 weights for surface cells
along the dominant axis without saying so."""

LISTS = "list of weights"
"""Name of the `.npz` file's kind in messages."""

REMEDY = "fit it again with `calibrate fit`, or copy the whole card again"
"""Advice about a card that cannot be read."""

_KIND = "fit card"


class _Card(TypedDict):
    """The schema of the YAML file without its format and checksum."""

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


class _CardContent(NamedTuple):
    """Checked content of the files of a card."""

    weights: dict[str, float | list[float] | str | np.ndarray]
    """Numbers and lists of numbers by name."""
    summary: CardSummary
    """The card without its weights."""


def card_checksum(plain: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> str:
    """Checksum of a card and of its lists of weights."""
    # The name of the other file does not count: a card may be renamed with it.
    lists = dict.fromkeys(arrays, arrays_checksum(arrays))
    return plain_checksum({**plain, "weights": {**plain["weights"], **lists}})


def read_card(path: Path) -> _CardContent:
    """Read the files of a card; see `load_card`."""
    check_regular(path, "`calibrate fit` makes fit cards")
    data = read_yaml(path, needs="`calibrate fit` makes fit cards")
    if "card" not in data:
        raise InputError(
            f"{path}: is no fit card: it has no `card`; `calibrate fit` makes them"
        )
    if data["card"] != FORMAT:
        refuse_version(
            path,
            format_name=_KIND,
            stored_version=data["card"],
            version=FORMAT,
            remedy=REMEDY,
        )
    checksum = data.pop("checksum", None)
    if checksum is None:
        raise InputError(f"{path}: is cut off: it has no `checksum`; {REMEDY}")
    return _checked(path, data, checksum)


def card_summary(path: Path) -> CardSummary:
    """The card in a file, without its weights, which may be of any names and values.

    Raises:
        InputError: as `load_card`.
    """
    return read_card(path).summary


def _checked(path: Path, data: Mapping[str, object], checksum: object) -> _CardContent:
    content = {key: value for key, value in data.items() if key != "card"}
    try:
        card = _SCHEMA.validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        message = f"{path}: {dotted(first['loc'])}: {explain(first)}; {REMEDY}"
        raise InputError(message) from error
    arrays = _stored_lists(path, card["weights"])
    if checksum != card_checksum(data, arrays):
        raise InputError(
            f"{path}: damaged or changed, its checksum does not match; {REMEDY} "
            "(weights of your own are given in the scene, as `weights: {within: 1.2}`)"
        )
    weights = {**card["weights"], **arrays}
    fields: Any = {key: value for key, value in card.items() if key != "weights"}
    return _CardContent(weights=weights, summary=CardSummary(**fields))


def _stored_lists(
    path: Path, weights: Mapping[str, float | list[float] | str]
) -> dict[str, np.ndarray]:
    names = [name for name, value in weights.items() if isinstance(value, str)]
    if not names:
        return {}
    # One file for all lists; a renamed card still names it by the old name.
    name = str(weights[names[0]])
    if name != Path(name).name:
        raise InputError(f"{path}: weights: {name!r} is no name of a file; {REMEDY}")
    lists_path = path.parent / name
    arrays = read_archive(
        lists_path,
        format_name=LISTS,
        version=FORMAT,
        remedy="keep it beside the card, of the same fit",
    )
    missing = [name for name in names if name not in arrays]
    if missing:
        raise InputError(f"{lists_path}: has no weights {', '.join(missing)}; {REMEDY}")
    return {name: arrays[name] for name in names}
