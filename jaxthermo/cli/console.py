"""Output of commands: lines wrapped at words on a terminal, and whole in a pipe."""

import textwrap
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console


_PIPE_WIDTH = 240
"""Width up to which tables grow in a pipe [characters]."""


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
