"""The statue in the sun, as any structure of its voxels, and pictures of it.

The thesis gives neither material nor step. Here 3600 of the largest stable steps of 250
voxels are 180 s, its last time: so its iterations and its seconds fit one scene.
"""

from collections.abc import Callable, Mapping, Sequence
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
from jaxthermo.report.sheet import Tile, colour_bar, sheet
from jaxthermo.structures.structure import AbstractStructure

from .bodies import buddha, levels_at
from .exhibit import rms


QUICK_HEIGHT = 125
"""Voxels along up in the reduced size."""
END = 180.0
"""Time of 3600 iterations at 250 voxels [s]."""
START = 293.15
"""Temperature at the start [K]."""

# Carbon steel, with a heat capacity at which the largest stable step is 0.05 s.
_STEEL = jt.Material(50.0, density=7800.0, specific_heat=480.8, absorptivity=1.0)
# From the statue's left, which is on the right of a picture from the front [W/m^2].
_SUN = jt.Sun((-1.0, 0.0, 0.0), 5000.0)
_VIEWS = {
    "front": (-0.35, 1.0, -0.2),
    "left side": (-1.0, 0.35, -0.2),
    "back": (0.35, -1.0, -0.2),
}
# Of one statue in a picture [px].
_WIDTH = 120
_TALL = 280
_GAP = 4


class Heated(NamedTuple):
    """A run of one structure."""

    structure: AbstractStructure
    solution: jt.Solution

    @property
    def surface(self) -> Float[np.ndarray, "t s"]:
        """Surface temperature at each saved time [K]."""
        return np.asarray(self.solution.surface_temperature)

    @property
    def capacity_ratio(self) -> float:
        """Heat capacity of the structure over that of the body [-]."""
        return float(self.solution.receipt.capacity_ratios[0])

    @property
    def final_rise(self) -> float:
        """Mean rise of the temperature at the end [K]."""
        return float(self.solution.mean_temperature[-1, 0]) - START


@cache
def _built(name: str, height: int) -> AbstractStructure:
    grid = buddha().grid(height, "dominant_axis")
    match name.split():
        case ["full", "volume"]:
            return jt.FullVolume(grid)
        case ["single", "shell"]:
            return jt.SingleShell(grid)
        case ["irregular", "levels"]:
            return jt.IrregularMultiLevel(grid, levels=7)
        case [count, "levels"]:
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
    # All surfaces are read where the full volume's nodes are.
    is_full = isinstance(structure, jt.FullVolume)
    surface_map = jt.ConstantMap() if is_full else jt.FluxCorrectedMap(at="voxel")
    body = jt.Body(structure, _STEEL, temperature=START, surface_map=surface_map)
    scene = jt.Scene((body,), (_SUN,))
    return Heated(
        structure, jt.simulate(scene, times[-1], times, solver=jt.ForwardEuler())
    )


class Difference(NamedTuple):
    """Difference of a structure's surface from the full volume's, at each time."""

    kelvin: list[float]
    """Root mean square over the area [K]."""
    percent: list[float]
    """Root mean square over that of the full volume's rise [%]."""


def difference(run: Heated, full: Heated) -> Difference:
    """Compare the surfaces of two runs."""
    # Not over the span: single voxels that touch nothing are a hundred kelvin warm.
    area = full.structure.grid.fragment_area
    kelvin = [rms(error, area) for error in run.surface - full.surface]
    rises = [rms(rise, area) for rise in full.surface - START]
    percent = [100 * error / rise for error, rise in zip(kelvin, rises, strict=True)]
    return Difference(kelvin, percent)


class _View(NamedTuple):
    """Temperatures that a camera sees [K], and where it sees the statue."""

    kelvin: Float[np.ndarray, "h w"]
    body: Bool[np.ndarray, "h w"]


def _cameras() -> dict[str, Camera]:
    triangles = buddha().mesh.triangles
    return {
        name: frame_all(triangles, _WIDTH, _TALL, direction)
        for name, direction in _VIEWS.items()
    }


def _view(run: Heated, camera: Camera, time: int) -> _View:
    image = jt.render(run.solution, camera, time)
    return _View(np.asarray(image.temperature), np.asarray(image.object_id) >= 0)


def thermal_sheet(
    runs: Mapping[str, Heated],
    label: Callable[[float], str],
    views: Sequence[str] = tuple(_VIEWS),
    columns: int | None = None,
) -> Image.Image:
    """Statues side by side in one picture, for each saved time and view.

    Args:
        runs: from left to right.
        label: words for a time [s].
        views: names of the directions, from left to right.
        columns: pictures in a row; the number of views if None.
    """
    cameras = _cameras()
    times = next(iter(runs.values())).solution.times
    shots = {
        f"{label(float(time))}, {view}": [
            _view(run, cameras[view], index) for run in runs.values()
        ]
        for index, time in enumerate(times)
        for view in views
    }
    # The hottest of a hundred texels may be a spike of the shell.
    high = max(
        float(np.percentile(shot.kelvin[shot.body], 99.5)) - START
        for statues in shots.values()
        for shot in statues
    )
    gap = np.full((_TALL, _GAP, 3), 16, np.uint8)
    tiles = []
    for name, statues in shots.items():
        strips = [strip for shot in statues for strip in (gap, _coloured(shot, high))]
        pixels = np.concatenate(strips[1:], axis=1)
        tiles.append(Tile(pixels, name, " | ".join(runs)))
    bar = colour_bar(0.0, high, "rise of the surface temperature [K]")
    return sheet(tiles, bar, " | ".join(runs), columns or len(views))


def _coloured(shot: _View, high: float) -> UInt8[np.ndarray, "h w 3"]:
    colours = apply_palette(shot.kelvin - START, 0.0, high, "iron")
    colours[~shot.body] = BACKGROUND
    return colours


def difference_sheet(
    runs: Mapping[str, Heated], full: Heated, title: str
) -> Image.Image:
    """Structures less the full volume at the end, from three sides, on one scale."""
    cameras = _cameras()
    expected = {view: _view(full, camera, -1) for view, camera in cameras.items()}
    differences = {
        (name, view): _view(run, cameras[view], -1).kelvin - expected[view].kelvin
        for name, run in runs.items()
        for view in cameras
    }
    largest = max(
        float(np.percentile(np.abs(values[expected[view].body]), 99.5))
        for (_, view), values in differences.items()
    )
    scale = DifferenceScale(nice_limit(largest))
    tiles = [
        Tile(scale.picture(values, expected[view].body), f"{name}, {view}")
        for (name, view), values in differences.items()
    ]
    bar = difference_bar(scale, "structure less full volume [K]")
    return sheet(tiles, bar, title, columns=min(len(tiles), 9))
