"""Half-spaces, bars and slabs in time: V01, V02, V04, V09, V20b, V22a, A1, A8, A9."""

from collections.abc import Iterator, Sequence

import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.reference import semi_infinite, slab

from ..harness.case import (
    Check,
    Order,
    Row,
    case,
    converge,
    largest_error,
    near,
    values,
)
from ..harness.scenes import single
from .bodies import LEFT, RIGHT, Bar, bar, between, mirrored, run


def _surfaces(row: Bar, material, start, terms, times, solver=None) -> np.ndarray:
    solution = run(single(row.grid, material, start, *terms), times, solver)
    return np.asarray(solution.surface_temperature)


# Half-spaces: bars so long that heat does not come to their other end.

_STEEL = jt.Material(45.0, density=7800.0, specific_heat=460.0)
_ROOM = ZERO_CELSIUS + 20.0
_DEPTHS = (0.005, 0.01, 0.02, 0.05)
# At those depths [m] after 60 s [degC].
_STEP_RISE = {
    f"T({1e3 * depth:g} mm, 60 s)": float(
        semi_infinite.surface_step(
            depth,
            60.0,
            initial=20.0,
            surface=100.0,
            diffusivity=_STEEL.diffusivity,
        )
    )
    for depth in _DEPTHS
}


@case(
    "V01",
    title="half-space, surface suddenly at another temperature",
    source="Carslaw and Jaeger 2.4; Incropera 5.60",
    requirement="0.1 % of 80 K at 20 cells per diffusion length",
    method="bar of 165 voxels of 1.33 mm; explicit",
)
def _step() -> Row:
    def at(pitch: float):
        row = bar(round(0.22 / pitch), pitch)
        hot = jt.FixedTemperature(ZERO_CELSIUS + 100.0, on=LEFT)
        (surface,) = _surfaces(
            row, material=_STEEL, start=_ROOM, terms=(hot,), times=(60.0,)
        )
        temperatures = between(row.depth, surface[row.along] - ZERO_CELSIUS, _DEPTHS)
        return values(
            expected=_STEP_RISE,
            computed=temperatures,
            unit="degC",
            tolerance=1e-3 * 80.0,
        )

    # 10, 20 and 41 cells per diffusion length; the second is what the source states.
    pitches = (0.01 / 3.5, 0.01 / 7.5, 0.01 / 15.0)
    return converge(measure=at, at=pitches, expected=2.0, shown=1)


# Heat flux into the surface of V02 [W/m^2].
_FLUX = jt.HeatFlux(3.2e5, on=LEFT)
_HOLMAN = jt.Material(45.0, density=8000.0, specific_heat=401.79)


def _heated(depth: float, time: float, start: float, material: jt.Material) -> float:
    return float(
        semi_infinite.surface_flux(
            depth,
            time,
            initial=start,
            heat_flux=3.2e5,
            conductivity=45.0,
            diffusivity=material.diffusivity,
        )
    )


_FLUX_TIMES = (1.0, 10.0, 60.0)
_FLUX_RISE = {
    f"T(0, {time:g} s)": _heated(0.0, time=time, start=20.0, material=_STEEL)
    for time in _FLUX_TIMES
}


@case(
    "V02",
    title="half-space, constant flux",
    source="Incropera 5.62; Holman 4.2",
    requirement="0.2 K",
    method="bar of 440 voxels of 0.5 mm, Holman's of 220 of 1 mm; explicit",
)
def _flux() -> Row:
    def at(pitch: float):
        row = bar(round(0.22 / pitch), pitch)
        surfaces = _surfaces(
            row, material=_STEEL, start=_ROOM, terms=(_FLUX,), times=_FLUX_TIMES
        )
        temperatures = [row.end(now, LEFT) - ZERO_CELSIUS for now in surfaces]
        return values(
            expected=_FLUX_RISE, computed=temperatures, unit="degC", tolerance=0.2
        )

    measured = converge(at, (0.01 / 5, 0.01 / 10, 0.01 / 20), expected=2.0)
    row = bar(220, 1e-3)
    (surface,) = _surfaces(
        row, material=_HOLMAN, start=ZERO_CELSIUS + 35.0, terms=(_FLUX,), times=(30.0,)
    )
    (inside,) = between(row.depth, surface[row.along] - ZERO_CELSIUS, (0.025,))
    exact = _heated(0.025, time=30.0, start=35.0, material=_HOLMAN)
    name = "Holman 4.2: T(25 mm, 30 s)"
    holman = near(name, inside, exact, unit="degC", tolerance=0.2)
    return measured._replace(checks=(*measured.checks, holman))


