"""Code of the documentation, run as a reader would run it."""

import itertools
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh
from doc_pages import PAGES, ROOT, blocks, command_lines, name

from tests.xla_flags import FAST_COMPILATION


WITH_CODE = [page for page in PAGES if blocks(page, "python")]
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))

# Pages whose code reads what their commands write, and what holds of the values.
READS_FILES = {
    "docs/guide/other-programs.md": """
np.testing.assert_allclose(of_tiff, kelvin, rtol=1e-6)
np.testing.assert_allclose(of_png, kelvin, atol=0.0051)
np.testing.assert_allclose(of_csv, kelvin, atol=0.0051)
assert abs(mean - kelvin[channels["object_id"].pixels >= 0].mean()) < 10
assert list(stored) == times == run["times"].tolist()
assert len(at_corners) == len(corners) and triangles.max() < len(corners)
assert at_corners.min() < mean < at_corners.max()
assert mask.sum() == first["area"] and mask.shape == image.size[::-1]
"""
}
# What a page takes from the text around its code.
PRELUDE = """
import jax, numpy as np, trimesh, jaxthermo as jt
trimesh.creation.box((30, 20, 40)).export("statue.ply")
open("warm.yaml", "w").write('''
bodies: [{mesh: {path: statue.ply, unit: mm}, pitch: 5 mm, material: copper,
          temperature: 300}]
terms: [{kind: convection, heat_transfer_coefficient: 10, temperature: 290}]
time: {end: 60, save_every: 30}
camera: {width: 64, height: 48}
''')
mesh = jt.load_mesh("statue.ply", unit="mm")
grid = jt.voxelize(mesh, pitch=5e-3)
steel = jt.materials["stainless_steel"]
body = jt.Body(jt.FullVolume(grid), steel, temperature=293.15)
"""
# Another scene of the same shapes, once there is a scene.
OTHER = "other_scene = scene\n"


def run(arguments: list[str], folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        # Each program of a page runs once.
        env={**os.environ, "PYTHONPATH": str(ROOT), "XLA_FLAGS": FAST_COMPILATION},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.slow
@pytest.mark.slice
@pytest.mark.parametrize("page", WITH_CODE, ids=name)
def test_python_of_a_page_runs(page, tmp_path):
    if name(page) in READS_FILES:
        run_commands(page, tmp_path)
    code = PRELUDE
    for text in blocks(page, "python"):
        if "other_scene" in text and "other_scene =" not in code + text:
            code += OTHER
        code += text + "\n"
    run(["-c", code + READS_FILES.get(name(page), "")], tmp_path)


@pytest.mark.slow
def test_the_notebook_runs_and_shows_its_values(tmp_path):
    # A kernel runs in the folder of its notebook, and writes there.
    shutil.copy(ROOT / "docs" / "examples" / "notebook.ipynb", tmp_path)
    output = tmp_path / "executed.ipynb"
    options = ["--to", "notebook", "--execute", "--output", output.name]
    run(["-m", "nbconvert", "notebook.ipynb", *options], tmp_path)
    cells = json.loads(output.read_text())["cells"]
    outputs = [cell["outputs"] for cell in cells if cell["cell_type"] == "code"]
    assert not [o for row in outputs for o in row if o["output_type"] == "error"]
    pages = ["".join(row[-1]["data"].get("text/html", "")) for row in outputs]
    drawn = ["<img src='data:image/png;base64," in page for page in pages]
    # All but the receipt and the values of the probe.
    assert drawn == [True, True, True, True, False, True, False, True]
    assert "included:" in pages[4] and pages[6] == ""


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_an_example_runs(path, tmp_path):
    assert run([str(path), "--quick"], tmp_path)


# Why a command is not run here; all are parsed by test_commands.py.
NOT_RUN = {
    "make": "makes the environment of a checkout",
    "uv run": "as above",
    "pip install": "as above",
    "jaxthermo view": "waits for a browser",
    "jaxthermo play": "waits for a browser",
    "jaxthermo simulate configs/scenes/figurine-steel.yaml --devices 4 --coordinator": (
        "waits for the other process: tests/cli/test_processes.py"
    ),
    "calibrate plan": "takes minutes: tests/cli/test_plan_command.py",
    "experiments run": "takes minutes to hours",
}
# Two runs to be compared, a file to be listed; smaller sizes where a shipped
# configuration is run.
BEFORE = {
    "docs/guide/assemblies.md": ["docs.examples.van_mesh --out van.glb"],
    "docs/guide/results.md": [
        "jaxthermo example figurine --out scene.yaml",
        "jaxthermo simulate scene.yaml --out results/before",
        "jaxthermo simulate scene.yaml --set time.end=1000 --out results/after",
    ],
}
COARSE = ["--set", "set.bodies.0.voxels_high=30"]
LESS = {
    "calibrate fit": ["--set", "fit.max_steps=1", *COARSE],
    "calibrate identify": COARSE,
    "jaxthermo simulate configs": ["--set", "bodies.0.voxels_high=50"],
    "jaxthermo dataset": ["--set", "set.bodies.0.voxels_high=30"],
}


def commands_to_run(page: Path) -> list[list[str]]:
    lines = (" ".join(words) for words in command_lines(page))
    run_here = [not line.startswith(tuple(NOT_RUN)) for line in lines]
    return [*itertools.compress(command_lines(page), run_here)]


WITH_COMMANDS = [page for page in PAGES if commands_to_run(page)]


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_COMMANDS, ids=name)
def test_commands_of_a_page_run(page, tmp_path):
    run_commands(page, tmp_path)


def run_commands(page: Path, folder: Path) -> None:
    """Run them one after the other in one folder, as a reader would in a checkout."""
    (folder / "configs").symlink_to(ROOT / "configs")
    trimesh.creation.box((30, 20, 40)).export(folder / "statue.ply")
    for scene in (text for text in blocks(page, "yaml") if text.startswith("bodies:")):
        (folder / "scene.yaml").write_text(scene)
    lines = [line.split() for line in BEFORE.get(name(page), [])]
    for words in [*lines, *commands_to_run(page)]:
        line = " ".join(words)
        less = [options for start, options in LESS.items() if line.startswith(start)]
        run(["-m", *words, *itertools.chain(*less)], folder)
