"""Ways in which commands end: one line and one exit status, in every program."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from cli_runs import SCENE, refused, run
from cyclopts import App

from calibrate.__main__ import main as calibrate
from experiments.__main__ import main as experiments
from jaxthermo.__main__ import main as jaxthermo
from jaxthermo.console.entry import run_app
from tests.sweeping import SWEEP, sweep_file


INPUTS = Path(__file__).parents[1] / "data" / "mesh_and_heat"


def process(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=100,
        env={**os.environ, **environment},
    )


# A machine that lacks something.


def assert_no_device(done: subprocess.CompletedProcess[str], program: str) -> None:
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"{program}: JAX_PLATFORMS=cuda: JAX has no such device")
    assert line.endswith("unset it, or set it to cpu")


def test_a_platform_that_the_machine_lacks(tmp_path):
    (tmp_path / "a.yaml").write_text(SCENE)
    done = process(
        *("-m", "jaxthermo", "simulate", tmp_path / "a.yaml", "--explain"),
        JAX_PLATFORMS="cuda",
    )
    assert_no_device(done, "jaxthermo")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("program", "arguments"),
    [
        ("calibrate", ("plan", "a.yaml", "--tolerance", "3%", "--out", "plan")),
        ("experiments", ("sweep", "sweep.yaml", "--out", "sweep")),
        ("jaxthermo", ("reduce", "a.yaml", "--out", "reduced")),
    ],
)
def test_a_platform_that_other_commands_lack(tmp_path, monkeypatch, program, arguments):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.yaml").write_text(SCENE)
    sweep_file(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(INPUTS.parents[2]))
    assert_no_device(process("-m", program, *arguments, JAX_PLATFORMS="cuda"), program)


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (MemoryError("Unable to allocate 9 TiB"), "out of memory (Unable to allocate"),
        (RuntimeError("RESOURCE_EXHAUSTED: 9 GiB\nlong"), "out of memory (RESOURCE_"),
        (OSError(28, "No space left on device"), "cannot write the output: No space"),
        (PermissionError(13, "Permission denied", "a.x"), "a.x: permission denied"),
    ],
)
def test_a_machine_without_memory_or_space(error, line, capfd):
    app = App(name="tool")

    @app.command
    def work() -> None:
        raise error

    with pytest.raises(SystemExit) as stop:
        run_app(app, "tool", ["work"])
    assert stop.value.code == 2
    (written,) = capfd.readouterr().err.splitlines()
    assert written.startswith(f"tool: {line}")


def test_a_defect_keeps_its_traceback():
    app = App(name="tool")

    @app.command
    def work() -> None:
        raise RuntimeError("the backend of a defect is initialized twice")

    with pytest.raises(RuntimeError, match="of a defect"):
        run_app(app, "tool", ["work"])


# Output that nobody reads.


@pytest.mark.parametrize(
    "command",
    [
        "experiments list",
        pytest.param("jaxthermo example figurine", marks=pytest.mark.slow),
        pytest.param("jaxthermo simulate --help", marks=pytest.mark.slow),
        pytest.param("calibrate show --shipped", marks=pytest.mark.slow),
    ],
)
def test_a_broken_pipe_has_one_status_and_no_word(command):
    # The reader has gone before anything is written.
    script = f"(sleep 1; exec {sys.executable} -m {command}) | true; "
    done = subprocess.run(
        ["bash", "-c", script + "echo ${PIPESTATUS[0]}"],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=INPUTS.parents[2],
    )
    assert (done.stdout.strip(), done.stderr) == ("141", "")


# Interrupts.


def test_an_interrupt_within_an_import_ends_in_one_line(tmp_path):
    """Where a package that is imported could crash, or hide the interrupt."""
    (tmp_path / "interrupted.py").write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(5)\n"
    )
    code = f"""
import sys
sys.path.insert(0, {str(tmp_path)!r})
from jaxthermo.console.entry import make_app, run_app
app = make_app("tool", "")
@app.command
def work():
    try:
        import interrupted
    except BaseException:
        print("imported in part")
run_app(app, "tool", ["work"])
"""
    done = process("-c", code)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "tool: interrupted\n"


def test_an_interrupt_elsewhere_is_an_exception():
    code = """
import os, signal, time
from jaxthermo.console.entry import make_app, run_app
app = make_app("tool", "")
@app.command
def work():
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(5)
    finally:
        print("cleaned up")
