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

    Where standard output is no terminal there is no bar.
    """
    columns = (
        TextColumn("simulating"),
        BarColumn(bar_width=None),
        TaskProgressColumn(),
        TextColumn("{task.fields[reached]} of " + bare_time(end) + ","),
        TimeRemainingColumn(),
        TextColumn("left"),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("", total=max(steps, 1), reached=bare_time(0.0))

        def update(done: int, time: float) -> None:
            bar.update(task, completed=done, reached=bare_time(time))

        yield update


def bare_time(time: float) -> str:
    """A time [s] within a sentence: "90 s", "12 min 30 s"."""
    return time_label(time).removeprefix("t = ")


@contextmanager
def patient_interrupt() -> Iterator[Callable[[], bool]]:
    """Turns the first Ctrl-C into a flag to be asked for; the second one interrupts."""
    asked = False

    def note(number, frame):
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    before = signal.signal(signal.SIGINT, note)
    try:
        yield lambda: asked
    finally:
        signal.signal(signal.SIGINT, before)
