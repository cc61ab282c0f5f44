"""Commands of calibrations as text on a terminal."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from jaxthermo.cli.console import open_console, tell
from jaxthermo.cli.progress import patient_interrupt
from jaxthermo.errors import InputError

from .analysis.fit_card import check_card
from .config.loader import load_calibration
from .config.schema import unit_of
from .report.text_summary import about_errors, change, error_words, name_of
from .run import ProgressLog, fit_config, identify_start
from .solvers.checkpoint import StepRecord


_MAX_ADVICE = 5
"""Further experiments that are listed."""

_LEFT = ("parameter", "verdict")


class _ProgressBar(ProgressLog):
    """Progress bar on a terminal; elsewhere a line per step."""

    def __init__(self, console: Console, bar: Progress):
        self._console, self._bar = console, bar
        self._task = bar.add_task("starting", total=None, note="")

    def stage(self, name: str) -> None:
        self._bar.update(self._task, description=name, total=None, note="")

    def step(self, step: StepRecord, seconds: float, max_steps: int) -> None:
        kind = "" if step.outcome == "accepted" else f", {step.outcome}"
        left = seconds / step.number * (max_steps - step.number)
        note = f"loss {step.loss:.6g}{kind}, at most {left:.0f} s left"
        self._bar.update(
            self._task, description="fitting", total=max_steps, completed=step.number,
            note=note,
        )  # fmt: skip
        if not self._console.is_terminal:
            tell(self._console, f"step {step.number}: loss {step.loss:.6g}{kind}")


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


def fit(config: Path, out: Path, overrides: tuple[str, ...]) -> None:
    """Run `calibrate fit`."""
    console = open_console()
    with patient_interrupt() as asked, _progress(console) as bar:
        result = fit_config(config, out, overrides, _ProgressBar(console, bar), asked)
    _print_fit(console, result)
    tell(console, f"fit.json, card.yaml and report.html in {out}")
    if result["ended"] == "interrupted":
        raise KeyboardInterrupt(
            f"stopped after step {len(result['steps'])}, the best so far is in {out}; "
            "the same command continues from there"
        )


def _print_fit(console: Console, result: dict[str, Any]) -> None:
    table = Table(title=f"{result['name']}: {result['ended']}")
    for column in ("parameter", "start", "fitted", "standard error", "verdict"):
        table.add_column(column, justify="left" if column in _LEFT else "right")
    for name, row in result["parameters"].items():
        error = row["standard_error"]
        unit = f" {row['unit']}" if row["unit"] else ""
        others = f" with {', '.join(row['with'])}" if row["with"] else ""
        table.add_row(
            name_of(name, row),
            f"{row['initial']:.4g}{unit}",
            f"{row['value']:.4g}{unit}",
            "" if error is None else f"{error:.2g}",
            row["verdict"] + others,
        )
    console.print(table)
    tell(console, about_errors(result))
    for group, words in (("train", "fitted to"), ("held_out", "held out")):
        if group in result["error_percent"]:
            both = result["error_percent"][group]
            before = error_words(both["default"], result)
            after = error_words(both["fitted"], result)
            tell(
                console,
                f"error, {words}: {before} before, {after} after ({change(**both)})",
            )
    speed = result["speedup"]
    tell(
        console,
        f"runs {speed['times_faster']:.3g} times as fast as the full volume "
        f"({speed['min']:.3g} to {speed['max']:.3g}); "
        f"{speed['default']['times_faster']:.3g} times before the fit",
    )
    spans = result["run_time_s"]
    tell(
        console,
        f"the fit took {spans['fit']:.3g} s, as long as "
        f"{spans['fit'] / max(spans['one_run'], 1e-9):.3g} runs of all its cases",
    )
    for entry in result["advice"][:_MAX_ADVICE]:
        tell(console, f"{entry['what']}: would add {entry['gain_nats']:.2f} nats")


def identify(config: Path, overrides: tuple[str, ...]) -> None:
    """Run `calibrate identify`."""
    console = open_console()
    loaded = load_calibration(config, overrides)
    with _progress(console) as bar:
        log = _ProgressBar(console, bar)
        found, errors, noise_is_known = identify_start(loaded, log)
    table = Table(title=f"{loaded.name}: how well the data determine the start values")
    for column in ("parameter", "start", "standard error", "verdict"):
        table.add_column(column, justify="left" if column in _LEFT else "right")
    for v in found.verdicts:
        unit = unit_of(v.label)
        others = f" with {', '.join(v.with_others)}" if v.with_others else ""
        table.add_row(
            v.label,
            f"{v.value:.4g}{' ' * bool(unit)}{unit}",
            "" if v.standard_error is None else f"{v.standard_error:.2g}",
            v.verdict + others,
        )
    console.print(table)
    for name, error in errors.items():
        words = f"{error.worst:.3g} %"
        if noise_is_known:
            words = f"{error.worst / 100:.3g} times the noise"
        tell(console, f"{name}: error {words} at the start")
    if noise_is_known:
        tell(console, "standard errors are of the pixels' noise alone, not the model's")


def check(card: Path, scene: Path, overrides: tuple[str, ...]) -> None:
    """Run `calibrate check`."""
    console = open_console()
    with _progress(console) as bar:
        found = check_card(card, scene, overrides, _ProgressBar(console, bar).stage)
    for name, value in found["numbers"].items():
        low, high = found["ranges"].get(name, (np.nan, np.nan))
        words = name.replace("_", " ")
        tell(console, f"{words} {value:.3g}; fitted at {low:.3g} to {high:.3g}")
    for line in found["outside"]:
        tell(console, f"warning: {line}")
    both = found["error_percent"]
    tell(
        console,
        f"error {both['default']:.3g} % with weights of 1, {both['fitted']:.3g} % with "
        "the card's",
    )
    valid = "the card is valid here"
    tell(console, valid if found["valid"] else "the card is NOT valid here")


def show(folder: Path) -> None:
    """Run `calibrate show`."""
    path = folder / "fit.json"
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; `calibrate fit` makes it") from None
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: is damaged: {error}") from error
    _print_fit(open_console(), result)
