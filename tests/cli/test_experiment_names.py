"""`experiments run NAME`: names and options that do not fit are one line."""

import pytest

from experiments import catalogue
from experiments.__main__ import main
from tests.cli.cli_runs import run, succeed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("stencil", "--height", "40"), "height: stencil takes no options"),
        (("voxelize", "no.yaml"), "config: voxelize takes no options"),
        (("levels", "--height", "tall"), "--height"),
        (("levels", "--cases", "C99"), "there are C01 to C27, "),
        (
            ("thesis", "--cases", "figure-9"),
            "there are C01 to C27, section-1.3-image, ",
        ),
        (("thesis", "--height", "40"), "height: thesis takes cases"),
        (("budget", "no.yaml"), "no.yaml"),
        (("benchmarks", "--height", "40"), "height: stencil takes no options"),
        (("steps", "--resume"), "only `run benchmarks` takes it"),
        (("wake-data", "--quick"), "wake-data has no quick size"),
        (("level",), "did you mean levels?"),
        (("structures",), "use `experiments run front configs/sweeps/structures.yaml`"),
        (("contact",), "use `experiments run thesis --cases C17,C18,C19`"),
        (("stepping",), "use `experiments run front configs/sweeps/stepping.yaml`"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(tmp_path, arguments, message, monkeypatch):
    # The built-in figurine, without meshes.
    monkeypatch.setenv("JAXTHERMO_MESHES", str(tmp_path))
    code, out, err = run("run", *arguments, "--out", tmp_path / "out", main=main)
    assert (code, out) == (2, "")
    assert err.startswith("experiments: ") and err.count("\n") == 1
    assert message in err


def test_the_list_is_in_groups():
    text = succeed("list", main=main)
    titles = [line for line in text.splitlines() if not line.startswith("  ")]
    assert [title.split(",")[0] for title in titles] == [
        "benchmarks",
        "error against run time:",
        "the thesis",
        "how true it is:",
    ]
    names = [line.split()[0] for line in text.splitlines() if line.startswith("  ")]
    assert sorted(names) == sorted(e.name for e in catalogue.EXPERIMENTS)


def test_meshes_that_are_missing_say_where_to_put_them(tmp_path, monkeypatch):
    monkeypatch.delenv("JAXTHERMO_MESHES", raising=False)
    code, out, err = run("run", "budget", "--out", tmp_path / "out", main=main)
    assert (code, out) == (2, "")
    assert "JAXTHERMO_MESHES" in err and "happy-buddha.obj" in err
