"""A bar that shows the progress of long work on a terminal or in a notebook."""

import html
import importlib
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, final

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress as Bar,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from typing_extensions import override

from ..progress import Progress
from .terminal import open_console, print_line


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


@final
class _NotebookProgress(Progress):
    """A bar below the cell of a notebook, which replaces itself."""

    def __init__(self, display: Any):
        """Show progress by a display of IPython that can be updated."""
        self._display = display
        self.stage("starting")

    @override
    def stage(self, name: str, total: int | None = None, done: int = 0) -> None:
        self._name = name
        self._total = total
        self.reach(done)

    @override
    def reach(self, done: int, note: str = "") -> None:
        self._done = done
        value = "" if self._total is None else f" value={done} max={self._total}"
        text = html.escape(f"{self._name} {note}")
        self._show(f"<progress{value} style='width: 24em'></progress> {text}")

    @override
    def advance(self, count: int = 1) -> None:
        self.reach(self._done + count)

    @override
    def line(self, text: str) -> None:
        print(text)  # noqa: T201

    def end(self) -> None:
        """Remove the bar."""
        self._show("")

    def _show(self, text: str) -> None:
        self._display.update({"text/html": text, "text/plain": ""}, raw=True)


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """Show a bar, below the cell of a notebook or on a terminal; none in a pipe.

    It goes when the work is done. Give it to `simulate` without calling it.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=350)
        >>> scene = jt.Scene((body,), (jt.Convection(10.0, 290.0),))
        >>> solution = jt.simulate(scene, 60.0, progress=jt.progress_bar)
    """
    console = open_console()
    if not console.is_jupyter:
        with terminal_progress(console) as progress:
            yield progress
        return
    notebook: Any = importlib.import_module("IPython.display")
    bar = _NotebookProgress(
        notebook.display({"text/plain": ""}, raw=True, display_id=True)
    )
    try:
        yield bar
    finally:
        bar.end()
