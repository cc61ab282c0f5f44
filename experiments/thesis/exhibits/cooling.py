"""5.4: bodies in wind cool by the direction of their normals."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import altair as alt
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from PIL import Image
from scipy.stats import rankdata

import jaxthermo as jt
from jaxthermo.choices import CylinderAverage, Dtype
from jaxthermo.geometry.shapes import cylinder
from jaxthermo.image.surface.camera import frame_all
from jaxthermo.physics.convection.air import kinematic_viscosity, prandtl
from jaxthermo.physics.convection.nusselt import churchill_bernstein
from jaxthermo.report.chart import Chart
from jaxthermo.voxels.cylinders import cylinder_parts

from ...harness.line_chart import SHADES, angle_axis, curve, curve_chart
from ...harness.present import Shot, thermal_sheet
from ..bodies import buddha
from ..exhibit import Finding, Numbers, exhibit, judged
from ..nusselt import local_number


_DIAMETER = 0.1
_LENGTH = 0.05
# m/s and K: on the cylinder a Re of 3e4, where the three averages differ by a fifth.
_SPEED = 5.0
_AIR = 300.0
_HOT = 340.0
# Averages that are compared, that of most runs first.
_AVERAGES: tuple[CylinderAverage, ...] = (
    "churchill_bernstein",
    "sanitjai_goldstein",
    "profile",
)
# A poor conductor: in a good one the sides would even out and hide the local number.
_CERAMIC = jt.Material(conductivity=2.0, density=1800.0, specific_heat=900.0)
# Saved times, and when the choices are compared [s].
_SAVED = (0.0, 60.0, 180.0, 600.0, 1200.0)
_COMPARED = 600.0
# Width of a sector, and the middles of all [degrees].
_SECTOR = 10
_MIDDLE = (np.arange(180 // _SECTOR) + 0.5) * _SECTOR
# Correlation of ranks from which temperatures are in the order of the local number.
_ORDERED = -0.9


@exhibit("figure-5.8", "5.4, figure 5.8")
def _cooling_by_normal(quick: bool) -> Finding:
    """Cool a cylinder and the statue in wind."""
    height = 60 if quick else 160
    across = 24 if quick else 48
    statue = _InWind(buddha().name, buddha().grid(height))
    cases = {"cylinder": cylinder_in_wind(across), "statue": statue}
    runs = {word: case.run(_wind()) for word, case in cases.items()}
    numbers: dict[str, Numbers] = {}
    weakest = {}
    pictures: dict[str, Image.Image | Chart] = {}
    for word, case in cases.items():
        solution = runs[word]
        order = _side_order(case, solution)
        weakest[word] = max(row["rank_correlation"] for row in order)
        sectors = case.by_sector(solution.surface_temperature)
        local = case.local_numbers()
        numbers[case.name] = numbers[word] = {
            "speed_m_s": _SPEED,
            "Re": case.reynolds,
            "times_s": _SAVED,
            "sector_middle_deg": _MIDDLE,
            "temperature_K": sectors,
            "local_number": local,
            "largest_number_deg": _MIDDLE[local.argmax()],
            "smallest_number_deg": _MIDDLE[local.argmin()],
            "order": order,
        }
        pictures[f"figure-5.8-{word}"] = _cooling_sheet(case, solution)
        pictures[f"figure-5.8-{word}-angle"] = _cooling_chart(sectors, case.name)
    choices = _compare_choices(cases["cylinder"], runs["cylinder"])
    by_wind, *_, by_fixed = (row["side_range_K"] for row in choices.values())
    on_cylinder = weakest["cylinder"]
    order = numbers["cylinder"]["order"]
    return Finding(
        judged(
            on_cylinder <= _ORDERED and by_fixed < 0.1 * by_wind,
            different=on_cylinder <= 0,
        ),
        {
            **numbers,
            "mesh": statue.name,
            "sizes": [across, height],
            "weakest_on_cylinder": on_cylinder,
            "weakest_on_statue": weakest["statue"],
            "peak": max(order, key=lambda row: row["range_K"]),
            "choices": [{"name": name, **row} for name, row in choices.items()],
            "ranges_K": [by_fixed, by_wind],
        },
        pictures,
    )


@dataclass(frozen=True, eq=False)
class _InWind:
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
        cosine = -flat[:, 0] / np.linalg.norm(flat, axis=1)
        degrees = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        return np.minimum((degrees / _SECTOR).astype(int), 180 // _SECTOR - 1)

    @cached_property
    def reynolds(self) -> float:
        """Reynolds number of the widest of the cylinders that stand for the body."""
        widest = max(float(c.diameter) for c in cylinder_parts(self.grid).cylinders)
        return _SPEED * widest / float(kinematic_viscosity(jnp.asarray(_AIR)))

    def scene(self, term: Any, dtype: Dtype = "float32") -> jt.Scene:
        """Scene with one term."""
        body = jt.Body(jt.FullVolume(self.grid), _CERAMIC, temperature=_HOT)
        return jt.Scene((body,), (term,), dtype=dtype)

    def run(self, term: Any) -> jt.Solution:
        """Run of all saved times."""
        return jt.simulate(self.scene(term), _SAVED[-1], save_at=_SAVED)

    def by_sector(self, surface: Float[Any, "t s"]) -> Float[np.ndarray, "t a"]:
        """Means of the side's temperatures at several times by its sectors [K]."""
        area = self.grid.fragment_area[self.side]
        sums = [
            np.bincount(self._sector, area * temperature)
            for temperature in np.asarray(surface, float)[:, self.side]
        ]
        return np.stack(sums) / np.bincount(self._sector, area)

    def local_numbers(self) -> Float[np.ndarray, " a"]:
        """Local Nusselt number at the middle of each sector, at the start."""
        film = jnp.asarray((_HOT + _AIR) / 2)
        return local_number(
            _MIDDLE, self.reynolds, float(prandtl(film)), churchill_bernstein
        )


