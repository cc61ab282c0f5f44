"""Bodies of two and three dimensions in a fluid: V05, V07; and of none: V14."""

import numpy as np

import jaxthermo as jt
from jaxthermo.reference.radiation import radiation_temperature, radiation_time
from jaxthermo.reference.slab import slab_convection

from ..harness.case import Row, case, converge, values
from ..harness.scenes import single
from .bodies import bar, layered


# Radius, or half a side [m].
_SIZE = 0.1
_STUFF = jt.Material(1.0, density=1000.0, specific_heat=1000.0)
_AIR = 300.0
_HOT = 400.0
_CYLINDER = {
    "theta, axis": 0.87017424,
    "theta, half-way": 0.7938029,
    "theta, surface": 0.57022774,
    "theta, mean": 0.71851626,
}
# Theta of the slab at its centre and its surface; a cube is the product of three.
_MIDDLE, _FACE = slab_convection(np.array([0.0, 1.0]), 0.2, 1.0).tolist()
_CUBE = {
    "theta, centre": _MIDDLE**3,
    "theta, corner": _FACE**3,
    "theta, middle of a face": _MIDDLE**2 * _FACE,
}


def _cooled(grid: jt.VoxelGrid, exposed: np.ndarray) -> tuple[np.ndarray, float]:
    """Theta of the surface and of the whole body at Bi = 1 and Fo = 0.2."""
    # Bi = h SIZE / k; Fo = alpha t / SIZE^2.
    air = jt.Convection(10.0, _AIR, on=jt.FragmentMask(exposed))
    scene = single(grid, _STUFF, _HOT, air)
    solution = jt.simulate(scene, 2000.0, solver=jt.ForwardEuler())
    surface = np.asarray(solution.surface_temperature)[0]
    mean = float(solution.mean_temperature[0, 0])
    excess = _HOT - _AIR
    return (surface - _AIR) / excess, (mean - _AIR) / excess


@case(
    "V05",
    title="long cylinder in a fluid, Bi 1, Fo 0.2",
    source="Incropera 5.50",
    requirement="5e-3, at no stated resolution",
    method="slice of 40 voxels per radius (20 are too few: see the errors); explicit",
)
def _cylinder() -> Row:
    def at(cells: int):
        # A slice one voxel thick between two ends that nothing passes through.
        pitch = _SIZE / cells
        grid = jt.voxelize(jt.shapes.cylinder(_SIZE, pitch, sections=256), pitch)
        end = np.abs(grid.fragment_normal[:, 2]) > 0.9
        theta, mean = _cooled(grid, ~end)
        centre = grid.lattice.centres(grid.fragment_voxel)
        radius = np.hypot(centre[end, 0], centre[end, 1]) / _SIZE
        # No node lies on the axis nor half-way: smooth fits through those around.
        is_near_axis = radius < 0.3
        is_halfway = np.abs(radius - 0.5) < 0.15
        node_theta = theta[end]
        near_axis = np.polyfit(radius[is_near_axis] ** 2, node_theta[is_near_axis], 2)
        halfway = np.polyfit(radius[is_halfway] - 0.5, node_theta[is_halfway], 3)
        outside = np.average(theta[~end], weights=grid.fragment_area[~end])
        return values(
            _CYLINDER, (near_axis[-1], halfway[-1], outside, mean), tolerance=5e-3
        )

    # Voxels make steps of a round surface: no order is expected of them.
    return converge(at, (10, 20, 40), 1)


@case(
    "V07",
    title="cube in a fluid, Bi 1, Fo 0.2 on half a side",
    source="product of three slabs",
    requirement="3e-3",
    method="an eighth, 20 x 20 x 20 voxels; explicit",
)
def _cube() -> Row:
    def at(cells: int):
        # An eighth of it: nothing passes through the three planes of symmetry.
        grid = jt.voxelize(jt.shapes.box((_SIZE, _SIZE, _SIZE)), _SIZE / cells)
        theta, _ = _cooled(grid, grid.fragment_normal.max(axis=1) > 0.9)
        inner = layered(theta, grid=grid, axis=0, sign=-1)
        outer = layered(theta, grid=grid, axis=0)
        # Even parabolas through the nodes at 1/2 and 3/2 voxels, along 3 and 2 axes.
        inner_slope = inner[0, 0] - inner[1, 0]
        outer_slope = outer[0, 0] - outer[1, 0]
        centre = inner[0, 0] + 3 / 8 * inner_slope
        middle = outer[0, 0] + 2 / 8 * outer_slope
        # Straight lines out to the edge and along it, from the same two distances.
        edge = 1.5 * outer[-1] - 0.5 * outer[-2]
        corner = 1.5 * edge[-1] - 0.5 * edge[-2]
        return values(_CUBE, (centre, corner, middle), tolerance=3e-3)

    return converge(measure=at, at=(10, 20, 40), length=1, expected=2.0, shown=1)


# Without resistance inside: one temperature.
_ALUMINIUM = jt.Material(1e9, density=2700.0, specific_heat=900.0, emissivity=0.9)
_COOLED = {
    "initial": 1000.0,
    "surroundings": 300.0,
    "capacity": 2700.0 * 900.0 * 0.1**3,
    "area": 6 * 0.1**2,
    "emissivity": 0.9,
}
# Times [s], those of some temperatures among them, and the temperatures then [K].
_TIMES = (60.0, 300.0, 600.0, 1800.0, 3600.0)
_TIMES += tuple(radiation_time(np.array([900.0, 700.0, 500.0, 400.0]), **_COOLED))
_TIMES = tuple(sorted(float(time) for time in _TIMES))
_COOLING = {
    f"T({time:.6g} s)": float(temperature)
    for time, temperature in zip(
        _TIMES, radiation_temperature(np.array(_TIMES), **_COOLED), strict=True
    )
}


@case(
    "V14",
    title="cube of one temperature that radiates, 1000 K to 300 K around",
    source="Bejan and Kraus 3.283; Incropera 5.18",
    requirement="0.1 K",
    method="one voxel; TR-BDF2 in steps of 5 s",
)
def _lumped() -> Row:
    cube = bar(1, 0.1).grid
    scene = single(cube, _ALUMINIUM, 1000.0, jt.Surroundings(300.0))

    def at(dt: float):
        solution = jt.simulate(scene, _TIMES[-1], _TIMES, solver=jt.TRBDF2(dt))
        temperatures = np.asarray(solution.mean_temperature)[:, 0]
        return values(expected=_COOLING, computed=temperatures, unit="K", tolerance=0.1)

    return converge(at, (20.0, 10.0, 5.0), expected=2.0)


CASES = (_cylinder, _cube, _lumped)
