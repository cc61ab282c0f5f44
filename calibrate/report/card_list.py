"""Fit cards as a table and in words."""

from collections.abc import Mapping

from jaxthermo.config.shipped_cards import SCHEME
from jaxthermo.report.numbers import padded
from jaxthermo.report.table import Cell, Table
from jaxthermo.structures.card import AbstractCard


_NUMBERS = {
    "biot": "Biot",
    "fourier": "Fourier",
    "voxels_across": "V/A/pitch",
    "heating": "heating [K]",
}
_DASH = "\N{EN DASH}"


def card_table(cards: Mapping[str, AbstractCard]) -> Table:
    """A row for each card: its structure, its errors, and the reference's error.

    Errors are in kelvin, against finer voxels, where the fit measured them so; else in
    percent.
    """
    columns = ["weights:", "structure", "error", "held out", "reference"]
    rows = [
        [
            f"{SCHEME}{name}",
            _structure_words(card),
            *(_error_cell(card, group) for group in ("train", "held_out")),
            _reference_words(card),
        ]
        for name, card in cards.items()
    ]
    return Table(columns, rows, left=(0, 1))


def range_table(cards: Mapping[str, AbstractCard]) -> Table:
    """A row for each geometry: the surface cells and ranges that its cards share."""
    rows = (
        (
            ", ".join(card.geometry),
            card.surface_cells or _DASH,
            *(_range(card, number) for number in _NUMBERS),
        )
        for card in cards.values()
    )
    columns = ["fitted on", "surface_cells", *_NUMBERS.values()]
    return Table(columns, list(dict.fromkeys(rows)), left=(0, 1))


def about_cards(cards: Mapping[str, AbstractCard]) -> list[str]:
    """Sentences on the columns of the table, and how the cards were made."""
    if not cards:
        return ["No cards are part of this package."]
    first = next(iter(cards.values()))
    return [
        "Each error is the largest over the saved times: first with weights of 1, "
        "then with the card's weights. Errors in kelvin are root mean squares over the "
        "surface, compared with finer voxels, whose own error is about the one under "
        "`reference`. Errors in percent are compared with the reference of the fit "
        "and divided by its range.",
        "A card holds in the ranges, on the geometry and with the surface cells that "
        f"it was fitted with, under {', '.join(first.mechanisms)}. Values outside by a "
        f"factor of at most {first.tolerance:g} count as inside; beyond it `jaxthermo "
        "simulate` and `calibrate check` warn. V/A/pitch is the body's volume over its "
        "surface, in voxels.",
        "Made by `make cards` from configs/cards.",
    ]


def card_words(card: AbstractCard) -> str:
    """Errors of a card in words."""
    groups = (("train", "error fitted to:"), ("held_out", "held out:"))
    return ", ".join(
        f"{words} {_error_words(card, group)}"
        for group, words in groups
        if group in card.error_percent
    )


def _structure_words(card: AbstractCard) -> str:
    # Counts tell structures of one kind apart; the card has the other options.
    counts = (f"{k} {v}" for k, v in card.structure.items() if isinstance(v, int))
    return ", ".join([str(card.structure["kind"]), *counts])


def _error_cell(card: AbstractCard, group: str) -> str | Cell:
    errors = _errors(card).get(group)
    if errors is None:
        return _DASH
    worse = errors["fitted"] > errors["default"]
    return Cell(_error_words(card, group) + (", more" if worse else ""), not worse)


def _error_words(card: AbstractCard, group: str) -> str:
    errors = _errors(card).get(group)
    if errors is None:
        return _DASH
    numbers = f"{padded(errors['default'])} to {padded(errors['fitted'])}"
    return f"{numbers} {'K' if card.error_kelvin else '%'}"


def _errors(card: AbstractCard) -> Mapping[str, Mapping[str, float]]:
    return card.error_kelvin or card.error_percent


def _reference_words(card: AbstractCard) -> str:
    reference_errors = [errors["reference"] for errors in card.error_kelvin.values()]
    return f"{padded(max(reference_errors))} K" if reference_errors else _DASH


def _range(card: AbstractCard, name: str) -> str:
    if name not in card.ranges:
        return _DASH
    # Two digits, so that the table fits a terminal; those beyond are in the card.
    ends = (f"{float(f'{value:.2g}'):g}" for value in card.ranges[name])
    return " to ".join(dict.fromkeys(ends))
