"""Commands of calibrations as text on a terminal."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jaxthermo.console.progress import terminal_progress
from jaxthermo.console.terminal import open_console, patient_interrupt, print_line
from jaxthermo.parallel.devices import provide_devices
from jaxthermo.report.numbers import count

from .analysis.fit_card import check_card
from .config.loader import load_calibration
from .make_cards import make_cards, read_recipes
from .report.card_list import card_words
from .report.text_summary import parameter_table
from .run import fit_config, identify_start, parameter_rows
from .show import print_fit


def fit(config: Path, out: Path, overrides: tuple[str, ...], devices: int = 1) -> None:
    """Run `calibrate fit`."""
    provide_devices(devices)
    console = open_console()
    with patient_interrupt() as asked, terminal_progress(console, 0.0) as progress:
        result = fit_config(
            config,
            out=out,
            overrides=overrides,
            progress=progress,
            stop=asked,
            devices=devices,
        )
    print_fit(console, result)
    print_line(console, f"fit.json, card.yaml and report.html in {out}")
    if result["ended"] == "interrupted":
        # The exit status of an interrupted command, though the results are written.
        raise KeyboardInterrupt(
            f"stopped after step {len(result['steps'])}, the best so far is in {out}; "
            "the same command continues from there"
        )


def identify(config: Path, overrides: tuple[str, ...]) -> None:
    """Run `calibrate identify`."""
    console = open_console()
    loaded = load_calibration(config, overrides)
    with terminal_progress(console) as progress:
        start = identify_start(loaded, progress.stage)
    title = f"{loaded.name}: how well the data determine the start values"
    values = np.array([v.value for v in start.identified.verdicts])
    rows = parameter_rows(start.identified, values)
    # Before the verdicts, which are on values that nothing was fitted to yet.
    for name, error in start.errors.items():
        words = f"{error.worst:.3g} %"
        if start.noise_is_known:
            words = f"{error.worst / 100:.3g} times the noise"
        print_line(console, f"{name}: error {words} at the start")
    console.print(parameter_table(rows, title, is_fitted=False).rich())
    if start.noise_is_known:
        note = "standard errors are of the pixels' noise alone, not the model's"
        print_line(console, note)


def check(card: str, scene: Path, overrides: tuple[str, ...]) -> None:
    """Run `calibrate check`."""
    console = open_console()
    with terminal_progress(console) as progress:
        checked = check_card(
            card, scene_path=scene, overrides=overrides, log=progress.stage
        )
    for name, value in checked["numbers"].items():
        span = checked["ranges"].get(name, "values that the card does not have")
        words = name.replace("_", " ")
        print_line(console, f"{words} {value:.3g}; fitted at {span}")
    for line in checked["outside"]:
        print_line(console, f"warning: {line}")
    errors = checked["error_percent"]
    valid = "valid" if checked["valid"] else "NOT valid"
    default = f"error {errors['default']:.3g} % with weights of 1"
    print_line(console, f"{default}, {errors['fitted']:.3g} % with the card's")
    print_line(console, f"the card is {valid} here")


def cards(
    folder: Path, names: Sequence[str], out: Path, results: Path, again: bool
) -> None:
    """Run `calibrate cards`."""
    console = open_console()
    recipes = read_recipes(folder, names)
    with patient_interrupt() as asked, terminal_progress(console, 0.0) as progress:
        fits = make_cards(
            recipes,
            out=out,
            results=results,
            again=again,
            progress=progress,
            stop=asked,
        )
        for name, card, result in fits:
            words = card_words(card)
            state = "up to date" if result is None else result["verdict"]["words"]
            print_line(console, f"{name}: {words}; {state}")
    print_line(console, f"{count(len(recipes), 'card')} in {out}")