_COPPER = jt.Material(401.0, density=3.439e6, specific_heat=1.0)
_CONVECTED_TIMES = (100.0, 500.0, 1000.0, 1500.0)
# At those times [s], 5 cm deep [K].
_CONVECTED = {
    f"T(5 cm, {time:g} s)": float(
        semi_infinite.surface_convection(
            0.05,
            time,
            initial=100.0,
            ambient=500.0,
            heat_transfer_coefficient=200.0,
            conductivity=401.0,
            diffusivity=_COPPER.diffusivity,
        )
    )
    for time in _CONVECTED_TIMES
}


@case(
    "A9 1fd",
    title="half-space in a fluid",
    source="TMAP8 ver-1fd",
    requirement="0.29 %, what the peer is off by",
    method="bar of 375 voxels of 6.7 mm; explicit",
)
def _convected() -> Row:
    def at(pitch: float):
        row = bar(round(2.5 / pitch), pitch)
        air = jt.Convection(200.0, 500.0, on=LEFT)
        surfaces = _surfaces(
            row, material=_COPPER, start=100.0, terms=(air,), times=_CONVECTED_TIMES
        )
        temperatures = [
            between(row.depth, now[row.along], (0.05,))[0] for now in surfaces
        ]
        return values(
            expected=_CONVECTED, computed=temperatures, unit="K", fraction=0.0029
        )

    # 13, 29 and 63 cells per diffusion length of the last time.
    return converge(at, (0.05 / 1.5, 0.05 / 3.5, 0.05 / 7.5))


# Slabs in a fluid: one half of the slab, from its middle to the surface.


def _slab(cells: int, material, start, air: jt.Convection, times):
    """Profiles of 0.1 m that go to both faces, by time, and means."""
    row = bar(cells, 0.1 / cells)
    solution = run(single(row.grid, material, start, air), times)
    profiles = []
    for now in np.asarray(solution.surface_temperature):
        x, y = mirrored(row.depth, now[row.along])
        # The front's own surface is known too.
        position = np.append(x, row.length)
        profiles.append((position, np.append(y, row.end(now, RIGHT))))
    return profiles, np.asarray(solution.mean_temperature)[:, 0]


# Bi = h 0.1 m / k = 1 in air of 10 W/(m^2 K).
_STUFF = jt.Material(1.0, density=1000.0, specific_heat=1000.0)
_COLD = 300.0
_HOT = 400.0
_CENTRE, _HALF_WAY, _SURFACE = slab.slab_convection(
    np.array([0.0, 0.5, 1.0]), 0.2, 1.0
).tolist()
_THETA = {
    "theta, centre": _CENTRE,
    "theta, half-way": _HALF_WAY,
    "theta, surface": _SURFACE,
    "theta, mean": float(slab.slab_convection_mean(0.2, 1.0)),
}


@case(
    "V04",
    title="slab in a fluid, Bi 1, Fo 0.2",
    source="Incropera 5.42; Carslaw and Jaeger 3.11",
    requirement="2e-3 at 20 cells, second order",
    method="bar of 20 voxels, insulated behind; explicit",
)
def _heisler() -> Row:
    def at(cells: int):
        air = jt.Convection(10.0, _COLD, on=RIGHT)
        ((x, y),), (mean,) = _slab(
            cells, material=_STUFF, start=_HOT, air=air, times=(2000.0,)
        )
        temperatures = np.array([*between(x, y, (0.0, 0.05, 0.1)), mean])
        theta = (temperatures - _COLD) / (_HOT - _COLD)
        return values(_THETA, theta, tolerance=2e-3)

    return converge(measure=at, at=(10, 20, 40), length=1, expected=2.0, shown=1)