def cylinder_in_wind(across: int) -> _InWind:
    """A cylinder of `across` voxels in diameter."""
    mesh = cylinder(_DIAMETER / 2, _LENGTH, 128)
    return _InWind("cylinder", jt.voxelize(mesh, _DIAMETER / across))


def _wind(average: CylinderAverage = _AVERAGES[0]) -> jt.Wind:
    return jt.Wind((_SPEED, 0.0, 0.0), _AIR, average=average)


def _side_order(case: _InWind, solution: jt.Solution) -> list[dict[str, float]]:
    """Correlation of the side's temperatures with the local number, at each time."""
    local = case.local_numbers()
    sectors = case.by_sector(solution.surface_temperature)
    rows = []
    # At the start the side is even.
    for index in range(1, len(_SAVED)):
        kelvin = sectors[index]
        ranks = np.stack([rankdata(kelvin), rankdata(local)])
        rows.append(
            {
                "time_s": _SAVED[index],
                "mean_K": float(solution.mean_temperature[index, 0]),
                "range_K": float(np.ptp(kelvin)),
                "correlation": float(np.corrcoef(kelvin, local)[0, 1]),
                "rank_correlation": float(np.corrcoef(ranks)[0, 1]),
                "coldest_deg": float(_MIDDLE[kelvin.argmin()]),
                "warmest_deg": float(_MIDDLE[kelvin.argmax()]),
            }
        )
    return rows


def _compare_choices(case: _InWind, first: jt.Solution) -> dict[str, dict[str, float]]:
    """Temperatures by the average of the wind, and by a fixed h."""
    # Of as much heat as the wind takes at first, spread evenly.
    h = _mean_coefficient(case)
    runs = {_AVERAGES[0]: first}
    runs |= {average: case.run(_wind(average)) for average in _AVERAGES[1:]}
    runs[f"fixed h = {h:.1f} W/m²K"] = case.run(jt.Convection(h, _AIR))
    time = _SAVED.index(_COMPARED)
    rows = {}
    for name, solution in runs.items():
        side = case.by_sector(solution.surface_temperature)[time]
        rows[name] = {
            "mean_K": float(solution.mean_temperature[time, 0]),
            "side_lowest_K": float(side.min()),
            "side_highest_K": float(side.max()),
            "side_range_K": float(np.ptp(side)),
        }
    return rows


def _mean_coefficient(case: _InWind) -> float:
    # float64, since in a millisecond the body loses next to nothing.
    short = jt.simulate(case.scene(_wind(), "float64"), 1e-3)
    power = -float(short.energy.mechanisms["wind"][0]) / 1e-3
    return power / (case.grid.fragment_area.sum() * (_HOT - _AIR))


def _cooling_sheet(case: _InWind, solution: jt.Solution) -> Image.Image:
    """A body at the saved times on one scale, the wind from the left.

    Each picture is of the surface less its mean at that time: the whole cools by more
    than its sides differ.
    """
    # What the wind meets first is on the left.
    camera = frame_all(case.grid.mesh.triangles, 230, 300, (0.5, 1.0, -0.45))
    shots = []
    for index in range(1, len(_SAVED)):
        image = jt.render(solution, camera, index)
        surface = np.asarray(solution.surface_temperature[index], float)
        mean = float(np.average(surface, weights=case.grid.fragment_area))
        body = np.asarray(image.object_id) >= 0
        excess = np.asarray(image.temperature) - mean
        name = f"{_SAVED[index]:g} s"
        shots.append(Shot(excess, body, name, f"surface mean {mean:.1f} K"))
    # Thin limbs are much colder than the rest.
    of_bodies = [shot.values[shot.body] for shot in shots]
    low = min(float(np.quantile(kelvin, 0.03)) for kelvin in of_bodies)
    high = max(float(np.quantile(kelvin, 0.995)) for kelvin in of_bodies)
    return thermal_sheet(
        shots,
        limits=(low, high),
        scale="surface temperature less its mean at that time [K]",
        title=f"{case.name}, wind of {_SPEED:g} m/s from left to right",
    )


def _cooling_chart(sectors: Float[np.ndarray, "t a"], name: str) -> Chart:
    """Temperature of the side less its mean by angle, at the saved times."""
    points = []
    # At the start the side is even.
    for time, kelvin in zip(_SAVED[1:], sectors[1:], strict=True):
        excess = kelvin - kelvin.mean()
        points += curve(f"{time:g} s", _MIDDLE, excess)
    return curve_chart(
        points=points,
        x=angle_axis(),
        y=alt.Y("y:Q", title="temperature less the side's mean [K]"),
        title=f"{name} by angle",
        colours=SHADES,
    )
