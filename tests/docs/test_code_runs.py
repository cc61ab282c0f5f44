"""Code of the documentation, run as a reader would run it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from doc_pages import PAGES, ROOT, blocks


WITH_CODE = [page for page in PAGES if blocks(page, "python")]
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))

# What a page takes from the text around its code.
PRELUDE = """
import jax, numpy as np, trimesh, jaxthermo as jt
trimesh.creation.box((30, 20, 40)).export("statue.ply")
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
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.slow
@pytest.mark.slice
@pytest.mark.parametrize("page", WITH_CODE, ids=lambda p: str(p.relative_to(ROOT)))
def test_python_of_a_page_runs(page, tmp_path):
    code = PRELUDE
    for text in blocks(page, "python"):
        if "other_scene" in text and "other_scene =" not in code + text:
            code += OTHER
        code += text + "\n"
    run(["-c", code], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_an_example_runs(path, tmp_path):
    assert run([str(path), "--quick"], tmp_path)
