"""The statue in the sun, as any structure of its voxels, and pictures of it.

The thesis gives neither material nor step. Here 3600 of the largest stable steps of 250
voxels are 180 s, its last time: so its iterations and its seconds fit one scene.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from PIL import Image

import jaxthermo as jt
from jaxthermo.image.surface.camera import Camera, frame_all
from jaxthermo.structures.structure import AbstractStructure

from ..harness.meshes import START
from ..harness.present import Shot, difference_sheet, thermal_sheet
from .bodies import buddha, levels_at
from .exhibit import rms
from .sunlit import Sunlit


QUICK_HEIGHT = 125
"""Voxels along up in the reduced size."""
END = 180.0
"""Time of 3600 iterations at 250 voxels [s]."""

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


def heated(name: str, height: int, times: tuple[float, ...]) -> Heated:
    """The run of "full volume", "single shell", "irregular levels" or "10 levels".

    Args:
        name: of the structure; a number of levels is that at 250 voxels.
        height: voxels along up.
        times: saved [s].
    """
    structure = _built(name, height)
    statue = Sunlit(structure.voxels, _STEEL, terms=(_SUN,), save_at=times)
    return Heated(structure, statue.solve(structure))


class _Difference(NamedTuple):
    """Difference of a structure's surface from the full volume's, at each time."""

    kelvin: list[float]
    """Root mean square over the area [K]."""
    percent: list[float]
    """Root mean square over that of the full volume's rise [%]."""


def difference(run: Heated, full: Heated) -> _Difference:
    """Compare the surfaces of two runs."""
    # Not over the span: single voxels that touch nothing are a hundred kelvin warm.
    area = full.structure.grid.fragment_area
    kelvin = [rms(error, area) for error in run.surface - full.surface]
    rises = [rms(rise, area) for rise in full.surface - START]
    percent = [100 * error / rise for error, rise in zip(kelvin, rises, strict=True)]
    return _Difference(kelvin, percent)


def _cameras() -> dict[str, Camera]:
    triangles = buddha().mesh.triangles
    return {
        name: frame_all(triangles, _WIDTH, _TALL, direction)
        for name, direction in _VIEWS.items()
    }


def _seen(run: Heated, camera: Camera, time: int, name: str = "") -> Shot:
    """Rise of the temperatures that a camera sees [K]."""
    image = jt.render(run.solution, camera, time)
    rise = np.asarray(image.temperature) - START
    return Shot(rise, np.asarray(image.object_id) >= 0, name)


def statue_sheet(
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
    title = " | ".join(runs)
    times = next(iter(runs.values())).solution.times
    shots = []
    peaks = []
    for index, time in enumerate(times):
        for view in views:
            statues = [_seen(run, cameras[view], index) for run in runs.values()]
            # The hottest of a hundred texels may be a spike of the shell.
            peaks += [np.percentile(one.values[one.body], 99.5) for one in statues]
            values = np.hstack([statue.values for statue in statues])
            body = np.hstack([statue.body for statue in statues])
            name = f"{label(float(time))}, {view}"
            shots.append(Shot(values, body, name=name, note=title))
    return thermal_sheet(
        shots,
        limits=(0.0, float(max(peaks))),
        scale="rise of the surface temperature [K]",
        title=title,
        columns=columns or len(views),
    )


def full_volume_sheet(
    runs: Mapping[str, Heated], full: Heated, title: str
) -> Image.Image:
    """Structures less the full volume at the end, from three sides, on one scale."""
    shots = []
    for name, run in runs.items():
        for view, camera in _cameras().items():
            seen = _seen(run, camera, -1, name=f"{name}, {view}")
            expected = _seen(full, camera, -1)
            shots.append(seen._replace(values=seen.values - expected.values))
    sizes = [np.abs(shot.values[shot.body]) for shot in shots]
    peaks = [np.percentile(of_body, 99.5) for of_body in sizes]
    return difference_sheet(
        shots,
        largest=float(max(peaks)),
        scale="structure less full volume [K]",
        title=title,
        columns=len(shots),
    )
