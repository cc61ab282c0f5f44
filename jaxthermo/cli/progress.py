"""Progress of a run on the terminal, and a Ctrl-C that waits for the segment."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from ..image.ticks import time_label


@contextmanager
def progress_bar(console: Console, end: float, steps: int) -> Iterator[Callable]:
    """A bar over all steps; yields a function of (steps done, simulated time).

    Without a terminal there is no bar.
    """
    columns = (
        TextColumn("simulating"),
        BarColumn(bar_width=None),
        TaskProgressColumn(),
        TextColumn("{task.fields[reached]} of " + _duration(end) + ","),
        TimeRemainingColumn(),
        TextColumn("left"),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("", total=max(steps, 1), reached=_duration(0.0))

        def update(done: int, time: float) -> None:
            bar.update(task, completed=done, reached=_duration(time))

        yield update


def _duration(time: float) -> str:
    """A time [s] within a sentence: "90 s", "12 min 30 s"."""
    return time_label(time).removeprefix("t = ")


@contextmanager
def patient_interrupt() -> Iterator[Callable[[], bool]]:
    """Turn the first Ctrl-C into a flag that is polled; the second one interrupts."""
    requested = False

    def request(number, frame):
        nonlocal requested
        if requested:
            raise KeyboardInterrupt
        requested = True

    before = signal.signal(signal.SIGINT, request)
    try:
        yield lambda: requested
    finally:
        signal.signal(signal.SIGINT, before)
