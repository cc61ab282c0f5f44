"""Bars and slabs in time: V04, V09, V20b with A8, V22a with A1, 1fb of A9."""

import jax.numpy as jnp
import numpy as np

from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.solvers import (
    AbstractSolver,
    BackwardEuler,
    CrankNicolson,
    ForwardEuler,
)
from jaxthermo.material.material import Material
from jaxthermo.physics.boundary import Convection, FixedTemperature
from jaxthermo.reference import slab as sine_mode
from jaxthermo.scene.scene import Body, Scene
from jaxthermo.structures.kinds.full import FullVolume

from ..harness.case import Case, Order, Row, Value, largest_error, result, values
from .bodies import FOURIER, LEFT, RIGHT, bar, between, mirrored


LENGTH, STEP, STEPS = 0.1, 0.5, 100
"""Length [m], step [s] and number of steps of V09."""
MODE = Material(10.0, density=1000.0, specific_heat=1000.0)
AMPLITUDE = 100.0
"""Amplitude of the sine [K], large against the tolerance of a linear solve."""
SOLVED = 1e-12
"""Tolerance of the linear solves [K]."""
EXACT_DECAY = 0.61049803

T3 = Material(35.0, density=7200.0, specific_heat=440.5)

SHORT = Material(10.0, density=1.0, specific_heat=10.0)
SHORT_PLACES = (0.5, 1.0, 2.0, 3.0)
SHORT_TABLE = {
    0.1: (326.355, 302.535, 300.001, 300.000),
    0.5: (361.708, 331.731, 304.550, 300.270),
    1.0: (372.367, 347.950, 315.728, 303.349),
    5.0: (386.385, 372.940, 347.087, 322.940),
}
SHORT_OFF = {0.1: 9e-4, 0.5: 9e-4, 1.0: 9e-4, 5.0: 5e-5}
"""Errors of the reference code: 0.09 % at 0.1 s, 0.00 % at 5 s."""


def _held(cells, length, material, start, ends, times, solver):
    row = bar(cells, length / cells)
    body = Body(FullVolume(row.grid), material, temperature=start)
    terms = tuple(
        FixedTemperature(value, on=side)
        for value, side in zip(ends, (LEFT, RIGHT), strict=True)
    )
    scene = Scene((body,), terms, dtype="float64")
    solution = simulate(scene, times[-1], times, solver=solver)
    return row, np.asarray(solution.surface_temperature)[:, row.along]


def _decay(cells: int, solver: AbstractSolver) -> float:
    """Remaining fraction of the sine, at the node that is farthest off."""
    shape = lambda x: np.sin(np.pi * (x / LENGTH + 0.5))
    row, found = _held(
        cells, LENGTH, MODE, lambda p: 300.0 + AMPLITUDE * shape(p[:, 0]),
        (300.0, 300.0), (STEP * STEPS,), solver,
    )  # fmt: skip
    left = (found[0] - 300.0) / (AMPLITUDE * np.sin(np.pi * row.depth / LENGTH))
    middle = float(np.median(left))
    return float(left[np.argmax(np.abs(left - middle))])


def _measure_mode() -> Row:
    """V09: every amplitude as its own closed form on the cells has it."""
    euler, implicit, trapezoid = (
        ForwardEuler(STEP),
        BackwardEuler(STEP, tolerance=SOLVED),
        CrankNicolson(STEP, tolerance=SOLVED),
    )
    forms = (
        ("explicit Euler, N=20", 20, euler, sine_mode.decay_explicit_euler),
        ("implicit Euler, N=20", 20, implicit, sine_mode.decay_implicit_euler),
        ("Crank-Nicolson, N=10", 10, trapezoid, sine_mode.decay_crank_nicolson),
        ("Crank-Nicolson, N=20", 20, trapezoid, sine_mode.decay_crank_nicolson),
        ("Crank-Nicolson, N=40", 40, trapezoid, sine_mode.decay_crank_nicolson),
    )
    checks = []
    for name, cells, solver, form in forms:
        rate = sine_mode.sine_rate_of_cells(MODE.diffusivity, LENGTH, cells)
        exact = form(rate, STEP, STEPS)
        checks.append(Value(name, "", exact, _decay(cells, solver), 1e-10))
    errors = tuple(abs(check.computed - EXACT_DECAY) for check in checks[2:])
    return result(tuple(checks), Order((1 / 10, 1 / 20, 1 / 40), errors, expected=2.0))


