"""Commands of the documentation: the real command lines accept each of them."""

import json
import re
import shlex
import tomllib
from pathlib import Path

import pytest
from cyclopts import App, MissingArgumentError
from doc_pages import (
    DATA,
    PAGES,
    PROGRAMS,
    ROOT,
    command_lines,
    commands_in_text,
    name,
)

from calibrate.__main__ import app as calibrate_app
from calibrate.plan.command import search_time_of, tolerance_of
from experiments.__main__ import app as experiments_app
from experiments.catalogue import find
from jaxthermo.__main__ import app as jaxthermo_app
from jaxthermo.config.loader import load_config


_ALL = jaxthermo_app, calibrate_app, experiments_app
APPS: dict[str, App] = dict(zip(PROGRAMS, _ALL, strict=True))
TARGETS = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.M))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = set(PROJECT["optional-dependencies"])
GROUPS = {"thesis", "benchmarks"}


def check(words: list[str], is_complete: bool = True) -> None:
    """Fail if the program would refuse its arguments; nothing is run.

    Args:
        words: of the command.
        is_complete: False for one that may leave its arguments out, in a sentence.
    """
    program, *arguments = words[2:] if words[:2] == ["uv", "run"] else words
    if program == "make":
        extras = [a[len("EXTRAS=") :] for a in arguments if a.startswith("EXTRAS=")]
        assert {a for a in arguments if "=" not in a} <= TARGETS, words
        assert len(extras) == sum("=" in argument for argument in arguments), words
        assert {e for names in extras for e in names.split(",")} <= EXTRAS, words
    elif program == "pip":
        assert arguments[0] == "install" and len(arguments) == 2
        extras = re.fullmatch(r"\.(?:\[([\w,]+)\])?", arguments[1])
        assert extras, words
        assert set((extras[1] or "view").split(",")) <= EXTRAS, words
    elif program == "python":
        files = [word for word in arguments if word.startswith(("tests/", "docs/"))]
        assert files and all((ROOT / file).exists() for file in files), words
    else:
        _check_arguments(program, arguments, is_complete)


def _check_arguments(program: str, arguments: list[str], is_complete: bool) -> None:
    assert f"{program}.__main__:main" == PROJECT["scripts"][program]
    try:
        command, bound, _ = APPS[program].parse_args(
            arguments, exit_on_error=False, print_error=False
        )
    except MissingArgumentError:
        assert not is_complete, (program, arguments)
        return
    arguments_by_name = bound.arguments
    for path in (v for v in arguments_by_name.values() if isinstance(v, Path)):
        assert path.parts[0] not in ("configs", "docs") or (ROOT / path).exists(), path
    if command.__name__ == "_run" and arguments_by_name["name"] not in GROUPS:
        assert find(arguments_by_name["name"])
    if command.__name__ == "_plan" and is_complete:
        limits = ("tolerance", "kelvin", "time_budget", "memory")
        assert tolerance_of(*(arguments_by_name.get(limit) for limit in limits))
        assert search_time_of(arguments_by_name.get("search_time"))
    scene = arguments_by_name.get("config")
    if scene is not None and scene.is_relative_to("configs/scenes"):
        assert load_config(
            ROOT / scene, arguments_by_name.get("overrides", ()), find_meshes=False
        )


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_commands_of_a_page_are_accepted(page):
    for words in command_lines(page):
        check(words)
    for words in commands_in_text(page):
        check(words, is_complete=False)


def test_commands_of_the_contributing_page_are_accepted():
    for words in commands_in_text(ROOT / "CONTRIBUTING.md"):
        check(words, is_complete=False)


@pytest.mark.parametrize("path", DATA, ids=lambda p: p.stem)
def test_commands_that_made_the_numbers_are_accepted(path):
    text = path.read_text()
    commands = re.findall(r'"command": "((?:[^"\\]|\\.)*)"', text)
    commands += re.findall(rf"`((?:make|python|{'|'.join(PROGRAMS)}) [^`]*)`", text)
    for command in (command for line in commands for command in line.split("; ")):
        check(shlex.split(json.loads(f'"{command}"')), is_complete=False)


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("make dmeo", AssertionError),
        ("make env EXTRAS=veiw", AssertionError),
        ("make env EXTRA=view", AssertionError),
        ("pip install .[veiw]", AssertionError),
        ("pip install jaxthermo[view]", AssertionError),
        ("jaxthermo simulate configs/scenes/no.yaml", AssertionError),
        ("jaxthermo simulate scene.yaml --explian", Exception),
        ("jaxthermo simulate", AssertionError),
        ("calibrate plan scene.yaml --tolerance 1s", Exception),
        ("experiments run frunt", Exception),
    ],
)
def test_a_wrong_command_is_found(line, error):
    with pytest.raises(error):
        check(line.split())
