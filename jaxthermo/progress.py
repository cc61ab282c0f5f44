"""Progress of long work: its receiver, and the words for a time."""

from typing import Protocol, runtime_checkable


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


def duration(time: float) -> str:
    """Format a time [s] in words: "90 s", "12 min 30 s", "3 h 05 min"."""
    sign = "-" if time < 0 else ""
    size = abs(time)
    if size < 9.9995:
        return f"{sign}{size:.4g} s"
    # Rounded before splitting, so that 59.99 s never reads as 60 s of a minute.
    tenths = round(size, 1)
    if tenths < 120.0:
        return f"{sign}{tenths:g} s"
    seconds = round(size)
    if seconds < 3600:
        return f"{sign}{seconds // 60} min {seconds % 60:02d} s"
    minutes = round(size / 60)
    return f"{sign}{minutes // 60} h {minutes % 60:02d} min"
