"""Bars between two temperatures in time: V09, V20b with A8, 1fb of A9."""

import jax.numpy as jnp
import numpy as np

from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.solvers import (
    AbstractSolver,
    BackwardEuler,
    CrankNicolson,
    ForwardEuler,
)
from jaxthermo.material.material import Material
from jaxthermo.physics.boundary import FixedTemperature
from jaxthermo.reference import slab as sine_mode
from jaxthermo.scene.scene import Body, Scene
from jaxthermo.structures.kinds.full import FullVolume

from .bodies import FOURIER, LEFT, RIGHT, bar, between
from .case import (
    ZERO_CELSIUS,
    Case,
    Measured,
    Order,
    Value,
    largest_error,
    values,
)


LENGTH, STEP, STEPS = 0.1, 0.5, 100
"""Of V09 [m], [s]."""
MODE = Material(10.0, density=1000.0, specific_heat=1000.0)
AMPLITUDE = 100.0
"""[K]: a linear solve's tolerance is then small beside it."""
SOLVED = 1e-12
"""Left by linear solves [K]."""
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
"""The peer's: 0.09 % at 0.1 s, 0.00 % at 5 s."""


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
    """What is left of the sine's amplitude, at the node where most is missing."""
    shape = lambda x: np.sin(np.pi * (x / LENGTH + 0.5))
    row, found = _held(
        cells, LENGTH, MODE, lambda p: 300.0 + AMPLITUDE * shape(p[:, 0]),
        (300.0, 300.0), (STEP * STEPS,), solver,
    )  # fmt: skip
    left = (found[0] - 300.0) / (AMPLITUDE * np.sin(np.pi * row.depth / LENGTH))
    middle = float(np.median(left))
    return float(left[np.argmax(np.abs(left - middle))])


def measure_mode() -> Measured:
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
    return Measured(tuple(checks), Order((1 / 10, 1 / 20, 1 / 40), errors, asked=2.0))


def _swing(time):
    return ZERO_CELSIUS + 100.0 * jnp.sin(jnp.pi * time / 40.0)


def measure_t3() -> Measured:
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
    order = Order(tuple(1 / n for n in sizes), errors, asked=2.0)
    return Measured((found[-1],), order)


def measure_bar() -> Measured:
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
    return Measured(found[-1], Order(tuple(4.0 / n for n in sizes), errors))


CASES = (
    Case(
        "V09",
        "one sine mode between two cold faces",
        "4 alpha / h^2 sin^2(pi / 2 N), an exact mode of the cells too",
        "1e-10",
        "bars of 10, 20, 40 voxels, 100 steps of 0.5 s; the node that is off most",
        measure_mode,
    ),
    Case(
        "V20b, A8",
        "NAFEMS T3: one end swings",
        "NAFEMS Standard Benchmarks; MOOSE nafems_t3 (36.89 with dt 1 s)",
        "0.1 K",
        "bar of 80 voxels; explicit",
        measure_t3,
    ),
    Case(
        "A9 1fb",
        "bar between 400 and 300 K",
        "TMAP8 ver-1fb",
        "0.09 % to 1 s and 0.005 % at 5 s, what the peer is off by",
        "bar of 160 voxels of 25 mm; explicit; expected to 3 decimals",
        measure_bar,
    ),
)
