"""Output of commands: lines wrapped at words on a terminal, and whole in a pipe."""

import textwrap
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console


def open_console() -> Console:
    """Standard output without markup: a path may contain any character."""
    return Console(highlight=False, markup=False, emoji=False, soft_wrap=True)


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
