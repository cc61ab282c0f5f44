"""`jaxthermo example` and `schema`: listed, printed, written, refused with one line."""

import json

import pytest
from cli_runs import run, succeed

from jaxthermo.config.loader import load_config


def test_examples_are_listed_with_what_they_show():
    out = succeed("example")
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
        (("figurine", "--out", "{existing}"), "exists already; name another file"),
        (("figurine", "--out", "{existing}/a.yaml"), "cannot write"),
        (("--out", "{existing}"), "name the example"),
    ],
)
def test_mistakes_are_one_line(tmp_path, arguments, message):
    existing = tmp_path / "there.yaml"
    existing.write_text("kept")
    code, out, err = run("example", *(a.format(existing=existing) for a in arguments))
    assert (code, out) == (2, "")
    assert err.count("\n") == 1 and message in err
    assert existing.read_text() == "kept"


def test_the_schema_is_printed(monkeypatch):
    """What it is that is printed is tested in `test_json_schema`."""

    def title(model):
        return json.dumps({"title": model.__name__})

    monkeypatch.setattr("jaxthermo.config.json_schema.json_schema", title)
    out = succeed("schema")
    assert json.loads(out)["title"] == "SceneConfig"


def test_shell_completion_is_written(tmp_path):
    script = tmp_path / "completion.bash"
    succeed("--install-completion", "--shell", "bash", "--output", script)
    assert "simulate" in script.read_text()
