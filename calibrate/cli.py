"""Commands of calibrations as text on a terminal."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from jaxthermo.console.terminal import open_console, patient_interrupt, print_line
from jaxthermo.parallel.devices import provide_devices
from jaxthermo.report.numbers import count

from .analysis.fit_card import check_card
from .config.loader import load_calibration
from .make_cards import make_cards, read_recipes
from .report.card_list import card_words
from .report.text_summary import parameter_table
from .run import ProgressLog, fit_config, identify_start, parameter_rows
from .show import print_fit
from .solvers.progress import StepRecord


class _ProgressBar(ProgressLog):
    """Progress bar on a terminal; elsewhere a line per step."""

    def __init__(self, console: Console, bar: Progress):
        self._console = console
        self._bar = bar
        self._task = bar.add_task("starting", total=None, note="")

    def stage(self, name: str) -> None:
        self._bar.update(self._task, description=name, total=None, note="")

    def step(self, step: StepRecord, seconds: float, max_steps: int) -> None:
        outcome = "" if step.outcome == "accepted" else f", {step.outcome}"
        # A fit usually converges long before its step limit: an upper bound.
        left = seconds / step.number * (max_steps - step.number)
        note = f"loss {step.loss:.6g}{outcome}, at most {left:.0f} s left"
        self._bar.update(
            self._task,
            description="fitting",
            total=max_steps,
            completed=step.number,
            note=note,
        )
        # A bar in a log file would be a line of control characters per step.
        if not self._console.is_terminal:
            print_line(
                self._console, f"step {step.number}: loss {step.loss:.6g}{outcome}"
            )


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def fit(config: Path, out: Path, overrides: tuple[str, ...], devices: int = 1) -> None:
    """Run `calibrate fit`."""
    provide_devices(devices)
    console = open_console()
    with patient_interrupt() as asked, _progress(console) as bar:
        log = _ProgressBar(console, bar)
        result = fit_config(
            config, out=out, overrides=overrides, log=log, stop=asked, devices=devices
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
    with _progress(console) as bar:
        log = _ProgressBar(console, bar)
        start = identify_start(loaded, log)
    title = f"{loaded.name}: how well the data determine the start values"
    values = np.array([v.value for v in start.identified.verdicts])
    rows = parameter_rows(start.identified, values)
    console.print(parameter_table(rows, title, is_fitted=False).rich())
    for name, error in start.errors.items():
        words = f"{error.worst:.3g} %"
        if start.noise_is_known:
            words = f"{error.worst / 100:.3g} times the noise"
        print_line(console, f"{name}: error {words} at the start")
    if start.noise_is_known:
        note = "standard errors are of the pixels' noise alone, not the model's"
        print_line(console, note)


def check(card: str, scene: Path, overrides: tuple[str, ...]) -> None:
    """Run `calibrate check`."""
    console = open_console()
    with _progress(console) as bar:
        checked = check_card(
            card,
            scene_path=scene,
            overrides=overrides,
            log=_ProgressBar(console, bar).stage,
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
    with patient_interrupt() as asked, _progress(console) as bar:
        log = _ProgressBar(console, bar)
        fits = make_cards(
            recipes, out=out, results=results, again=again, log=log, stop=asked
        )
        for name, card, result in fits:
            words = card_words(card)
            state = "up to date" if result is None else result["verdict"]["words"]
            print_line(console, f"{name}: {words}; {state}")
    print_line(console, f"{count(len(recipes), 'card')} in {out}")
