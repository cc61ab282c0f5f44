"""`jaxthermo simulate` in two processes over loopback, against one process."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from cli_runs import run, succeed
from killing import kill, start

from jaxthermo.parallel.meeting import free_port


SCENE = """
bodies:
  - shape: {kind: box, size: [2 cm, 7 cm, 3 cm]}
    pitch: 5 mm
    material: copper
    temperature: 350 K
terms:
  - {kind: convection, heat_transfer_coefficient: 50 W/(m^2 K), temperature: 280 K}
time: {end: 20 s, save_at: [10, 20]}
solver: {kind: forward_euler, dt: STEP s}
camera: {width: 40, height: 40}
"""
COMMAND = """
import sys
import jaxthermo.cli.simulate as command
from jaxthermo.__main__ import main

command._CHECKPOINT_EVERY = 0.5
main(sys.argv[1:])
"""
pytestmark = pytest.mark.slow


def start_both(scene: Path, out: Path) -> list[subprocess.Popen[bytes]]:
    coordinator = f"localhost:{free_port()}"
    return [
        start(
            COMMAND,
            *("simulate", scene, "--out", out, "--coordinator", coordinator),
            *("--devices", 2, "--processes", 2, "--process", number),
            stderr=subprocess.PIPE,
        )
        for number in (0, 1)
    ]


def errors_of(process: subprocess.Popen[bytes], seconds: float) -> str:
    """What a process has said as errors when it ends."""
    return process.communicate(timeout=seconds)[1].decode()


def scene_file(folder: Path, step: float) -> Path:
    path = folder / "scene.yaml"
    path.write_text(SCENE.replace("STEP", str(step)))
    return path


def surface(out: Path) -> np.ndarray:
    with np.load(out / "solution.npz") as stored:
        return stored["surface_temperature"]


def test_two_processes_write_the_results_of_one(tmp_path):
    scene = scene_file(tmp_path, 0.03)
    together = tmp_path / "together"
    alone = tmp_path / "alone"
    for process in start_both(scene, together):
        err = errors_of(process, 300)
        assert process.returncode == 0, err
    assert run("simulate", scene, "--out", alone)[0] == 0
    names = {path.name for path in together.iterdir()}
    assert names == {path.name for path in alone.iterdir()}
    temperature = surface(together)
    assert temperature.min() < 349.0
    # Four roundings of a temperature in float32.
    np.testing.assert_allclose(temperature, surface(alone), rtol=0, atol=1.3e-4)


@pytest.mark.parametrize("lost", [0, pytest.param(1, marks=pytest.mark.slice)])
def test_a_lost_process_ends_the_other_and_one_goes_on(tmp_path, out, lost):
    # Twenty thousand short steps: long enough to be killed.
    scene = scene_file(tmp_path, 0.001)
    processes = start_both(scene, out)
    assert kill(processes[lost], 0.0, (out / "checkpoint-1.npz").exists)
    err = errors_of(processes[1 - lost], 60)
    errors_of(processes[lost], 60)
    if lost == 0 and processes[1].returncode != 2:
        # JAX may notice the loss of the first process sooner, and aborts.
        assert "another task died" in err, err
    else:
        assert processes[1 - lost].returncode == 2, err
        assert (
            "jaxthermo: another process is lost, or cannot be reached; the same "
            "commands go on from the last checkpoint"
        ) in err.splitlines()
    text = succeed("simulate", scene, "--out", out)
    assert "going on from" in text
    assert not list(out.glob("checkpoint*"))
    alone = tmp_path / "alone"
    assert run("simulate", scene, "--out", alone)[0] == 0
    np.testing.assert_allclose(surface(out), surface(alone), rtol=0, atol=2e-3)
