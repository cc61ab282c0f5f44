"""Steady bodies: thermal bridges of ISO 10211 (V21a, b, d), V15 a shell, V16 a fin."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

import jaxthermo as jt
from jaxthermo.constants import ZERO_CELSIUS

from ..harness.case import Check, Row, case, converge, near, values
from ..harness.scenes import single
from .bodies import DOWN, LEFT, UP, conductor, hollow_hemisphere, layered, of_blocks


# Temperatures of case 1, from the top down [degC].
_COLUMN = (
    (9.6582, 13.3791, 14.7289, 15.0854),
    (5.2517, 8.6406, 10.3155, 10.8106),
    (3.1887, 5.609, 7.0142, 7.4651),
    (2.0142, 3.6406, 4.6582, 5.0),
    (1.2625, 2.3086, 2.9858, 3.2185),
    (0.7396, 1.3594, 1.7668, 1.9083),
    (0.3418, 0.6296, 0.8199, 0.8863),
)


def _column_points(cells: int) -> list[float]:
    """Half of a square of 1 m: 20 degC above, 0 left and below, symmetry right."""
    pitch = 1 / (8 * cells)
    grid = jt.voxelize(jt.shapes.box((0.5, pitch, 1.0)), pitch)
    kelvin = (ZERO_CELSIUS + 20.0, ZERO_CELSIUS, ZERO_CELSIUS)
    terms = map(jt.FixedTemperature, kelvin, (UP, LEFT, DOWN))
    solution = jt.steady(single(grid, conductor(1.0), ZERO_CELSIUS, *terms))
    surface = np.asarray(solution.surface_temperature)[0]
    nodes = layered(surface, grid, axis=1) - ZERO_CELSIUS
    nodes = np.concatenate([nodes, nodes[::-1]])
    # The points are corners of four cells.
    across = nodes[:-1] + nodes[1:]
    corner = (across[:, :-1] + across[:, 1:]) / 4
    eighths = cells * np.arange(1, 8) - 1
    points = corner[np.ix_(eighths[:4], eighths[::-1])]
    return points.T.ravel().tolist()


@case(
    "V21a",
    title="ISO 10211 case 1: half a square column",
    source="ISO 10211, annex A; a Fourier series",
    requirement="0.1 K",
    method="32 x 64 voxels; steady; places are eighths of the side, from top and left",
)
def _column() -> Row:
    expected = {
        f"row {i}, column {j}": celsius
        for i, row in enumerate(_COLUMN, 1)
        for j, celsius in enumerate(row, 1)
    }

    def at(cells: int) -> tuple[Check, ...]:
        return values(
            expected=expected,
            computed=_column_points(cells),
            unit="degC",
            tolerance=0.1,
        )

    # Cells in an eighth of the side. The corners, where 20 and 0 degC meet, spoil the
    # order: none is expected.
    return converge(at, (2, 4, 8), 1)


# Aluminium, wood, concrete, insulation [W/(m K)].
_ROOF = (230.0, 0.12, 1.15, 0.029)
# Layers are 1.5 to 35 mm thick: the pitch [m] divides them all.
_ROOF_PITCH = 0.5e-3
# Height of the roof [mm].
_ROOF_HEIGHT = 47.5
# x and height [mm], temperature [degC] of the standard.
_ROOF_POINTS = {
    "A": (0.0, 47.5, 7.1),
    "B": (500.0, 47.5, 0.8),
    "C": (0.0, 41.5, 7.9),
    "D": (15.0, 41.5, 6.3),
    "E": (500.0, 41.5, 0.8),
    "F": (0.0, 36.5, 16.4),
    "G": (15.0, 36.5, 16.3),
    "H": (0.0, 0.0, 16.8),
    "I": (500.0, 0.0, 18.3),
}


def _roof_labels(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Index in `_ROOF` of the material at each position [mm]."""
    label = np.full(np.broadcast(x, y).shape, 3)
    is_base = y < 1.5
    is_web = (x < 1.5) & (y < 36.5)
    is_flange = (x < 15) & (y > 35) & (y < 36.5)
    label[is_base | is_web | is_flange] = 0
    label[(x < 15) & (y > 36.5) & (y < 41.5)] = 1
    label[np.broadcast_to(y > 41.5, label.shape)] = 2
    return label


