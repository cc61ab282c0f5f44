"""Claim C21: bodies in wind cool by the direction of their normals (figure 5.8)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import altair as alt
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from PIL import Image

import jaxthermo as jt
from jaxthermo.geometry.shapes import cylinder
from jaxthermo.image.surface.camera import frame_all
from jaxthermo.physics.convection.air import kinematic_viscosity, prandtl
from jaxthermo.physics.convection.cross_flow import local_nusselt
from jaxthermo.physics.convection.nusselt import AVERAGES, churchill_bernstein
from jaxthermo.report.chart import Chart
from jaxthermo.report.sheet import sheet
from jaxthermo.report.table import Table
from jaxthermo.voxels.cylinders import cylinder_parts

from ..harness.present import Rows, colour_bar, table_of, thermal_tile
from .convection_numbers import HEIGHT, SHADES, WIDTH, angle_axis


_DIAMETER, _LENGTH = 0.1, 0.05
ACROSS = 48
"""Voxels across the cylinder."""
# m/s and K: on the cylinder a Re of 3e4, where the three averages differ by a fifth.
SPEED, AIR, HOT = 5.0, 300.0, 340.0
# A poor conductor: in a good one the sides would even out and hide the local number.
CERAMIC = jt.Material(conductivity=2.0, density=1800.0, specific_heat=900.0)
# Saved times, and when the choices are compared [s].
_SAVED = (0.0, 60.0, 180.0, 600.0, 1200.0)
_COMPARED = 600.0
# Width of a sector [degrees].
_SECTOR = 10
# Width and height of a picture [px], and the direction in which it looks: what the
# wind meets first is on its left.
_SIZE, _SEEN = (230, 300), (0.5, 1.0, -0.45)


@dataclass(frozen=True, eq=False)
class InWind:
    """A body, upright and hot, in a wind along x."""

    name: str
    grid: jt.VoxelGrid

    @cached_property
    def side(self) -> Bool[np.ndarray, " s"]:
        """True for the fragments of the side."""
        return np.abs(self.grid.fragment_normal[:, 2]) < 0.5

    @cached_property
    def _sector(self) -> Int[np.ndarray, " s"]:
        # By the angle between the wind and the normal, off the vertical axis.
        flat = self.grid.fragment_normal[self.side, :2]
        against = -flat[:, 0] / np.linalg.norm(flat, axis=1)
        degrees = np.degrees(np.arccos(np.clip(against, -1, 1)))
        return np.minimum((degrees / _SECTOR).astype(int), 180 // _SECTOR - 1)

    @cached_property
    def reynolds(self) -> float:
        """Reynolds number of the widest of the cylinders that stand for the body."""
        widest = max(part.diameter for part in cylinder_parts(self.grid).cylinders)
        return SPEED * float(widest) / float(kinematic_viscosity(jnp.asarray(AIR)))

    def scene(self, term: Any, dtype: str = "float32") -> jt.Scene:
        """Scene with one term."""
        body = jt.Body(jt.FullVolume(self.grid), CERAMIC, temperature=HOT)
        return jt.Scene((body,), (term,), dtype=dtype)

    def run(self, term: Any) -> jt.Solution:
        """Run of all saved times."""
        return jt.simulate(self.scene(term), _SAVED[-1], save_at=_SAVED)

    def by_sector(self, surface: Float[Any, "t s"]) -> Float[np.ndarray, "t a"]:
        """Means of the side's temperatures at several times by its sectors [K]."""
        every = np.asarray(surface, float)[:, self.side]
        area = self.grid.fragment_area[self.side]
        sums = [np.bincount(self._sector, area * row) for row in every]
        return np.stack(sums) / np.bincount(self._sector, area)

    def local_numbers(self) -> Float[np.ndarray, " a"]:
        """Local Nusselt number at the middle of each sector, at the start."""
        return np.asarray(_local_numbers(self.reynolds))


