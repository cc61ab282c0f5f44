"""`experiments sweep` on a terminal: progress with the time left, and a table."""

import os
import time
from pathlib import Path

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
)
from typing_extensions import override

from jaxthermo.console.terminal import open_console, print_line
from jaxthermo.errors import InputError
from jaxthermo.parallel.devices import provide_devices

from .summary import table, write_results
from .sweep import Log, Options, run_sweep
from .tuning import compare_with_fit


_MAX_LINES = 40
"""Largest number of choices listed on a terminal."""
_INTERVAL_S = 30.0
"""Interval of the lines that replace a progress bar in a pipe [s]."""


class _Bar(Log):
    # A bar on a terminal; in a pipe a line now and then.
    def __init__(self, console: Console, bar: Progress):
        self._console = console
        self._bar = bar
        self._task = bar.add_task("starting", total=None)
        self._done = 0
        self._total: int | None = None
        self._last_line = time.monotonic()

    @override
    def stage(self, text: str, done: int = 0, total: int | None = None) -> None:
        self._done = done
        self._total = total
        self._bar.reset(self._task, description=text, total=total, completed=done)

    @override
    def advance(self, count: int) -> None:
        self._done += count
        self._bar.advance(self._task, count)
        if not self._console.is_terminal and (
            time.monotonic() - self._last_line > _INTERVAL_S
            or self._done == self._total
        ):
            self._last_line = time.monotonic()
            name = self._bar.tasks[0].description
            self.line(f"{name}: {self._done} of {self._total}")

    @override
    def line(self, text: str) -> None:
        print_line(self._console, text)


def sweep(config: Path, out: Path, overrides: tuple[str, ...], options: Options) -> int:
    """Run `experiments sweep`; return the number of failed cases."""
    if options.workers < 0:
        raise InputError(f"--workers {options.workers}: give 0 or more")
    if options.devices > 1 and (options.workers > 1 or options.scheduler is not None):
        raise InputError(
            f"--devices {options.devices}: they are of this process, and workers have "
            "one each; leave --workers and --scheduler out"
        )
    provide_devices(options.devices)
    console = open_console()
    progress = Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    with progress as bar:
        log = _Bar(console, bar)
        result = run_sweep(
            config, folder=out, overrides=overrides, options=options, log=log
        )
        compared = result.config.compare_with_fit is not None
        fit = compare_with_fit(result, log) if compared else None
    write_results(result, fit)
    console.print(table(result, _MAX_LINES).rich(), soft_wrap=False)
    if fit is not None:
        for optimum in ("sweep", "fit"):
            best = fit[optimum]
            values = ", ".join(f"{k} {v:.4g}" for k, v in best["values"].items())
            text = f"best by {optimum}: {values}: {best['rms_percent']:.3g} %"
            print_line(console, f"{text} in {best['runs']:,} runs")
    failed = sum("failed" in row for row in result.rows.values())
    if failed:
        file = out / "result.json"
        print_line(
            console, f"{failed} cases failed, see {file}; --retry runs them again"
        )
    print_line(console, f"rows.jsonl, result.json and report.html in {out}")
    return failed


def default_workers() -> int:
    """Number of worker processes: two, or one for each core where there are fewer."""
    return min(2, os.cpu_count() or 1)