run_app(app, "tool", ["work"])
"""
    done = process("-c", code)
    assert (done.returncode, done.stdout) == (130, "cleaned up\n")
    assert done.stderr == "tool: interrupted\n"


def test_an_interrupt_before_the_command_is_one_line():
    code = "import jaxthermo.console.interrupt\nraise KeyboardInterrupt"
    done = process("-c", code)
    assert done.returncode in (130, -2)
    assert done.stderr == "-c: interrupted\n"


# Sweeps and priors.


@pytest.mark.slow
def test_a_sweep_of_which_all_cases_fail(tmp_path):
    text = SWEEP.replace("[0.8, 1, 1.25]", "[1]").replace(
        "\ntruth", "\n  step: {key: solver.dt, values: [1000 s]}\ntruth"
    )
    path = sweep_file(tmp_path, text)
    out = tmp_path / "out"
    finished = run(
        *("sweep", path, "--out", out, "--no-times", "--workers", 1), main=experiments
    )
    assert finished.status == 2
    (line,) = finished.err.splitlines()
    assert line.startswith("experiments: all 2 cases failed, the first by ")
    assert "too long" in line and "--retry" in line
    assert json.loads((out / "result.json").read_text())["cases"]["failed"] == 2


# Mistakes with files, of any command.

NO_MAPPING = {
    "list.yaml": "- a\n- b\n",
    "number.yaml": "3\n",
    "empty.yaml": "",
    "zero.yaml": "\0\0",
    "open.yaml": "a: [1\n",
    "deep.yaml": "a: " + "[" * 3000 + "]" * 3000,
    "itself.yaml": "a: &a [*a]\n",
    "two.yaml": "a: 1\n---\nb: 2\n",
    "object.yaml": "!!python/object:os.system x\n",
    "keys.yaml": "? [a, b]\n: 3\n",
    "null.yaml": "bodies: null\ntime: null\n",
}
READERS = (
    (jaxthermo, "simulate"),
    (jaxthermo, "dataset"),
    (jaxthermo, "reduce"),
    (calibrate, "fit"),
    (calibrate, "identify"),
    (experiments, "sweep"),
)


OFTEN = ("list.yaml", "open.yaml", "keys.yaml")
"""Mistakes that are tested by default."""


def told(main, *arguments) -> str:
    """The lines with which a command ends, of status 2."""
    finished = run(*arguments, main=main)
    assert finished.status == 2, (arguments, finished)
    program = main.__module__.removesuffix(".__main__")
    lines = finished.err.splitlines()
    assert lines and all(line.startswith(f"{program}: ") for line in lines)
    return finished.err


@pytest.mark.parametrize(
    "name",
    [
        name if name in OFTEN else pytest.param(name, marks=pytest.mark.slow)
        for name in NO_MAPPING
    ],
)
def test_configs_that_are_no_mapping(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text(NO_MAPPING[name])
    for main, command in READERS:
        told(main, command, name)
    told(calibrate, "plan", name, "--tolerance", "1%")
    assert os.listdir(tmp_path) == [name]


def test_paths_that_are_no_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "scene.yaml").write_text(SCENE)
    (tmp_path / "loop.yaml").symlink_to(tmp_path / "loop.yaml")
    for path in ("folder", "SCENE.yaml", "loop.yaml", "x" * 300, "scene.yaml/x"):
        for main, command in READERS:
            assert path in told(main, command, path)
    for out in ("scene.yaml", "scene.yaml/x", "/proc/x", "x" * 300):
        assert "--out" in refused("simulate", "scene.yaml", "--out", out)
        assert out in refused("example", "figurine", "--out", f"{out}/x.yaml")
    for main, command, options in (
        (jaxthermo, "render", ()),
        (jaxthermo, "export", ("--format", "vtu")),
        (jaxthermo, "play", ()),
        (calibrate, "show", ()),
        (calibrate, "cards", ()),
        (experiments, "report", ()),
        (experiments, "compare", ("folder",)),
    ):
        for path in ("folder", "nowhere", "scene.yaml"):
            told(main, command, path, *options)


@pytest.mark.parametrize("text", ["[]", '{"format": 3}'])
def test_damaged_results(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    for name in (
        "summary.json",
        "fit.json",
        "result.json",
        "solution.npz",
        "rows.jsonl",
    ):
        folder = tmp_path / name
        folder.mkdir()
        (folder / name).write_text(text)
        (folder / "config.yaml").write_text(text)
        told(jaxthermo, "render", folder)
        told(jaxthermo, "export", folder, "--format", "vtu")
        told(calibrate, "show", folder)
        told(experiments, "compare", folder, folder)
