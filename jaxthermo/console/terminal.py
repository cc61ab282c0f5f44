"""Output of commands, and a Ctrl-C that waits for the end of a step.

On a terminal lines wrap at words; in a pipe they are whole.
"""

import signal
import textwrap
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from rich.console import Console

from ..errors import LongComputation


# Tables grow up to this width in a pipe [characters].
_PIPE_WIDTH = 240
_is_quiet = ContextVar("is_quiet", default=False)


@contextmanager
def quiet_output(is_quiet: bool) -> Iterator[None]:
    """Consoles that are opened meanwhile print nothing, if `is_quiet`."""
    token = _is_quiet.set(is_quiet)
    try:
        yield
    finally:
        _is_quiet.reset(token)


def open_console() -> Console:
    """Standard output without markup: a path may contain any character."""
    console = Console(
        highlight=False,
        markup=False,
        emoji=False,
        soft_wrap=True,
        quiet=_is_quiet.get(),
    )
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


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """Collect the texts of warnings to the user instead of showing them at once."""
    texts: list[str] = []
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        show = warnings.showwarning

        def collect(
            message: Warning | str,
            category: type[Warning],
            *position: Any,
            **options: Any,
        ) -> None:
            if category is LongComputation:
                Console(stderr=True, highlight=False).print(str(message))
            elif category is not UserWarning:
                show(message, category, *position, **options)
            elif str(message) not in texts:
                texts.append(str(message))

        warnings.showwarning = collect
        yield texts


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
