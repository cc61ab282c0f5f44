"""Steady bodies: thermal bridges of ISO 10211 (V21a, b, d), V15 a shell, V16 a fin."""

from typing import NamedTuple

import numpy as np

from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.geometry.shapes import box, cylinder
from jaxthermo.physics.boundary import Convection, FixedTemperature
from jaxthermo.scene.scene import Body, MaterialLabels
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.selection import FragmentMask, Side
from jaxthermo.voxels.voxelize import voxelize

from ..harness.case import Case, Order, Row, Value, largest_error, result, values
from .bodies import LEFT, hollow_hemisphere, layered, of_blocks
from .walls import solid, solve


UP, DOWN = Side(normal=(0.0, 0.0, 1.0)), Side(normal=(0.0, 0.0, -1.0))

COLUMN = (
    (9.6582, 13.3791, 14.7289, 15.0854),
    (5.2517, 8.6406, 10.3155, 10.8106),
    (3.1887, 5.609, 7.0142, 7.4651),
    (2.0142, 3.6406, 4.6582, 5.0),
    (1.2625, 2.3086, 2.9858, 3.2185),
    (0.7396, 1.3594, 1.7668, 1.9083),
    (0.3418, 0.6296, 0.8199, 0.8863),
)
"""Temperatures of case 1, from the top down [degC]."""

ROOF = (230.0, 0.12, 1.15, 0.029)
"""Aluminium, wood, concrete, insulation [W/(m K)]."""
ROOF_PITCH = 0.5e-3
"""[m]"""
ROOF_HEIGHT = 47.5
"""[mm]"""
ROOF_POINTS = {
    "A": (0.0, 47.5, 7.1), "B": (500.0, 47.5, 0.8), "C": (0.0, 41.5, 7.9),
    "D": (15.0, 41.5, 6.3), "E": (500.0, 41.5, 0.8), "F": (0.0, 36.5, 16.4),
    "G": (15.0, 36.5, 16.3), "H": (0.0, 0.0, 16.8), "I": (500.0, 0.0, 18.3),
}  # fmt: skip
"""x and height [mm], temperature [degC] of the standard."""
ROOF_FLOW = 9.5
"""[W/m]"""

BAR_FLOW, BAR_HOTTEST = 0.54, 0.805
"""Heat flow [W] and hottest temperature outside [degC] of case 4."""


def _measure_column() -> Row:
    """V21a with 2, 4 and 8 cells in an eighth of the side."""
    found, sizes = [], (2, 4, 8)
    names = tuple(f"row {i + 1}, column {j + 1}" for i in range(7) for j in range(4))
    expected = tuple(kelvin for row in COLUMN for kelvin in row)
    for cells in sizes:
        found.append(values(names, "degC", expected, column(cells), 0.1))
    errors = tuple(map(largest_error, found))
    return result(found[-1], Order(tuple(1 / n for n in sizes), errors))


def column(cells: int) -> list[float]:
    """Half of a square of 1 m: 20 degC above, 0 left and below, symmetry right."""
    pitch = 1 / (8 * cells)
    grid = voxelize(box((0.5, pitch, 1.0)), pitch)
    body = Body(FullVolume(grid), solid(1.0), temperature=ZERO_CELSIUS)
    terms = (
        FixedTemperature(ZERO_CELSIUS + 20.0, on=UP),
        FixedTemperature(ZERO_CELSIUS, on=LEFT),
        FixedTemperature(ZERO_CELSIUS, on=DOWN),
    )
    surface = np.asarray(solve((body,), terms).surface_temperature)[0]
    nodes = layered(surface, grid) - ZERO_CELSIUS
    nodes = np.concatenate([nodes, nodes[::-1]])
    # The points are corners of four cells.
    corner = (nodes[:-1, :-1] + nodes[1:, :-1] + nodes[:-1, 1:] + nodes[1:, 1:]) / 4
    at = cells * np.arange(1, 8) - 1
    return corner[np.ix_(at[:4], at[::-1])].T.ravel().tolist()


