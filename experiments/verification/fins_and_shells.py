"""Steady round bodies: V15 a spherical shell, V16 a pin fin."""

import numpy as np

from jaxthermo.geometry.shapes import cylinder
from jaxthermo.physics.boundary import Convection, FixedTemperature
from jaxthermo.scene.scene import Body
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.selection import FragmentMask, Side
from jaxthermo.voxels.voxelize import voxelize

from .case import ZERO_CELSIUS, Case, Measured, Order, Value
from .meshes import hollow_hemisphere
from .walls import solid, solve


INNER, OUTER = 0.05, 0.1
"""Of the shell [m]."""
HOT, COLD = ZERO_CELSIUS + 100.0, ZERO_CELSIUS + 20.0
SHELL_HEAT, SHELL_MIDDLE = 50.26548246, 46.66666667
"""[W], [degC]"""

RADIUS, LENGTH = 0.0025, 0.05
"""Of the fin [m]."""
FIN_COEFFICIENT, EXCESS = 100.0, 75.0
FIN_HEAT, FIN_EFFICIENCY, FIN_TIP = 4.37775788, 0.74319126, 46.61455996
AIR = 300.0


def shell(cells: int) -> tuple[float, float]:
    """Heat through the whole shell [W], and the temperature half-way [degC].

    Args:
        cells: per outer radius.
    """
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


def measure_shell() -> Measured:
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
    return Measured(found[-1], Order(tuple(1 / n for n in sizes), errors))


def fin(cells: int) -> tuple[float, float]:
    """Heat from the base [W] and the tip's excess [K].

    Args:
        cells: per radius.
    """
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


def measure_fin() -> Measured:
    """V16: its voxels' section comes and goes with the pitch, so one pitch is shown."""
    heat, tip = fin(16)
    most = FIN_COEFFICIENT * 2 * np.pi * RADIUS * LENGTH * EXCESS
    found = (
        ("heat rate", "W", FIN_HEAT, heat),
        ("efficiency", "", FIN_EFFICIENCY, float(heat / most)),
        ("tip above the air", "K", FIN_TIP, tip),
    )
    return Measured(
        tuple(Value(name, unit, e, now, 0.01 * e) for name, unit, e, now in found)
    )


CASES = (
    Case(
        "V15",
        "spherical shell between two temperatures",
        "Incropera 3.41",
        "2 % at 20 cells per radius",
        "upper half, 20 voxels per inner radius, 40 per outer (20 per outer are just "
        "too few: see the errors); steady",
        measure_shell,
    ),
    Case(
        "V16",
        "pin fin with an adiabatic tip",
        "Incropera, table 3.4",
        "1 %",
        "cylinder of 16 voxels per radius, 320 long; steady",
        measure_fin,
    ),
)
