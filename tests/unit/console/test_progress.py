"""Progress of long work: a bar on a terminal, lines in a pipe, and none."""

import io

from rich.console import Console

from jaxthermo.console.progress import terminal_progress
from jaxthermo.progress import Progress, _SilentProgress


def told(console: Console, interval: float) -> None:
    with terminal_progress(console, interval) as progress:
        assert isinstance(progress, Progress)
        progress.stage("steps", 4)
        progress.reach(2, "2 s of 4 s")
        progress.advance()
        progress.line("a result")
        progress.stage("unknown")
        progress.stage("rest", total=3, done=1)
        progress.advance(2)


def test_a_pipe_gets_lines_at_an_interval_or_none():
    text = io.StringIO()
    told(Console(file=text), interval=0.0)
    lines = ["2 s of 4 s", "steps: 3 of 4", "a result", "rest: 3 of 3"]
    assert text.getvalue().splitlines() == lines
    text = io.StringIO()
    told(Console(file=text), interval=float("inf"))
    assert text.getvalue().splitlines() == ["a result"]


def test_a_terminal_shows_a_bar_that_goes_at_the_end():
    text = io.StringIO()
    told(Console(file=text, force_terminal=True, width=100), interval=0.0)
    assert "a result" in text.getvalue() and "rest: 3 of 3" not in text.getvalue()


def test_silence_is_a_progress_too():
    assert isinstance(_SilentProgress(), Progress)
    _SilentProgress().stage("steps")