def _roof_labels(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Which of `ROOF` is at each place [mm]."""
    found = np.full(np.broadcast(x, y).shape, 3)
    found[(y < 1.5) | ((x < 1.5) & (y < 36.5)) | ((x < 15) & (y > 35) & (y < 36.5))] = 0
    found[(x < 15) & (y > 36.5) & (y < 41.5)] = 1
    found[np.broadcast_to(y > 41.5, found.shape)] = 2
    return found


class _Roof(NamedTuple):
    """A steady section of the roof, one voxel deep."""

    nodes: np.ndarray
    """[x y], [degC]"""
    conductivity: np.ndarray
    """[x y]"""
    faces: dict[float, np.ndarray]
    """Temperature of the surface by x, at the heights of the two faces [degC]."""
    heat_rate: float
    """From the inside, through one voxel of depth [W]."""

    def at(self, x: float, y: float) -> float:
        """A point [mm]: of the surface its own, inside of the cells that meet there.

        A corner of several materials has about the mean by their conductivities.
        """
        wide, _ = self.nodes.shape
        i, j = (round(1e-3 * p / ROOF_PITCH) + np.array([-1, 0]) for p in (x, y))
        i = np.clip(i, 0, wide - 1)
        if y in self.faces:
            return float(self.faces[y][i].mean())
        near = np.ix_(i, j)
        return float(np.average(self.nodes[near], weights=self.conductivity[near]))


def _roof() -> _Roof:
    grid = voxelize(box((0.5, ROOF_PITCH, 1e-3 * ROOF_HEIGHT)), ROOF_PITCH)
    wide, _, high = grid.lattice.shape
    x, y = (1e3 * ROOF_PITCH * (np.arange(n) + 0.5) for n in (wide, high))
    labels = _roof_labels(x[:, None], y[None])
    materials = MaterialLabels(labels[:, None], tuple(map(solid, ROOF)))
    body = Body(FullVolume(grid), materials, temperature=ZERO_CELSIUS + 10.0)
    inside = Convection(1 / 0.11, ZERO_CELSIUS + 20.0, on=DOWN)
    outside = Convection(1 / 0.06, ZERO_CELSIUS, on=UP)
    solution = solve((body,), (inside, outside))
    surface = np.asarray(solution.surface_temperature)[0] - ZERO_CELSIUS
    along = np.argsort(grid.fragment_position[:, 0])
    up = grid.fragment_normal[along, 2]
    faces = {
        0.0: surface[along[up < -0.9]],
        ROOF_HEIGHT: surface[along[up > 0.9]],
    }
    heat_rate = float(solution.heat_rates.mechanisms["convection"])
    return _Roof(layered(surface, grid), np.array(ROOF)[labels], faces, heat_rate)


def _measure_roof() -> Row:
    """V21b: layers of 1.5 to 35 mm on voxels of 0.5 mm."""
    roof = _roof()
    points = [
        Value(f"T at {name}", "degC", celsius, roof.at(x, y), 0.1)
        for name, (x, y, celsius) in ROOF_POINTS.items()
    ]
    flow = roof.heat_rate / ROOF_PITCH
    return result((Value("heat flow", "W/m", ROOF_FLOW, flow, 0.1), *points))


def _iron_bar(pitch: float) -> tuple[float, float]:
    """Heat flow [W] and hottest place outside [degC], of a quarter of case 4.

    The bar ends flush with the wall outside, z = 0, and stands out 0.4 m inside.
    """
    blocks = np.ones((2, 2, 2), bool)
    blocks[1, :, 1] = blocks[:, 1, 1] = False
    planes = np.array([0.0, 0.05, 0.5]), np.array([0.0, 0.025, 0.5])
    grid = voxelize(of_blocks(blocks, *planes, np.array([0.0, 0.2, 0.6])), pitch)
    x, y, _ = (pitch * (np.arange(n) + 0.5) for n in grid.lattice.shape)
    iron = (x[:, None] < 0.05) & (y[None] < 0.025)
    labels = np.broadcast_to(iron[..., None], grid.lattice.shape).astype(int)
    materials = MaterialLabels(labels, (solid(0.1), solid(50.0)))
    body = Body(FullVolume(grid), materials, temperature=ZERO_CELSIUS + 0.5)
    place, normal = grid.fragment_position, grid.fragment_normal
    warm = normal[:, 2] > 0.9
    for axis, side in ((0, 0.05), (1, 0.025)):
        # Not the far edges of the wall, which are adiabatic.
        warm |= (normal[:, axis] > 0.9) & (place[:, axis] < 2 * side)
    inside = Convection(10.0, ZERO_CELSIUS + 1.0, on=FragmentMask(warm))
    outside = Convection(10.0, ZERO_CELSIUS, on=DOWN)
    solution = solve((body,), (inside, outside))
    heat = 4 * float(solution.heat_rates.mechanisms["convection"])
    cold = np.asarray(solution.surface_temperature)[0, normal[:, 2] < -0.9]
    return heat, float(cold.max()) - ZERO_CELSIUS


def _measure_iron_bar() -> Row:
    """V21d on voxels of 12.5, 8.3 and 6.25 mm."""
    found, sizes = [], (0.025 / 2, 0.025 / 3, 0.025 / 4)
    for pitch in sizes:
        heat, hottest = _iron_bar(pitch)
        found.append(
            (
                Value("heat flow", "W", BAR_FLOW, heat, 0.01 * BAR_FLOW),
                Value("hottest place outside", "degC", BAR_HOTTEST, hottest, 0.005),
            )
        )
    errors = tuple(max(abs(v.error) / v.expected for v in row) for row in found)
    return result(found[-1], Order(sizes, errors))


INNER, OUTER = 0.05, 0.1
"""Radii of the shell [m]."""
HOT, COLD = ZERO_CELSIUS + 100.0, ZERO_CELSIUS + 20.0
SHELL_HEAT, SHELL_MIDDLE = 50.26548246, 46.66666667
"""[W], [degC]"""

RADIUS, LENGTH = 0.0025, 0.05
"""Radius and length of the fin [m]."""
FIN_COEFFICIENT, EXCESS = 100.0, 75.0
FIN_HEAT, FIN_EFFICIENCY, FIN_TIP = 4.37775788, 0.74319126, 46.61455996
AIR = 300.0


def shell(cells: int) -> tuple[float, float]:
    """Heat through the whole shell [W], and the temperature half-way [degC]."""
    pitch = OUTER / cells
    grid = voxelize(hollow_hemisphere(INNER, OUTER), pitch)
    round_ = np.abs(grid.fragment_normal[:, 2] + 1.0) > 1e-6
    radius = np.linalg.norm(grid.fragment_position, axis=1)
    inside = radius < (INNER + OUTER) / 2
    body = Body(FullVolume(grid), solid(0.5), temperature=COLD)
    terms = (
        FixedTemperature(HOT, on=FragmentMask(round_ & inside)),
        FixedTemperature(COLD, on=FragmentMask(round_ & ~inside)),
    )
    solution = solve((body,), terms)
    # The flat side shows its nodes, which lie half a voxel above it.
    flat = np.flatnonzero(~round_)
    at = np.linalg.norm(grid.lattice.centres(grid.fragment_voxel[flat]), axis=1)
    kelvin = np.asarray(solution.surface_temperature)[0, flat]
    near = np.abs(at - 0.075) < 0.01
    fit = np.polyfit(1 / at[near] - 1 / 0.075, kelvin[near], 1)
    heat = 2 * float(solution.heat_rates.mechanisms["fixed_temperature"])
    return heat, float(fit[-1]) - ZERO_CELSIUS


def _measure_shell() -> Row:
    """V15 at 10, 20 and 40 voxels per outer radius, half as many per inner one."""
    found, sizes = [], (10, 20, 40)
    for cells in sizes:
        heat, middle = shell(cells)
        found.append(
            (
                Value("heat rate", "W", SHELL_HEAT, heat, 0.02 * SHELL_HEAT),
                Value("T(75 mm)", "degC", SHELL_MIDDLE, middle, 0.02 * SHELL_MIDDLE),
            )
        )
    errors = tuple(max(abs(v.error) / v.expected for v in row) for row in found)
    return result(found[-1], Order(tuple(1 / n for n in sizes), errors))


def fin(cells: int) -> tuple[float, float]:
    """Heat from the base [W] and the tip's excess [K]."""
    grid = voxelize(cylinder(RADIUS, LENGTH, sections=256), RADIUS / cells)
    along = grid.fragment_normal[:, 2]
    body = Body(FullVolume(grid), solid(180.0), temperature=AIR)
    terms = (
        FixedTemperature(AIR + EXCESS, on=Side(normal=(0.0, 0.0, -1.0))),
        Convection(FIN_COEFFICIENT, AIR, on=FragmentMask(np.abs(along) < 0.5)),
    )
    solution = solve((body,), terms)
    tip = np.asarray(solution.surface_temperature)[0, along > 0.9].mean()
    heat = float(solution.heat_rates.mechanisms["fixed_temperature"])
    return heat, float(tip) - AIR


def _measure_fin() -> Row:
    """V16: its voxels' section comes and goes with the pitch, so one pitch is shown."""
    heat, tip = fin(16)
    max_heat = FIN_COEFFICIENT * 2 * np.pi * RADIUS * LENGTH * EXCESS
    found = (
        ("heat rate", "W", FIN_HEAT, heat),
        ("efficiency", "", FIN_EFFICIENCY, float(heat / max_heat)),
        ("tip above the air", "K", FIN_TIP, tip),
    )
    return result(
        tuple(Value(name, unit, e, now, 0.01 * e) for name, unit, e, now in found)
    )


CASES = (
    Case(
        "V21a",
        "ISO 10211 case 1: half a square column",
        "ISO 10211, annex A; a Fourier series",
        "0.1 K",
        "32 x 64 voxels; steady; places are eighths of the side, from top and left",
        _measure_column,
    ),
    Case(
        "V21b",
        "ISO 10211 case 2: a roof with an aluminium web",
        "ISO 10211, annex A (finite volumes of 0.1 mm: 9.4900 W/m)",
        "0.1 K and 0.1 W/m",
        "1000 x 95 voxels of 0.5 mm; steady",
        _measure_roof,
    ),
    Case(
        "V21d",
        "ISO 10211 case 4: an iron bar through insulation",
        "ISO 10211, annex A (finite volumes of 5 mm: 0.53775 W, 0.8080 degC)",
        "1 % and 0.005 K",
        "a quarter, 207 000 voxels of 6.25 mm; steady",
        _measure_iron_bar,
    ),
    Case(
        "V15",
        "spherical shell between two temperatures",
        "Incropera 3.41",
        "2 % at 20 cells per radius",
        "upper half, 20 voxels per inner radius, 40 per outer (20 per outer are just "
        "too few: see the errors); steady",
        _measure_shell,
    ),
    Case(
        "V16",
        "pin fin with an adiabatic tip",
        "Incropera, table 3.4",
        "1 %",
        "cylinder of 16 voxels per radius, 320 long; steady",
        _measure_fin,
    ),
)
