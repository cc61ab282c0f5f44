"""Output of commands, progress of a long one, and a Ctrl-C that waits for its end.

On a terminal lines wrap at words; in a pipe they are whole, and there is no progress.
"""

import signal
import textwrap
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

from ..image.colour.ticks import time_label


# Tables grow up to this width in a pipe [characters].
_PIPE_WIDTH = 240


def open_console() -> Console:
    """Standard output without markup: a path may contain any character."""
    console = Console(highlight=False, markup=False, emoji=False, soft_wrap=True)
    # Rich assumes 80 columns for a pipe, where lines should be left whole.
    if not console.is_terminal:
        console.width = _PIPE_WIDTH
    return console


def print_line(console: Console, text: str) -> None:
    """Print one line, with an indent where the terminal is too narrow for it."""
    if console.is_terminal:
        text = textwrap.fill(
            text,
            console.width,
            subsequent_indent="    ",
            break_long_words=False,
            break_on_hyphens=False,
        )
    console.print(text)


@contextmanager
def status(console: Console, activity: str) -> Iterator[None]:
    """Show an activity that takes a while, on a terminal only."""
    if not console.is_terminal:
        yield
        return
    with console.status(activity):
        yield


def _duration(time: float) -> str:
    """A time as it stands in a sentence: "90 s" or "12 min 30 s"."""
    return time_label(time).removeprefix("t = ")


@contextmanager
def progress_bar(console: Console, end: float, steps: int) -> Iterator[Callable]:
    """A bar over all steps; yields a function of (steps done, simulated time, pass)."""
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        TaskProgressColumn(),
        TextColumn("{task.fields[reached]} of " + _duration(end) + ","),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task("simulating", total=max(steps, 1), reached=_duration(0.0))

        def update(done: int, time: float, number: int = 0) -> None:
            # The bar begins again with every pass of a run that controls its error.
            name = f"simulating, pass {number + 1}" if number else "simulating"
            bar.update(task, completed=done, reached=_duration(time), description=name)

        yield update


@contextmanager
def count_bar(
    console: Console, activity: str, total: int
) -> Iterator[Callable[[], None]]:
    """A bar that counts to a total; yields a function that adds one."""
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task(activity, total=total)
        yield lambda: bar.advance(task)


@contextmanager
def patient_interrupt() -> Iterator[Callable[[], bool]]:
    """Turn the first Ctrl-C into a flag that is polled; the second one interrupts."""
    # The state of a run can only be saved between segments.
    requested = False

    def request(number, frame):
        nonlocal requested
        if requested:
            raise KeyboardInterrupt
        requested = True

    previous_handler = signal.signal(signal.SIGINT, request)
    try:
        yield lambda: requested
    finally:
        signal.signal(signal.SIGINT, previous_handler)
