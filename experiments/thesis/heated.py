"""The statue in the sun, as any structure of its voxels, and pictures of it.

The thesis gives neither material nor step. Here 3600 of the largest stable steps of 250
voxels are 180 s, its last time: so its iterations and its seconds fit one scene.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image

import jaxthermo as jt
from jaxthermo.image.colour.palette import apply_palette
from jaxthermo.image.surface.camera import Camera, frame_all
from jaxthermo.report.difference_scale import (
    BACKGROUND,
    DifferenceScale,
    difference_bar,
    nice_limit,
)
from jaxthermo.report.sheet import Tile, sheet
from jaxthermo.structures.structure import AbstractStructure

from ..harness.present import colour_bar
from .bodies import buddha


HEIGHT, QUICK_HEIGHT = 250, 125
"""Voxels along up: the thesis' 100x250x100, and the reduced size."""
END = 180.0
"""Time of 3600 iterations at 250 voxels [s]."""

# Carbon steel, with a heat capacity at which the largest stable step is 0.05 s.
_STEEL = jt.Material(50.0, density=7800.0, specific_heat=480.8, absorptivity=1.0)
START, _IRRADIANCE = 293.15, 5000.0
"""Temperature at the start [K], and irradiance [W/m^2]."""
# From the statue's left, which is on the right of a picture from the front.
_SUN = jt.Sun((-1.0, 0.0, 0.0), _IRRADIANCE)
_VIEWS = {
    "front": (-0.35, 1.0, -0.2),
    "left side": (-1.0, 0.35, -0.2),
    "back": (0.35, -1.0, -0.2),
}
# Of one statue in a picture [px].
_WIDTH, _TALL, _GAP = 120, 280, 4

Build = Callable[[jt.VoxelGrid], AbstractStructure]

CHOSEN = (
    ("material", "carbon steel of 1.33e-5 m²/s, 0.5 m high; the thesis names none"),
    ("heat", "5000 W/m² from the statue's left, no losses; the thesis names none"),
    (
        "steps",
        "the largest stable one of each structure; for 250 voxels 0.05 s, so that 3600 "
        "are 180 s and the thesis' iterations and seconds agree (inferred, not given)",
    ),
    ("weights", "all 1: nothing is tuned"),
)


class Heated(NamedTuple):
    """A run of one structure."""

    structure: AbstractStructure
    solution: jt.Solution

    def rise(self, time: int) -> float:
        """Mean rise of the temperature at a saved time [K]."""
        return float(self.solution.mean_temperature[time, 0]) - START


def levels_at(height: int, levels: int) -> int:
    """Levels of another resolution that reach as deep as `levels` at 250 voxels."""
    return max(1, round(levels * height / HEIGHT))


@cache
def _built(name: str, height: int) -> AbstractStructure:
    grid = buddha().grid(height, "dominant_axis")
    match name.split():
        case ["full", *_]:
            return jt.FullVolume(grid)
        case ["single", *_]:
            return jt.SingleShell(grid)
        case ["irregular", *_]:
            return jt.IrregularMultiLevel(grid, levels=7)
        case [count, *_]:
            return jt.MultiLevel(grid, levels=levels_at(height, int(count)))
    raise KeyError(name)


@cache
def heated(name: str, height: int, times: tuple[float, ...]) -> Heated:
    """The run of "full volume", "single shell", "irregular levels" or "10 levels".

    Args:
        name: of the structure; a number of levels is that at 250 voxels.
        height: voxels along up.
        times: saved [s].
    """
    structure = _built(name, height)
    # Read where the full volume's nodes are.
    whole = isinstance(structure, jt.FullVolume)
    reads = jt.ConstantMap() if whole else jt.FluxCorrectedMap(at="voxel")
    body = jt.Body(structure, _STEEL, temperature=START, surface_map=reads)
    scene = jt.Scene((body,), (_SUN,))
    run = jt.simulate(scene, times[-1], times, solver=jt.ForwardEuler())
    return Heated(structure, run)


class Difference(NamedTuple):
    """Difference of a structure's surface from the full volume's, at each time."""

    kelvin: list[float]
    """Root mean square over the area [K]."""
    percent: list[float]
    """The same over the root mean square of the full volume's rise [%]."""


