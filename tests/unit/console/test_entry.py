"""What a command line writes beside its results."""

import warnings

import pytest
from cyclopts import App

from jaxthermo.console.entry import run_app


def test_a_warning_is_one_line_and_those_for_programmers_stay(capsys, monkeypatch):
    shown = []
    monkeypatch.setattr(warnings, "showwarning", lambda *args, **_: shown.append(args))
    app = App(name="tool")

    @app.command
    def work() -> None:
        warnings.warn("a lattice of\n  many cells", stacklevel=1)
        warnings.warn("a call changes", DeprecationWarning, stacklevel=1)

    with warnings.catch_warnings(), pytest.raises(SystemExit) as stop:
        warnings.simplefilter("always")
        run_app(app, "tool", ["work"])
    assert stop.value.code == 0
    assert capsys.readouterr().err == "tool: warning: a lattice of many cells\n"
    ((message, category, *_),) = shown
    assert str(message) == "a call changes"
    assert category is DeprecationWarning