@case(
    "V21b",
    title="ISO 10211 case 2: a roof with an aluminium web",
    source="ISO 10211, annex A (finite volumes of 0.1 mm: 9.4900 W/m)",
    requirement="0.1 K and 0.1 W/m",
    method="1000 x 95 voxels of 0.5 mm; steady",
)
def _roof() -> Iterator[Check]:
    size = (0.5, _ROOF_PITCH, 1e-3 * _ROOF_HEIGHT)
    grid = jt.voxelize(jt.shapes.box(size), _ROOF_PITCH)
    wide, _, high = grid.lattice.shape
    millimetres = 1e3 * _ROOF_PITCH
    x = millimetres * (np.arange(wide) + 0.5)
    y = millimetres * (np.arange(high) + 0.5)
    labels = _roof_labels(x[:, None], y[None])
    materials = jt.MaterialLabels(labels[:, None], tuple(map(conductor, _ROOF)))
    # The standard's surface resistances [m^2 K/W].
    inside = jt.Convection(1 / 0.11, ZERO_CELSIUS + 20.0, on=DOWN)
    outside = jt.Convection(1 / 0.06, ZERO_CELSIUS, on=UP)
    scene = single(grid, materials, ZERO_CELSIUS + 10.0, inside, outside)
    solution = jt.steady(scene)
    surface = np.asarray(solution.surface_temperature)[0] - ZERO_CELSIUS
    nodes = layered(surface, grid, axis=1)
    conductivity = np.array(_ROOF)[labels]
    along = np.argsort(grid.fragment_position[:, 0])
    up = grid.fragment_normal[along, 2]
    below = along[up < -0.9]
    above = along[up > 0.9]
    faces = {0.0: surface[below], _ROOF_HEIGHT: surface[above]}
    # Through one voxel of depth.
    heat = float(solution.heat_rates.mechanisms["convection"])
    yield near("heat flow", heat / _ROOF_PITCH, 9.5, unit="W/m", tolerance=0.1)
    for name, (x, y, celsius) in _ROOF_POINTS.items():
        # The two cells on either side of the point.
        i = round(1e-3 * x / _ROOF_PITCH) + np.array([-1, 0])
        j = round(1e-3 * y / _ROOF_PITCH) + np.array([-1, 0])
        i = np.clip(i, 0, wide - 1)
        if y in faces:
            temperature = faces[y][i].mean()
        else:
            # A corner of several materials has about the mean by conductivities.
            around = np.ix_(i, j)
            weights = conductivity[around]
            temperature = np.average(nodes[around], weights=weights)
        yield near(f"T at {name}", temperature, celsius, unit="degC", tolerance=0.1)


def _largest_fraction(checks: Sequence[Check]) -> float:
    # Relative to the expected value: a heat and a temperature in one order.
    return max(abs(check.error) / (check.expected or math.nan) for check in checks)


def _iron_bar(pitch: float) -> Iterator[Check]:
    """Heat flow of case 4 and its hottest place outside, by a quarter of it."""
    # The bar ends flush with the wall outside, z = 0, and stands out 0.4 m inside.
    blocks = np.ones((2, 2, 2), bool)
    blocks[1, :, 1] = blocks[:, 1, 1] = False
    mesh = of_blocks(
        blocks,
        np.array([0.0, 0.05, 0.5]),
        np.array([0.0, 0.025, 0.5]),
        np.array([0.0, 0.2, 0.6]),
    )
    grid = jt.voxelize(mesh, pitch)
    wide, deep, _ = grid.lattice.shape
    x = pitch * (np.arange(wide) + 0.5)
    y = pitch * (np.arange(deep) + 0.5)
    iron = (x[:, None] < 0.05) & (y[None] < 0.025)
    labels = np.broadcast_to(iron[..., None], grid.lattice.shape).astype(int)
    materials = jt.MaterialLabels(labels, (conductor(0.1), conductor(50.0)))
    position = grid.fragment_position
    normal = grid.fragment_normal
    warm = normal[:, 2] > 0.9
    for axis, side in ((0, 0.05), (1, 0.025)):
        # Not the far edges of the wall, which are adiabatic.
        warm |= (normal[:, axis] > 0.9) & (position[:, axis] < 2 * side)
    inside = jt.Convection(10.0, ZERO_CELSIUS + 1.0, on=jt.FragmentMask(warm))
    outside = jt.Convection(10.0, ZERO_CELSIUS, on=DOWN)
    solution = jt.steady(single(grid, materials, ZERO_CELSIUS + 0.5, inside, outside))
    # Four quarters.
    heat = 4 * float(solution.heat_rates.mechanisms["convection"])
    cold = np.asarray(solution.surface_temperature)[0, normal[:, 2] < -0.9]
    hottest = float(cold.max()) - ZERO_CELSIUS
    yield near("heat flow", heat, 0.54, unit="W", fraction=0.01)
    yield near("hottest place outside", hottest, 0.805, unit="degC", tolerance=0.005)


