"""Claim C21: a cylinder in wind cools by the direction of its normal (figure 5.8)."""

from pathlib import Path
from typing import Any

import altair as alt
import jax.numpy as jnp
import numpy as np
from PIL import Image

import jaxthermo as jt
from jaxthermo.geometry.shapes import cylinder
from jaxthermo.image.annotate import contact_sheet, write_png
from jaxthermo.image.files import picture
from jaxthermo.physics.convection.air import kinematic_viscosity, prandtl
from jaxthermo.physics.convection.cross_flow import local_nusselt
from jaxthermo.physics.convection.nusselt import AVERAGES, churchill_bernstein
from jaxthermo.report.chart import Chart
from jaxthermo.report.table import Table

from ..harness.present import table_of
from .convection_numbers import HEIGHT, SHADES, WIDTH, angle_axis


_DIAMETER, _LENGTH = 0.1, 0.05
# Voxels across.
_ACROSS = 48
# m/s and K: a Re of 3e4, where the three averages differ by a fifth. The thesis names
# no numbers with figure 5.8.
_SPEED, AIR, HOT = 5.0, 300.0, 340.0
# A poor conductor: in a good one the sides would even out and hide the local number.
_CERAMIC = jt.Material(conductivity=2.0, density=1800.0, specific_heat=900.0)
# Saved times, and when the choices are compared [s].
_SAVED = (0.0, 60.0, 180.0, 600.0, 1200.0)
_COMPARED = 600.0
# Width of a sector [degrees].
_SECTOR = 10


class _Cooling:
    # One cylinder, upright, in a wind along x.
    def __init__(self):
        self.grid = jt.voxelize(
            cylinder(_DIAMETER / 2, _LENGTH, 128), _DIAMETER / _ACROSS
        )
        normal = self.grid.fragment_normal
        self.side = np.abs(normal[:, 2]) < 0.5
        degrees = np.degrees(np.arccos(np.clip(-normal[self.side, 0], -1, 1)))
        count = 180 // _SECTOR
        self.sector = np.minimum((degrees / _SECTOR).astype(int), count - 1)
        viscosity = float(kinematic_viscosity(jnp.asarray(AIR)))
        self.reynolds = _SPEED * _DIAMETER / viscosity
        self.middle = (np.arange(count) + 0.5) * _SECTOR

    def scene(self, term: Any, dtype: str = "float32") -> jt.Scene:
        body = jt.Body(jt.FullVolume(self.grid), _CERAMIC, temperature=HOT)
        return jt.Scene((body,), (term,), dtype=dtype)

    def run(self, term: Any) -> jt.Solution:
        return jt.simulate(self.scene(term), _SAVED[-1], save_at=_SAVED)

    def by_sector(self, solution: jt.Solution) -> np.ndarray:
        # Mean temperature of the side's sectors [times, sectors].
        every = np.asarray(solution.surface_temperature, float)[:, self.side]
        count = np.bincount(self.sector)
        return np.stack([np.bincount(self.sector, row) / count for row in every])

    def local_numbers(self) -> np.ndarray:
        # At the middle of each sector, at the start; of no average in particular, since
        # only its correlation with the temperatures is read.
        film = jnp.asarray((HOT + AIR) / 2)
        every = lambda value: jnp.full(len(self.middle), value)
        cosine = jnp.cos(jnp.radians(jnp.asarray(self.middle)))
        flow = every(self.reynolds), every(prandtl(film))
        return np.asarray(local_nusselt(cosine, *flow, churchill_bernstein))


def measure_cooling(folder: Path) -> dict[str, Any]:
    """C21, the three averages and a fixed h on one cylinder."""
    case = _Cooling()
    local, at = case.local_numbers(), _SAVED.index(_COMPARED)
    wind = lambda name: jt.Wind((_SPEED, 0.0, 0.0), AIR, average=name)
    runs = {a.name: case.run(wind(a.name)) for a in AVERAGES}
    name = AVERAGES[0].name
    # The same heat at first, spread evenly.
    first, h = runs[name], _mean_coefficient(case, wind(name))
    runs[f"fixed h = {h:.1f} W/m²K"] = case.run(jt.Convection(h, AIR))
    sectors = case.by_sector(first)
    write_png(folder / "cooling.png", _frames(first))
    choices = []
    for name, solution in runs.items():
        side = case.by_sector(solution)[at]
        row = {"name": name, "mean_K": float(solution.mean_temperature[at, 0])}
        row |= {"side_lowest_K": float(side.min()), "side_highest_K": float(side.max())}
        choices.append({**row, "side_range_K": float(np.ptp(side))})
    rank = lambda values: np.argsort(np.argsort(values))
    correlation = lambda a, b: float(np.corrcoef(a, b)[0, 1])
    return {
        "speed_m_s": _SPEED,
        "diameter_m": _DIAMETER,
        "Re": case.reynolds,
        "times_s": list(_SAVED),
        "sector_middle_deg": case.middle.tolist(),
        "temperature_K": sectors.tolist(),
        "local_number": local.tolist(),
        "correlation_of_temperature_and_number": correlation(sectors[2], local),
        "rank_correlation": correlation(rank(sectors[2]), rank(local)),
        "choices": choices,
        "compared_at_s": _COMPARED,
    }


def _mean_coefficient(case: _Cooling, wind: jt.Wind) -> float:
    # The h that takes from the whole surface what the wind takes at first. float64,
    # since in a millisecond the body loses next to nothing.
    short = jt.simulate(case.scene(wind, "float64"), 1e-3)
    lost = -float(short.energy.mechanisms["wind"][0]) / 1e-3
    return lost / (case.grid.fragment_area.sum() * (HOT - AIR))


def _frames(solution: jt.Solution) -> Image.Image:
    # From the front and a little above, with the wind from the left as in figure 5.8.
    camera = jt.OrthographicCamera(
        (-0.06, -0.3, 0.16), (0.0, 0.0, 0.0), view_height=0.105, width=340, height=250
    )
    shots = []
    for index in range(1, len(_SAVED)):
        image = jt.render(solution, camera, index, samples=2)
        # Each on its own scale: within a frame the body differs by a few kelvin.
        kelvin = np.asarray(solution.surface_temperature[index], float)
        low, high = np.quantile(kelvin, (0.002, 0.998))
        shots.append(picture(image, float(low), float(high), quantity="surface"))
    return contact_sheet(shots, 2)


def cooling_chart(found: dict[str, Any]) -> Chart:
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
    title = "C21: a cylinder that cools in the wind, by angle"
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
    title = f"A cylinder after {found['compared_at_s']:g} s at Re {found['Re']:.3g}"
    return table_of(found["choices"], columns, title)