def _swing(time):
    return ZERO_CELSIUS + 100.0 * jnp.sin(jnp.pi * time / 40.0)


def _measure_t3() -> Row:
    """V20b and A8 at 20, 40 and 80 cells."""
    found, sizes = [], (20, 40, 80)
    for cells in sizes:
        dt = FOURIER * (0.1 / cells) ** 2 / float(T3.diffusivity)
        row, profile = _held(
            cells, 0.1, T3, ZERO_CELSIUS, (ZERO_CELSIUS, _swing), (32.0,),
            ForwardEuler(dt),
        )  # fmt: skip
        (at,) = between(row.depth, profile[0] - ZERO_CELSIUS, (0.08,))
        found.append(Value("T(80 mm, 32 s)", "degC", 36.603116, at, 0.1))
    errors = tuple(abs(value.error) for value in found)
    order = Order(tuple(1 / n for n in sizes), errors, expected=2.0)
    return result((found[-1],), order)


def _measure_bar() -> Row:
    """A9 1fb at 40, 80 and 160 cells."""
    found, sizes = [], (40, 80, 160)
    for cells in sizes:
        dt = FOURIER * (4.0 / cells) ** 2 / float(SHORT.diffusivity)
        row, profiles = _held(
            cells, 4.0, SHORT, 300.0, (400.0, 300.0), tuple(SHORT_TABLE),
            ForwardEuler(dt),
        )  # fmt: skip
        checks = []
        for (time, exact), now in zip(SHORT_TABLE.items(), profiles, strict=True):
            at = between(row.depth, now, SHORT_PLACES)
            names = tuple(f"T({x:g} m, {time:g} s)" for x in SHORT_PLACES)
            checks += values(names, "K", exact, at, SHORT_OFF[time] * 300.0)
        found.append(tuple(checks))
    errors = tuple(map(largest_error, found))
    return result(found[-1], Order(tuple(4.0 / n for n in sizes), errors))


STUFF = Material(1.0, density=1000.0, specific_heat=1000.0)
"""V04: slab of 0.1 m, insulated behind, in air of 10 W/(m^2 K), Bi 1."""
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


def _measure_heisler() -> Row:
    """V04 at 10, 20 and 40 cells."""
    found, sizes = [], (10, 20, 40)
    for cells in sizes:
        ((x, y),), (mean,) = _slab(cells, STUFF, HOT, 10.0, COLD, (2000.0,))
        at = np.array([*between(x, y, (0.0, 0.05, 0.1)), mean])
        theta = ((at - COLD) / (HOT - COLD)).tolist()
        names = ("theta, centre", "theta, half-way", "theta, surface", "theta, mean")
        found.append(values(names, "", THETA, theta, 2e-3))
    errors = tuple(map(largest_error, found))
    return result(found[1], Order(tuple(1 / n for n in sizes), errors, expected=2.0))


def _measure_fds() -> Row:
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
    order = Order(tuple(1 / n for n in sizes), errors, expected=2.0)
    return result(found[-1], order)


CASES = (
    Case(
        "V04",
        "slab in a fluid, Bi 1, Fo 0.2",
        "Incropera 5.42; Carslaw and Jaeger 3.11",
        "2e-3 at 20 cells, second order",
        "bar of 20 voxels, insulated behind; explicit",
        _measure_heisler,
    ),
    Case(
        "V22a, A1",
        "FDS heat_conduction_a and _b: slabs of Bi 100 and 10",
        "firemodels/fds, Verification/Heat_Transfer",
        "0.1 K",
        "bar of 40 voxels, insulated behind; explicit; places are from the back",
        _measure_fds,
    ),
    Case(
        "V09",
        "one sine mode between two cold faces",
        "4 alpha / h^2 sin^2(pi / 2 N), an exact mode of the cells too",
        "1e-10",
        "bars of 10, 20, 40 voxels, 100 steps of 0.5 s; worst node",
        _measure_mode,
    ),
    Case(
        "V20b, A8",
        "NAFEMS T3: one end swings",
        "NAFEMS Standard Benchmarks; MOOSE nafems_t3 (36.89 with dt 1 s)",
        "0.1 K",
        "bar of 80 voxels; explicit",
        _measure_t3,
    ),
    Case(
        "A9 1fb",
        "bar between 400 and 300 K",
        "TMAP8 ver-1fb",
        "0.09 % to 1 s and 0.005 % at 5 s, what the peer is off by",
        "bar of 160 voxels of 25 mm; explicit; expected to 3 decimals",
        _measure_bar,
    ),
)