_FDS = jt.Material(0.1, density=100.0, specific_heat=1000.0)
# From the insulated back [m].
_PLACES = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1)
# By coefficient [W/(m^2 K)] and time [s]: [degC] at those places, or at both ends.
_FDS_TABLES = {
    100.0: {
        1000.0: (24.791, 27.701, 37.429, 55.969, 83.880, 118.217),
        2000.0: (42.06, 45.61, 56.06, 72.77, 94.37, 118.75),
    },
    10.0: {
        2000.0: (37.07, 40.14, 49.30, 64.28, 84.28, 107.75),
        14000.0: (112.76, 118.98),
    },
}


def _fds_checks(cells: int) -> Iterator[Check]:
    for h, tables in _FDS_TABLES.items():
        gas = jt.Convection(h, ZERO_CELSIUS + 120.0, on=RIGHT)
        profiles, _ = _slab(
            cells, material=_FDS, start=_ROOM, air=gas, times=tuple(tables)
        )
        for (time, table), (x, y) in zip(tables.items(), profiles, strict=True):
            places = _PLACES if len(table) == len(_PLACES) else (0.0, 0.1)
            temperatures = between(x, y - ZERO_CELSIUS, places)
            expected = {
                f"h {h:g}, {time:g} s, {1e3 * place:g} mm": celsius
                for place, celsius in zip(places, table, strict=True)
            }
            yield from values(
                expected=expected, computed=temperatures, unit="degC", tolerance=0.1
            )


@case(
    "V22a, A1",
    title="FDS heat_conduction_a and _b: slabs of Bi 100 and 10",
    source="firemodels/fds, Verification/Heat_Transfer",
    requirement="0.1 K",
    method="bar of 40 voxels, insulated behind; explicit; places are from the back",
)
def _fds() -> Row:
    # The table with three decimals; the others would only show their own rounding.

    def error_of_exact_table(checks: Sequence[Check]) -> float:
        return largest_error(checks[: len(_PLACES)])

    return converge(
        measure=_fds_checks,
        at=(10, 20, 40),
        length=1,
        expected=2.0,
        error=error_of_exact_table,
    )


# Bars between two prescribed temperatures.


def _profiles(cells: int, length: float, material, start, ends, times, solver=None):
    """A bar and the temperatures of its nodes at each time [K]."""
    row = bar(cells, length / cells)
    terms = tuple(map(jt.FixedTemperature, ends, (LEFT, RIGHT)))
    return row, _surfaces(
        row, material=material, start=start, terms=terms, times=times, solver=solver
    )[:, row.along]


_MODE = jt.Material(10.0, density=1000.0, specific_heat=1000.0)
_MODE_LENGTH = 0.1
_MODE_STEP = 0.5
_MODE_STEPS = 100
# Amplitude of the sine [K]: large against the tolerance of a linear solve [K].
_AMPLITUDE = 100.0
_SOLVED = 1e-12


def _decay(cells: int, solver) -> float:
    """Remaining fraction of the sine, at the node with the largest error."""

    def start_temperature(points: np.ndarray) -> np.ndarray:
        phase = np.pi * (points[:, 0] / _MODE_LENGTH + 0.5)
        return 300.0 + _AMPLITUDE * np.sin(phase)

    row, node_temperatures = _profiles(
        cells,
        length=_MODE_LENGTH,
        material=_MODE,
        start=start_temperature,
        ends=(300.0, 300.0),
        times=(_MODE_STEP * _MODE_STEPS,),
        solver=solver,
    )
    sine = _AMPLITUDE * np.sin(np.pi * row.depth / _MODE_LENGTH)
    fraction = (node_temperatures[0] - 300.0) / sine
    # In an exact mode all nodes decay alike: one that does not shows the error.
    deviation = np.abs(fraction - float(np.median(fraction)))
    return float(fraction[np.argmax(deviation)])


