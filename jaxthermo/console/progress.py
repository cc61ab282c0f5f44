"""Progress of long work: what is told, and a bar that shows it on a terminal."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, final, runtime_checkable

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress as Bar,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from typing_extensions import override

from .terminal import print_line


@runtime_checkable
class Progress(Protocol):
    """Receiver of the progress of long work, which consists of stages."""

    def stage(self, name: str, total: int | None = None, done: int = 0) -> None:
        """Begin a stage of `total` steps (None if unknown), some of them done."""

    def reach(self, done: int, note: str = "") -> None:
        """Tell how many steps of the stage are done; the note is shown with them."""

    def advance(self, count: int = 1) -> None:
        """Tell that further steps of the stage are done."""

    def line(self, text: str) -> None:
        """Tell of a result or a mistake, in a line that stays."""


class _SilentProgress(Progress):
    """Progress that is not shown; a subclass may react to some of it."""


SILENT = _SilentProgress()
"""Progress that is told to nobody."""


@final
class _TerminalProgress(Progress):
    """A bar on a terminal; in a pipe a line at an interval."""

    def __init__(self, console: Console, bar: Bar, interval: float):
        """Show progress; in a pipe after every `interval` [s] and at a stage's end."""
        self._console = console
        self._bar = bar
        self._interval = interval
        self._last_line = time.monotonic()
        self.stage("starting")

    @override
    def stage(self, name: str, total: int | None = None, done: int = 0) -> None:
        self._name = name
        self._total = total
        self._done = done
        for task in self._bar.task_ids:
            self._bar.remove_task(task)
        self._task = self._bar.add_task(name, total=total, completed=done, note="")

    @override
    def reach(self, done: int, note: str = "") -> None:
        self._done = done
        self._bar.update(self._task, completed=done, note=note)
        if self._console.is_terminal or self._interval == math.inf:
            return
        is_due = time.monotonic() - self._last_line >= self._interval
        if is_due or done == self._total:
            self._last_line = time.monotonic()
            self.line(note or f"{self._name}: {done} of {self._total}")

    @override
    def advance(self, count: int = 1) -> None:
        self.reach(self._done + count)

    @override
    def line(self, text: str) -> None:
        print_line(self._console, text)


@contextmanager
def terminal_progress(
    console: Console, interval: float = math.inf
) -> Iterator[Progress]:
    """Progress on a console; in a pipe lines at an interval [s], by default none."""
    with Bar(
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        TaskProgressColumn(),
        TextColumn("{task.fields[note]}"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        yield _TerminalProgress(console, bar=bar, interval=interval)
