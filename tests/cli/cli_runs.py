"""Small scenes for the command line, and the command itself in this process."""

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

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


class Finished(NamedTuple):
    """What a command leaves behind on the terminal."""

    status: object
    out: str
    err: str


def run(*arguments: object, main: Callable[[list[str]], None] = main) -> Finished:
    """Run a command in this process.

    The capture of pytest does the same, but not for fixtures of any scope.
    """
    out = io.StringIO()
    err = io.StringIO()
    status: object = None
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as stopped:
            status = stopped.code
    return Finished(status=status, out=out.getvalue(), err=err.getvalue())


def succeed(*arguments: object, main: Callable[[list[str]], None] = main) -> str:
    """Standard output of a command that ends well, without errors."""
    finished = run(*arguments, main=main)
    assert (finished.status, finished.err) == (0, "")
    return finished.out


def refused(*arguments: object, main: Callable[[list[str]], None] = main) -> str:
    """The one line with which a command is refused; it has no other output."""
    status, out, err = run(*arguments, main=main)
    assert (status, out, err.count("\n")) == (2, "", 1)
    program = main.__module__.removesuffix(".__main__")
    assert err.startswith(f"{program}: ")
    return err


def sets(*changes: str) -> tuple[str, ...]:
    """Words of a command that change values: `--set` before each."""
    return tuple(word for change in changes for word in ("--set", change))


def files(folder: Path) -> set[str]:
    """Everything below a folder, hidden files too."""
    paths = (p.relative_to(folder) for p in folder.rglob("*") if not p.is_dir())
    return {str(path) for path in paths}


def pixels(path: Path) -> np.ndarray:
    """Pixels of a picture."""
    return np.asarray(Image.open(path))


def frame_files(names: set[str] = FRAMES) -> set[str]:
    return {f"frames/{name}.{ending}" for name in names for ending in ("exr", "png")}
