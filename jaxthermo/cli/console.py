"""What commands say: lines wrapped at words on a terminal, and left whole in a pipe."""

import textwrap
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console


def open_console() -> Console:
    """Standard output; what is printed is plain text, whatever a path may hold."""
    return Console(highlight=False, markup=False, emoji=False, soft_wrap=True)


def tell(console: Console, text: str) -> None:
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
def doing(console: Console, what: str) -> Iterator[None]:
    """Show what takes a while, on a terminal only."""
    if not console.is_terminal:
        yield
        return
    with console.status(what):
        yield
