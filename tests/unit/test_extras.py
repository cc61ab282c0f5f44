"""Extras: what a missing package of one is told with, and that all of them exist."""

import ast
import importlib.util
import tomllib
from pathlib import Path

import pytest

from jaxthermo.errors import InputError
from jaxthermo.extras import install_commands, is_installed, require_extra


ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
ASKING = {"missing_package", "require_extra"}


def extras_in_code() -> set[object]:
    """Values of `extra=` of all calls, and arguments of `install_commands`."""
    extras = set()
    for package in ("jaxthermo", "calibrate", "experiments"):
        for path in (ROOT / package).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            if "extras import" not in text:
                continue
            calls = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Call)]
            for call in calls:
                name = call.func.id if isinstance(call.func, ast.Name) else ""
                if name == "install_commands":
                    extras |= {ast.literal_eval(a) for a in call.args}
                elif name in ASKING:
                    extras |= {
                        ast.literal_eval(keyword.value)
                        for keyword in call.keywords
                        if keyword.arg == "extra"
                    }
    return extras


def test_extras_that_messages_name_can_be_installed():
    asked = extras_in_code()
    assert {"view", "weather", "formats", "sweep"} <= asked
    assert asked <= set(PROJECT["optional-dependencies"])


def test_a_missing_package_is_one_line_with_two_commands(monkeypatch):
    require_extra("nothing needs", package="json", extra="view")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert not is_installed("json")
    with pytest.raises(InputError) as caught:
        require_extra("it needs", package="av", extra="video", otherwise="choose gif")
    assert str(caught.value) == (
        "it needs the package av: run `make env EXTRAS=video` or `pip install "
        "'.[video]'` in the folder of jaxthermo, or choose gif"
    )
    assert install_commands("video") in str(caught.value)