@case(
    "V21d",
    title="ISO 10211 case 4: an iron bar through insulation",
    source="ISO 10211, annex A (finite volumes of 5 mm: 0.53775 W, 0.8080 degC)",
    requirement="1 % and 0.005 K",
    method="a quarter, 207 000 voxels of 6.25 mm; steady",
)
def _iron_bar_case() -> Row:
    # 12.5, 8.3 and 6.25 mm: whole voxels in the bar's half widths of 25 and 50 mm.
    pitches = (0.025 / 2, 0.025 / 3, 0.025 / 4)
    return converge(_iron_bar, pitches, error=_largest_fraction)


# Radii of the shell [m].
_INNER = 0.05
_OUTER = 0.1
_HOT = ZERO_CELSIUS + 100.0
_COLD = ZERO_CELSIUS + 20.0


def _shell(cells: int) -> Iterator[Check]:
    """Heat through the whole shell, and the temperature half-way."""
    grid = jt.voxelize(hollow_hemisphere(_INNER, _OUTER), _OUTER / cells)
    round_ = np.abs(grid.fragment_normal[:, 2] + 1.0) > 1e-6
    radius = np.linalg.norm(grid.fragment_position, axis=1)
    inside = radius < (_INNER + _OUTER) / 2
    hot = jt.FixedTemperature(_HOT, on=jt.FragmentMask(round_ & inside))
    cold = jt.FixedTemperature(_COLD, on=jt.FragmentMask(round_ & ~inside))
    solution = jt.steady(single(grid, conductor(0.5), _COLD, hot, cold))
    # The flat side shows its nodes, which lie half a voxel above it.
    flat = np.flatnonzero(~round_)
    node_radius = np.linalg.norm(
        grid.lattice.centres(grid.fragment_voxel[flat]), axis=1
    )
    kelvin = np.asarray(solution.surface_temperature)[0, flat]
    is_halfway = np.abs(node_radius - 0.075) < 0.01
    # Temperatures of a shell are linear in 1 / r.
    off_halfway = 1 / node_radius[is_halfway] - 1 / 0.075
    fit = np.polyfit(off_halfway, kelvin[is_halfway], 1)
    # Twice the heat of the upper half.
    heat = 2 * float(solution.heat_rates.mechanisms["fixed_temperature"])
    middle = float(fit[-1]) - ZERO_CELSIUS
    yield near("heat rate", heat, 50.26548246, unit="W", fraction=0.02)
    yield near("T(75 mm)", middle, 46.66666667, unit="degC", fraction=0.02)


@case(
    "V15",
    title="spherical shell between two temperatures",
    source="Incropera 3.41",
    requirement="2 % at 20 cells per radius",
    method="upper half, 20 voxels per inner radius, 40 per outer (20 per outer are "
    "just too few: see the errors); steady",
)
def _shell_case() -> Row:
    return converge(measure=_shell, at=(10, 20, 40), length=1, error=_largest_fraction)


# Radius and length of the fin [m].
_RADIUS = 0.0025
_LENGTH = 0.05
# Heat transfer coefficient of the fin [W/(m^2 K)].
_FIN_H = 100.0
# Air, and excess of the fin's base over it [K].
_AIR = 300.0
_EXCESS = 75.0


@case(
    "V16",
    title="pin fin with an adiabatic tip",
    source="Incropera, table 3.4",
    requirement="1 %",
    method="cylinder of 16 voxels per radius, 320 long; steady",
)
def _fin() -> Iterator[Check]:
    # Its voxels' section comes and goes with the pitch, so one pitch is shown.
    mesh = jt.shapes.cylinder(_RADIUS, _LENGTH, sections=256)
    grid = jt.voxelize(mesh, _RADIUS / 16)
    along = grid.fragment_normal[:, 2]
    base = jt.FixedTemperature(_AIR + _EXCESS, on=DOWN)
    sides = jt.FragmentMask(np.abs(along) < 0.5)
    air = jt.Convection(_FIN_H, _AIR, on=sides)
    solution = jt.steady(single(grid, conductor(180.0), _AIR, base, air))
    tip = np.asarray(solution.surface_temperature)[0, along > 0.9].mean()
    heat = float(solution.heat_rates.mechanisms["fixed_temperature"])
    # The heat of the same surface if all of it had the temperature of the base.
    max_heat = _FIN_H * 2 * np.pi * _RADIUS * _LENGTH * _EXCESS
    yield near("heat rate", heat, 4.37775788, unit="W", fraction=0.01)
    yield near("efficiency", heat / max_heat, 0.74319126, fraction=0.01)
    yield near("tip above the air", tip - _AIR, 46.61455996, unit="K", fraction=0.01)


CASES = (_column, _roof, _iron_bar_case, _shell_case, _fin)
