"""Small scenes for the command line, and the command itself in this process."""

import contextlib
import io
from collections.abc import Callable
from pathlib import Path

from jaxthermo.__main__ import main


SCENE = """
name: block
bodies:
  - shape: {kind: box, size: [5 cm, 4 cm, 10 cm]}
    voxels_high: 12
    material: stainless_steel
    temperature: 300
terms:
  - {kind: sun, direction: [-0.5, 0.6, -0.7], irradiance: 5 kW/m^2, until: 5}
  - {kind: convection, heat_transfer_coefficient: 10, temperature: 290}
  - {kind: surroundings, temperature: 280}
time: {end: 20, save_at: [5, 12, 20]}
camera: {width: 64, height: 48}
"""

RESULTS = {"config.yaml", "energy.csv", "solution.npz", "summary.json"}
FRAMES = {"t000005.00s", "t000012.00s", "t000020.00s"}


def scene_file(folder: Path, text: str = SCENE) -> Path:
    path = folder / "block.yaml"
    path.write_text(text)
    return path


def run(
    *arguments: object, main: Callable[[list[str]], None] = main
) -> tuple[object, str, str]:
    """Exit status, standard output and standard error of a command.

    What pytest's own capture would give, but for fixtures of any scope.
    """
    out, err = io.StringIO(), io.StringIO()
    code: object = None
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as stopped:
            code = stopped.code
    return code, out.getvalue(), err.getvalue()


def files(folder: Path) -> set[str]:
    """Everything below a folder, hidden files too."""
    paths = (p.relative_to(folder) for p in folder.rglob("*") if not p.is_dir())
    return {str(path) for path in paths}


def frame_files(names: set[str] = FRAMES) -> set[str]:
    return {f"frames/{name}.{kind}" for name in names for kind in ("exr", "png")}
