"""Slabs in a fluid in time: V04, V22a with A1."""

import numpy as np

from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.material.material import Material
from jaxthermo.physics.boundary import Convection
from jaxthermo.scene.scene import Body, Scene
from jaxthermo.structures.kinds.full import FullVolume

from .bodies import FOURIER, RIGHT, bar, between, mirrored
from .case import ZERO_CELSIUS, Case, Measured, Order, largest_error, values


STUFF = Material(1.0, density=1000.0, specific_heat=1000.0)
"""Of V04; its slab is 0.1 m thick, insulated behind, in air of 10 W/(m^2 K): Bi 1."""
COLD, HOT = 300.0, 400.0
THETA = (0.95064178, 0.87925481, 0.64339078, 0.85159546)
"""At the centre, half-way, at the surface, and the mean."""

FDS = Material(0.1, density=100.0, specific_heat=1000.0)
PLACES = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1)
"""From the insulated back [m]."""
FDS_TABLES = {
    (100.0, 1000.0): (24.791, 27.701, 37.429, 55.969, 83.880, 118.217),
    (100.0, 2000.0): (42.06, 45.61, 56.06, 72.77, 94.37, 118.75),
    (10.0, 2000.0): (37.07, 40.14, 49.30, 64.28, 84.28, 107.75),
    (10.0, 14000.0): (112.76, 118.98),
}
"""By coefficient [W/(m^2 K)] and time [s]: [degC] at `PLACES`, or at both ends."""


def _slab(cells, material, start, coefficient, air, times):
    """A slab of 0.1 m: profiles that reach both faces [t n], and means [t]."""
    row = bar(cells, 0.1 / cells)
    body = Body(FullVolume(row.grid), material, temperature=start)
    terms = (Convection(coefficient, air, on=RIGHT),)
    dt = FOURIER * row.pitch**2 / float(material.diffusivity)
    scene = Scene((body,), terms, dtype="float64")
    solution = simulate(scene, times[-1], times, solver=ForwardEuler(dt=dt))
    surface = np.asarray(solution.surface_temperature)
    profiles = []
    for now in surface:
        x, y = mirrored(row.depth, now[row.along])
        # The front's own surface is known too.
        profiles.append((np.append(x, row.length), np.append(y, row.end(now, RIGHT))))
    return profiles, np.asarray(solution.mean_temperature)[:, 0]


def measure_heisler() -> Measured:
    """V04 at 10, 20 and 40 cells."""
    found, sizes = [], (10, 20, 40)
    for cells in sizes:
        ((x, y),), (mean,) = _slab(cells, STUFF, HOT, 10.0, COLD, (2000.0,))
        at = np.array([*between(x, y, (0.0, 0.05, 0.1)), mean])
        theta = ((at - COLD) / (HOT - COLD)).tolist()
        names = ("theta, centre", "theta, half-way", "theta, surface", "theta, mean")
        found.append(values(names, "", THETA, theta, 2e-3))
    errors = tuple(map(largest_error, found))
    return Measured(found[1], Order(tuple(1 / n for n in sizes), errors, asked=2.0))


def measure_fds() -> Measured:
    """V22a and A1 at 10, 20 and 40 cells."""
    found, sizes = [], (10, 20, 40)
    for cells in sizes:
        checks = []
        for coefficient in (100.0, 10.0):
            tables = {t: v for (h, t), v in FDS_TABLES.items() if h == coefficient}
            profiles, _ = _slab(
                cells, FDS, ZERO_CELSIUS + 20.0, coefficient, ZERO_CELSIUS + 120.0,
                tuple(tables),
            )  # fmt: skip
            for (time, table), (x, y) in zip(tables.items(), profiles, strict=True):
                places = PLACES if len(table) == len(PLACES) else (0.0, 0.1)
                at = between(x, y - ZERO_CELSIUS, places)
                names = tuple(
                    f"h {coefficient:g}, {time:g} s, {1e3 * p:g} mm" for p in places
                )
                checks += values(names, "degC", table, at, 0.1)
        found.append(tuple(checks))
    # The table with three decimals; the others would only show their own rounding.
    exact = slice(0, len(PLACES))
    errors = tuple(largest_error(checks[exact]) for checks in found)
    order = Order(tuple(1 / n for n in sizes), errors, asked=2.0)
    return Measured(found[-1], order)


CASES = (
    Case(
        "V04",
        "slab in a fluid, Bi 1, Fo 0.2",
        "Incropera 5.42; Carslaw and Jaeger 3.11",
        "2e-3 at 20 cells, second order",
        "bar of 20 voxels, insulated behind; explicit",
        measure_heisler,
    ),
    Case(
        "V22a, A1",
        "FDS heat_conduction_a and _b: slabs of Bi 100 and 10",
        "firemodels/fds, Verification/Heat_Transfer",
        "0.1 K",
        "bar of 40 voxels, insulated behind; explicit; places are from the back",
        measure_fds,
    ),
)
