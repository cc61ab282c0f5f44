"""`calibrate show`: results of a fit and shipped cards as text, which runs nothing."""

from pathlib import Path

from rich.console import Console

from jaxthermo.config.card_content import card_summary
from jaxthermo.config.shipped_cards import shipped_cards
from jaxthermo.console.terminal import open_console, print_line
from jaxthermo.errors import InputError

from .config.fit_record import FitRecord, read_fit
from .report.card_list import about_cards, card_table, range_table
from .report.text_summary import (
    about_standard_errors,
    definition,
    experiment_table,
    parameter_table,
    summary,
    time_table,
    truth_table,
)


_MAX_EXPERIMENTS = 5
"""Further experiments that are listed."""


def show(folder: Path | None, shipped: bool) -> None:
    """Run `calibrate show`."""
    console = open_console()
    if shipped == (folder is not None):
        raise InputError("show: give the results folder of a fit, or --shipped")
    if folder is not None:
        print_fit(console, read_fit(folder / "fit.json"))
        return
    cards = {name: card_summary(path) for name, path in shipped_cards().items()}
    if cards:
        console.print(card_table(cards).rich())
        console.print(range_table(cards).rich())
    for text in about_cards(cards):
        print_line(console, text)


def print_fit(console: Console, result: FitRecord) -> None:
    """Print the results of a fit: values, errors, and what else to measure."""
    verdict, *further = summary(result)
    print_line(console, verdict)
    title = f"{result['name']}: {result['ended']}"
    console.print(parameter_table(result["parameters"], title).rich())
    console.print(time_table(result, "error at every saved time").rich())
    title = "error against finer voxels at every saved time"
    if (truth_errors := truth_table(result, title)) is not None:
        console.print(truth_errors.rich())
    about = about_standard_errors(result)
    for text in (about, *further, definition(result)):
        print_line(console, text)
    if result["advice"]:
        console.print(experiment_table(result, _MAX_EXPERIMENTS).rich())