@case(
    "V09",
    title="one sine mode between two cold faces",
    source="4 alpha / h^2 sin^2(pi / 2 N), an exact mode of the cells too",
    requirement="1e-10",
    method="bars of 10, 20, 40 voxels, 100 steps of 0.5 s; worst node",
)
def _mode() -> Row:
    euler = jt.ForwardEuler(_MODE_STEP)
    implicit = jt.BackwardEuler(_MODE_STEP, tolerance=_SOLVED)
    trapezoid = jt.CrankNicolson(_MODE_STEP, tolerance=_SOLVED)
    forms = (
        ("explicit Euler", 20, euler, slab.decay_explicit_euler),
        ("implicit Euler", 20, implicit, slab.decay_implicit_euler),
        *(
            ("Crank-Nicolson", cells, trapezoid, slab.decay_crank_nicolson)
            for cells in (10, 20, 40)
        ),
    )
    checks = []
    for name, cells, solver, form in forms:
        rate = slab.sine_rate_of_cells(_MODE.diffusivity, _MODE_LENGTH, cells)
        exact = form(rate, _MODE_STEP, _MODE_STEPS)
        decay = _decay(cells, solver)
        checks.append(near(f"{name}, N={cells}", decay, exact, tolerance=1e-10))
    # The order is that of space alone: the cells' own rate against the exact one.
    rate = slab.sine_rate(_MODE.diffusivity, _MODE_LENGTH)
    decay = slab.decay_exact(rate, _MODE_STEP * _MODE_STEPS)
    errors = tuple(abs(check.computed - decay) for check in checks[2:])
    return Row(
        checks=tuple(checks),
        order=Order((1 / 10, 1 / 20, 1 / 40), errors, expected=2.0),
    )


_T3 = jt.Material(35.0, density=7200.0, specific_heat=440.5)


@case(
    "V20b, A8",
    title="NAFEMS T3: one end swings",
    source="NAFEMS Standard Benchmarks; MOOSE nafems_t3 (36.89 with dt 1 s)",
    requirement="0.1 K",
    method="bar of 80 voxels; explicit",
)
def _t3() -> Row:
    def end_temperature(time):
        return ZERO_CELSIUS + 100.0 * jnp.sin(jnp.pi * time / 40.0)

    def at(cells: int):
        row, (now,) = _profiles(
            cells,
            length=0.1,
            material=_T3,
            start=ZERO_CELSIUS,
            ends=(ZERO_CELSIUS, end_temperature),
            times=(32.0,),
        )
        (inside,) = between(row.depth, now - ZERO_CELSIUS, (0.08,))
        return (near("T(80 mm, 32 s)", inside, 36.603116, unit="degC", tolerance=0.1),)

    return converge(measure=at, at=(20, 40, 80), length=1, expected=2.0)


_SHORT = jt.Material(10.0, density=1.0, specific_heat=10.0)
_SHORT_PLACES = (0.5, 1.0, 2.0, 3.0)
# By time [s]: relative error of the reference code, and [K] at those places [m].
_SHORT_TABLE = {
    0.1: (9e-4, (326.355, 302.535, 300.001, 300.000)),
    0.5: (9e-4, (361.708, 331.731, 304.550, 300.270)),
    1.0: (9e-4, (372.367, 347.950, 315.728, 303.349)),
    5.0: (5e-5, (386.385, 372.940, 347.087, 322.940)),
}


@case(
    "A9 1fb",
    title="bar between 400 and 300 K",
    source="TMAP8 ver-1fb",
    requirement="0.09 % to 1 s and 0.005 % at 5 s, what the peer is off by",
    method="bar of 160 voxels of 25 mm; explicit; expected to 3 decimals",
)
def _short() -> Row:
    def at(cells: int) -> Iterator[Check]:
        row, profiles = _profiles(
            cells,
            length=4.0,
            material=_SHORT,
            start=300.0,
            ends=(400.0, 300.0),
            times=tuple(_SHORT_TABLE),
        )
        rows = zip(_SHORT_TABLE.items(), profiles, strict=True)
        for (time, (fraction, exact)), now in rows:
            expected = {
                f"T({x:g} m, {time:g} s)": kelvin
                for x, kelvin in zip(_SHORT_PLACES, exact, strict=True)
            }
            temperatures = between(row.depth, now, _SHORT_PLACES)
            yield from values(
                expected=expected,
                computed=temperatures,
                unit="K",
                tolerance=fraction * 300.0,
            )

    return converge(at, (40, 80, 160), 4.0)


CASES = (_step, _flux, _convected, _heisler, _fds, _mode, _t3, _short)