def difference(run: Heated, full: Heated) -> Difference:
    """Compare the surfaces of two runs."""
    # Not over the span: single voxels that touch nothing are a hundred kelvin warm.
    area = full.structure.grid.fragment_area
    found, right = (np.asarray(r.solution.surface_temperature) for r in (run, full))
    rms = lambda kelvin: np.sqrt(np.average(kelvin**2, axis=1, weights=area))
    kelvin = rms(found - right)
    return Difference(kelvin.tolist(), (100 * kelvin / rms(right - START)).tolist())


class View(NamedTuple):
    """Temperatures that a camera sees [K], and where it sees the statue."""

    kelvin: Float[np.ndarray, "h w"]
    body: Bool[np.ndarray, "h w"]


def _cameras() -> dict[str, Camera]:
    triangles = buddha().mesh.triangles
    return {
        name: frame_all(triangles, _WIDTH, _TALL, direction)
        for name, direction in _VIEWS.items()
    }


def _view(run: Heated, camera: Camera, time: int) -> View:
    image = jt.render(run.solution, camera, time)
    return View(np.asarray(image.temperature), np.asarray(image.object_id) >= 0)


def _beside(pictures: Sequence[UInt8[np.ndarray, "h w 3"]]) -> np.ndarray:
    gap = np.full((_TALL, _GAP, 3), 16, np.uint8)
    parts = [part for picture in pictures for part in (gap, picture)]
    return np.concatenate(parts[1:], axis=1)


def thermal_sheet(
    runs: dict[str, Heated],
    times: Sequence[int],
    label: Callable[[float], str],
    title: str,
    views: Sequence[str] = tuple(_VIEWS),
    columns: int | None = None,
) -> Image.Image:
    """Statues side by side in one picture, for each time and view, on one scale.

    Args:
        runs: from left to right.
        times: indices of saved times, a row or a picture each.
        label: words for a time [s].
        title: of the sheet.
        views: names of the directions, from left to right.
        columns: pictures in a row; the number of views if None.
    """
    cameras = _cameras()
    shots = {
        (time, view): [_view(run, cameras[view], time) for run in runs.values()]
        for time in times
        for view in views
    }
    shown = [shot for each in shots.values() for shot in each]
    # The hottest of a hundred texels may be a spike of the shell.
    high = max(float(np.percentile(s.kelvin[s.body], 99.5)) for s in shown) - START
    saved = next(iter(runs.values())).solution.times
    tiles = []
    for (time, view), each in shots.items():
        colours = [_coloured(shot, high) for shot in each]
        name = f"{label(float(saved[time]))}, {view}"
        tiles.append(Tile(_beside(colours), name, " | ".join(runs)))
    bar = colour_bar(0.0, high, "rise of the surface temperature [K]")
    return sheet(tiles, bar, title, columns or len(views))


def _coloured(shot: View, high: float) -> UInt8[np.ndarray, "h w 3"]:
    colours = apply_palette(shot.kelvin - START, 0.0, high, "iron")
    colours[~shot.body] = BACKGROUND
    return colours


def difference_sheet(
    runs: dict[str, Heated], full: Heated, time: int, title: str
) -> Image.Image:
    """Structures less the full volume at one time, from three sides, on one scale."""
    found = {}
    for name, camera in _cameras().items():
        right = _view(full, camera, time)
        for run, each in runs.items():
            wrong = _view(each, camera, time)
            found[run, name] = wrong.kelvin - right.kelvin, right.body
    each = (np.abs(d[body]) for d, body in found.values())
    largest = max(float(np.percentile(kelvin, 99.5)) for kelvin in each)
    scale = DifferenceScale(nice_limit(largest))
    tiles = [
        Tile(scale.picture(difference, body), f"{run}, {name}")
        for (run, name), (difference, body) in sorted(
            found.items(), key=lambda item: list(runs).index(item[0][0])
        )
    ]
    bar = difference_bar(scale, "structure less full volume [K]")
    return sheet(tiles, bar, title, columns=min(len(tiles), 9))
