"""`jaxthermo example` and `schema`: listed, printed, written, refused with one line."""

import json

import pytest
from cli_runs import run

from jaxthermo.config.loader import load_config


def test_examples_are_listed_with_what_they_show():
    code, out, err = run("example")
    assert (code, err) == (0, "")
    names = [line.split()[0] for line in out.splitlines()]
    assert "figurine" in names and "max-planck" not in names
    assert all(line.endswith(".") for line in out.splitlines())


def test_each_example_is_a_scene_that_needs_no_file(tmp_path, monkeypatch):
    monkeypatch.delenv("JAXTHERMO_MESHES", raising=False)
    for line in run("example")[1].splitlines():
        name = line.split()[0]
        file = tmp_path / f"{name}.yaml"
        assert run("example", name, "--out", file) == (0, f"{file}\n", "")
        assert load_config(file).name == name
        assert file.read_text() == run("example", name)[1]
        # A schema is named by a path that holds in the repository only.
        assert "yaml-language-server" not in file.read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("figurin",), "there is no example 'figurin'; did you mean 'figurine'?"),
        (("figurine", "--out", "{there}"), "exists already; name another file"),
        (("figurine", "--out", "{there}/a.yaml"), "cannot write"),
        (("--out", "{there}"), "name the example"),
    ],
)
def test_mistakes_are_one_line(tmp_path, arguments, message):
    there = tmp_path / "there.yaml"
    there.write_text("kept")
    code, out, err = run("example", *(a.format(there=there) for a in arguments))
    assert (code, out) == (2, "")
    assert err.count("\n") == 1 and message in err
    assert there.read_text() == "kept"


def test_the_schema_is_printed(monkeypatch):
    """What it is that is printed is tested in `test_json_schema`."""
    name = lambda model: json.dumps({"title": model.__name__})
    monkeypatch.setattr("jaxthermo.config.json_schema.json_schema", name)
    code, out, err = run("schema")
    assert (code, err) == (0, "")
    assert json.loads(out)["title"] == "SceneConfig"


def test_shell_completion_is_written(tmp_path):
    script = tmp_path / "completion.bash"
    code, _, err = run("--install-completion", "--shell", "bash", "--output", script)
    assert (code, err) == (0, "")
    assert "simulate" in script.read_text()