_MIDDLE = (np.arange(180 // _SECTOR) + 0.5) * _SECTOR


@jax.jit
def _local_numbers(reynolds):
    # Of no average in particular, since only its order is read.
    film = jnp.asarray((HOT + AIR) / 2)
    every = lambda value: jnp.full(len(_MIDDLE), value)
    flow = every(reynolds), every(prandtl(film))
    cosine = jnp.cos(jnp.radians(jnp.asarray(_MIDDLE)))
    return local_nusselt(cosine, *flow, churchill_bernstein)


def cylinder_in_wind(across: int = ACROSS) -> InWind:
    """A cylinder of so many voxels across."""
    mesh = cylinder(_DIAMETER / 2, _LENGTH, 128)
    return InWind("cylinder", jt.voxelize(mesh, _DIAMETER / across))


def wind(average: str = AVERAGES[0].name) -> jt.Wind:
    """The wind, from the left."""
    return jt.Wind((SPEED, 0.0, 0.0), AIR, average=average)


def cooled_order(case: InWind, solution: jt.Solution) -> dict[str, Any]:
    """Temperatures of the side by angle, and how they follow the local number."""
    sectors = case.by_sector(solution.surface_temperature)
    local = case.local_numbers()
    rank = lambda values: np.argsort(np.argsort(values))
    correlation = lambda a, b: float(np.corrcoef(a, b)[0, 1])
    # At the start the side is even.
    order = [
        {
            "time_s": time,
            "mean_K": float(solution.mean_temperature[index, 0]),
            "range_K": float(np.ptp(sectors[index])),
            "correlation": correlation(sectors[index], local),
            "rank_correlation": correlation(rank(sectors[index]), rank(local)),
            "coldest_deg": float(_MIDDLE[sectors[index].argmin()]),
            "warmest_deg": float(_MIDDLE[sectors[index].argmax()]),
        }
        for index, time in enumerate(_SAVED)
        if time > 0
    ]
    return {
        "speed_m_s": SPEED,
        "Re": case.reynolds,
        "times_s": list(_SAVED),
        "sector_middle_deg": _MIDDLE.tolist(),
        "temperature_K": sectors.tolist(),
        "local_number": local.tolist(),
        "largest_number_deg": float(_MIDDLE[local.argmax()]),
        "smallest_number_deg": float(_MIDDLE[local.argmin()]),
        "order": order,
    }


def compare_choices(case: InWind, runs: dict[str, jt.Solution]) -> Rows:
    """Temperatures by runs with several averages, and by a fixed h beside them."""
    # The same heat as of the first one at first, spread evenly.
    h = _mean_coefficient(case, wind(next(iter(runs))))
    fixed = {f"fixed h = {h:.1f} W/m²K": case.run(jt.Convection(h, AIR))}
    at, rows = _SAVED.index(_COMPARED), []
    for name, solution in {**runs, **fixed}.items():
        side = case.by_sector(solution.surface_temperature)[at]
        row = {"name": name, "mean_K": float(solution.mean_temperature[at, 0])}
        row |= {"side_lowest_K": float(side.min()), "side_highest_K": float(side.max())}
        rows.append({**row, "side_range_K": float(np.ptp(side))})
    return rows


def _mean_coefficient(case: InWind, term: jt.Wind) -> float:
    # The h that takes from the whole surface what the wind takes at first. float64,
    # since in a millisecond the body loses next to nothing.
    short = jt.simulate(case.scene(term, "float64"), 1e-3)
    lost = -float(short.energy.mechanisms["wind"][0]) / 1e-3
    return lost / (case.grid.fragment_area.sum() * (HOT - AIR))


def cooling_sheet(case: InWind, solution: jt.Solution) -> Image.Image:
    """A body at the saved times on one scale, the wind from the left.

    Each picture is of the surface less its mean at that time: the whole cools by more
    than its sides differ.
    """
    camera = frame_all(case.grid.mesh.triangles, *_SIZE, _SEEN)
    shots = []
    for index in range(1, len(_SAVED)):
        image = jt.render(solution, camera, index)
        surface = np.asarray(solution.surface_temperature[index], float)
        mean = float(np.average(surface, weights=case.grid.fragment_area))
        kelvin, body = np.asarray(image.temperature), np.asarray(image.object_id) >= 0
        shots.append((kelvin - mean, body, mean))
    # Thin parts are much colder than the rest.
    low = min(float(np.quantile(kelvin[body], 0.03)) for kelvin, body, _ in shots)
    high = max(float(np.quantile(kelvin[body], 0.995)) for kelvin, body, _ in shots)
    tiles = [
        thermal_tile(
            *(kelvin, body, (low, high)),
            *(f"{time:g} s", f"surface mean {mean:.1f} K"),
        )
        for time, (kelvin, body, mean) in zip(_SAVED[1:], shots, strict=True)
    ]
    title = f"{case.name}, wind of {SPEED:g} m/s from left to right"
    bar = colour_bar(low, high, "surface temperature less its mean at that time [K]")
    return sheet(tiles, bar, title, columns=len(tiles))


def cooling_chart(found: dict[str, Any], title: str) -> Chart:
    """Temperature of the side less its mean by angle, at the saved times."""
    # The start is left out: there the side is even.
    points = [
        {"time": f"{time:g} s", "angle": angle, "T": value - float(np.mean(row))}
        for time, row in zip(found["times_s"], found["temperature_K"], strict=True)
        for angle, value in zip(found["sector_middle_deg"], row, strict=True)
        if time > 0
    ]
    names = list(dict.fromkeys(point["time"] for point in points))
    scale = alt.Scale(domain=names, range=list(SHADES[: len(names)]))
    base = alt.Chart(alt.Data(values=points)).encode(
        x=angle_axis(),
        y=alt.Y("T:Q", title="temperature less the side's mean [K]"),
        color=alt.Color("time:N", title=None, sort=None, scale=scale),
    )
    both = alt.layer(base.mark_line(strokeWidth=2), base.mark_point(filled=True))
    return both.properties(width=WIDTH, height=HEIGHT, title=title)


def choice_table(found: dict[str, Any]) -> Table:
    """Temperatures of the cylinder by the choice of the average."""
    columns = [
        ("", "{name}"),
        ("mean [K]", "{mean_K:.2f}"),
        ("side, coldest [K]", "{side_lowest_K:.2f}"),
        ("warmest [K]", "{side_highest_K:.2f}"),
        ("range [K]", "{side_range_K:.2f}"),
    ]
    title = f"A cylinder after {_COMPARED:g} s at Re {found['Re']:.3g}"
    return table_of(found["choices"], columns, title)
