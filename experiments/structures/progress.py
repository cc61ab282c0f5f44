"""What a long comparison says while it runs: a bar on a terminal, a line a row."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)

from jaxthermo.cli.console import tell

from .record import Row


class Steps:
    """Counts rows on a bar, and tells each as it is done."""

    def __init__(self, console: Console, bar: Progress, task: TaskID):
        """As `counted` gives it."""
        self.console = console
        self.bar = bar
        self.task = task

    def each(self, rows: Iterable[Row], what: str) -> Iterator[Row]:
        """The same rows; the bar says what is being made."""
        self.bar.update(self.task, description=what)
        for row in rows:
            self.bar.advance(self.task)
            tell(self.console, row_in_words(row))
            yield row


@contextmanager
def counted(console: Console, total: int) -> Iterator[Steps]:
    """A bar over so many rows; where standard output is no terminal there is none."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        yield Steps(console, bar, bar.add_task("", total=total))


def row_in_words(row: Row) -> str:
    """One line about any row."""
    names = ("body", "load", "hollow", "asked_for", "label")
    where = " ".join(str(row[name]) for name in names if name in row)
    if "refused" in row:
        return f"{row['what']}, {where}: {row['refused']}"
    if row["what"] == "reference":
        return f"reference, {where}: {row['steps']} steps, {row['took_s']:.3g} s in all"
    if row["what"] == "equilibrium":
        return (
            f"equilibrium, {where}: mean {row['mean_K']:.6f} K, uneven by "
            f"{row['surface_range_K']:.1g} K after {row['steps']} steps"
        )
    error = f"error {row['error']['worst_rms_percent']:.3g} %"
    if row["what"] == "levels":
        return f"levels, {where}: {row['nodes']} nodes, {error}"
    ratio, time = row["times_faster"], row["run_time_s"]
    return (
        f"{where}: {row['nodes']} nodes, {row['steps']} steps in "
        f"{time['median']:.3g} s, {ratio['median']:.3g} times faster "
        f"({ratio['least']:.3g} to {ratio['most']:.3g}), {error}"
    )
