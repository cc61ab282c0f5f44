"""Bodies of two and three dimensions in a fluid: V05, V07; and of none: V14."""

import numpy as np

from jaxthermo.geometry.shapes import box, cylinder
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.solvers import TRBDF2, ForwardEuler
from jaxthermo.material.material import Material
from jaxthermo.physics.boundary import Convection
from jaxthermo.physics.radiation.emission import Surroundings
from jaxthermo.scene.scene import Body, Scene
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.selection import FragmentMask
from jaxthermo.voxels.voxelize import voxelize

from ..harness.case import Case, Order, Row, largest_error, result, values
from .bodies import bar


SIZE = 0.1
"""Radius, or half a side [m]."""
STUFF = Material(1.0, density=1000.0, specific_heat=1000.0)
AIR, HOT = 300.0, 400.0
COEFFICIENT = 10.0
"""Bi = h SIZE / k = 1 [W/(m^2 K)]."""
END = 2000.0
"""Fo = alpha t / SIZE^2 = 0.2 [s]."""
CYLINDER = (0.87017424, 0.7938029, 0.57022774, 0.71851626)
CUBE = (0.85911379, 0.26633271, 0.58144499)

ALUMINIUM = Material(1e9, density=2700.0, specific_heat=900.0, emissivity=0.9)
"""Without resistance inside."""
COOLING = {
    60.0: 934.667745,
    99.350085: 900.0,
    300.0: 778.764437,
    517.172931: 700.0,
    600.0: 677.388833,
    1800.0: 513.013603,
    1979.070819: 500.0,
    3600.0: 425.566551,
    4576.287399: 400.0,
}
"""Temperatures [K] at times [s], and times at temperatures, in one."""


def _cooled(grid, exposed):
    """Theta of the surface and of the whole body at the end."""
    body = Body(FullVolume(grid), STUFF, temperature=HOT)
    air = Convection(COEFFICIENT, AIR, on=FragmentMask(exposed))
    scene = Scene((body,), (air,), dtype="float64")
    solution = simulate(scene, END, solver=ForwardEuler())
    theta = lambda kelvin: (np.asarray(kelvin)[0] - AIR) / (HOT - AIR)
    surface, mean = solution.surface_temperature, solution.mean_temperature
    return theta(surface), float(theta(mean)[0])


def _measure_cylinder() -> Row:
    """V05 at 10, 20 and 40 voxels per radius."""
    found, sizes = [], (10, 20, 40)
    names = ("theta, axis", "theta, half-way", "theta, surface", "theta, mean")
    for cells in sizes:
        found.append(values(names, "", CYLINDER, _cylinder(cells), 5e-3))
    errors = tuple(map(largest_error, found))
    return result(found[-1], Order(tuple(1 / n for n in sizes), errors))


def _cylinder(cells: int) -> list[float]:
    """A slice one voxel thick between two ends that nothing passes through."""
    pitch = SIZE / cells
    grid = voxelize(cylinder(SIZE, pitch, sections=256), pitch)
    end = np.abs(grid.fragment_normal[:, 2]) > 0.9
    theta, mean = _cooled(grid, ~end)
    centre = grid.lattice.centres(grid.fragment_voxel)
    radius = np.hypot(centre[end, 0], centre[end, 1]) / SIZE
    near, around = radius < 0.3, np.abs(radius - 0.5) < 0.15
    axis = np.polyfit(radius[near] ** 2, theta[end][near], 2)[-1]
    half = np.polyfit(radius[around] - 0.5, theta[end][around], 3)[-1]
    outside = np.average(theta[~end], weights=grid.fragment_area[~end])
    return [float(axis), float(half), float(outside), mean]


def _measure_cube() -> Row:
    """V07 at 10, 20 and 40 voxels per half side."""
    found, sizes = [], (10, 20, 40)
    names = ("theta, centre", "theta, corner", "theta, middle of a face")
    for cells in sizes:
        found.append(values(names, "", CUBE, _cube(cells), 3e-3))
    errors = tuple(map(largest_error, found))
    return result(found[1], Order(tuple(1 / n for n in sizes), errors, expected=2.0))


def _cube(cells: int) -> list[float]:
    """An eighth of it: nothing passes through the three planes of symmetry."""
    pitch = SIZE / cells
    grid = voxelize(box((SIZE, SIZE, SIZE)), pitch)
    theta, _ = _cooled(grid, grid.fragment_normal.max(axis=1) > 0.9)

    def face(sign: float) -> np.ndarray:
        """Temperatures of one side across x [y z]."""
        side = np.flatnonzero(sign * grid.fragment_normal[:, 0] > 0.9)
        found = np.empty((cells, cells))
        found[grid.fragment_voxel[side, 1], grid.fragment_voxel[side, 2]] = theta[side]
        return found

    inner, outer = face(-1.0), face(1.0)
    # Even parabolas through the nodes at 1/2 and 3/2 voxels, along three and two axes.
    centre = inner[0, 0] + 3 / 8 * (inner[0, 0] - inner[1, 0])
    middle = outer[0, 0] + 2 / 8 * (outer[0, 0] - outer[1, 0])
    edge = 1.5 * outer[-1] - 0.5 * outer[-2]
    corner = 1.5 * edge[-1] - 0.5 * edge[-2]
    return [float(centre), float(corner), float(middle)]


def _measure_lumped() -> Row:
    """V14 with steps of 20, 10 and 5 s, in kelvin at every time."""
    found, steps = [], (20.0, 10.0, 5.0)
    body = Body(FullVolume(bar(1, 0.1).grid), ALUMINIUM, temperature=1000.0)
    scene = Scene((body,), (Surroundings(300.0),), dtype="float64")
    names = tuple(f"T({t:.6g} s)" for t in COOLING)
    for dt in steps:
        solution = simulate(scene, max(COOLING), tuple(COOLING), solver=TRBDF2(dt))
        kelvin = np.asarray(solution.mean_temperature)[:, 0].tolist()
        found.append(values(names, "K", tuple(COOLING.values()), kelvin, 0.1))
    errors = tuple(map(largest_error, found))
    return result(found[-1], Order(steps, errors, expected=2.0))


CASES = (
    Case(
        "V05",
        "long cylinder in a fluid, Bi 1, Fo 0.2",
        "Incropera 5.50",
        "5e-3, at no stated resolution",
        "slice of 40 voxels per radius (20 are too few: see the errors); explicit",
        _measure_cylinder,
    ),
    Case(
        "V07",
        "cube in a fluid, Bi 1, Fo 0.2 on half a side",
        "product of three slabs",
        "3e-3",
        "an eighth, 20 x 20 x 20 voxels; explicit",
        _measure_cube,
    ),
    Case(
        "V14",
        "cube of one temperature that radiates, 1000 K to 300 K around",
        "Bejan and Kraus 3.283; Incropera 5.18",
        "0.1 K",
        "one voxel; TR-BDF2 in steps of 5 s",
        _measure_lumped,
    ),
)
