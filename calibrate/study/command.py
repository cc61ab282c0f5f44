"""`experiments sweep` on a terminal: progress with the time left, and a table."""

import os
from pathlib import Path

from jaxthermo.console.progress import terminal_progress
from jaxthermo.console.terminal import open_console, print_line
from jaxthermo.errors import InputError
from jaxthermo.parallel.devices import provide_devices

from .summary import table, write_results
from .sweep import Options, run_sweep
from .tuning import compare_with_fit


_MAX_LINES = 40
"""Largest number of choices listed on a terminal."""
_INTERVAL_S = 30.0
"""Interval of the lines that replace a progress bar in a pipe [s]."""


def sweep(config: Path, out: Path, overrides: tuple[str, ...], options: Options) -> int:
    """Run `experiments sweep`; return the number of failed cases.

    Raises:
        InputError: for a mistake in the config, or if every case fails.
    """
    if options.workers < 0:
        raise InputError(f"--workers {options.workers}: give 0 or more")
    if options.devices > 1 and (options.workers > 1 or options.scheduler is not None):
        raise InputError(
            f"--devices {options.devices}: they are of this process, and workers have "
            "one each; leave --workers and --scheduler out"
        )
    provide_devices(options.devices)
    console = open_console()
    with terminal_progress(console, _INTERVAL_S) as progress:
        result = run_sweep(
            config, folder=out, overrides=overrides, options=options, progress=progress
        )
        compared = result.config.compare_with_fit is not None
        fit = compare_with_fit(result, progress) if compared else None
    write_results(result, fit)
    console.print(table(result, _MAX_LINES).rich(), soft_wrap=False)
    if fit is not None:
        for optimum in ("sweep", "fit"):
            best = fit[optimum]
            values = ", ".join(f"{k} {v:.4g}" for k, v in best["values"].items())
            text = f"best by {optimum}: {values}: {best['rms_percent']:.3g} %"
            print_line(console, f"{text} in {best['runs']:,} runs")
    failures = [row["failed"] for row in result.rows.values() if "failed" in row]
    failed = len(failures)
    file = out / "result.json"
    if failed and failed == len(result.rows):
        raise InputError(
            f"all {failed} cases failed, the first by {failures[0]}; see {file}, and "
            "--retry to run them again"
        )
    if failed:
        print_line(
            console, f"{failed} cases failed, see {file}; --retry runs them again"
        )
    print_line(console, f"rows.jsonl, result.json and report.html in {out}")
    return failed


def default_workers() -> int:
    """Number of worker processes: two, or one for each core where there are fewer."""
    return min(2, os.cpu_count() or 1)
