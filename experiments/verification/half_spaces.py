"""Half-spaces in time: V01, V02 and 1fd of A9."""

import numpy as np

from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.material.material import Material
from jaxthermo.physics.boundary import Convection, FixedTemperature, HeatFlux
from jaxthermo.scene.scene import Body, Scene
from jaxthermo.structures.kinds.full import FullVolume

from ..harness.case import Case, Order, Row, Value, largest_error, result, values
from .bodies import FOURIER, LEFT, bar, between


STEEL = Material(45.0, density=7800.0, specific_heat=460.0)
HOLMAN = Material(45.0, density=8000.0, specific_heat=401.79)
COPPER = Material(401.0, density=3.439e6, specific_heat=1.0)

DEPTHS = (0.005, 0.01, 0.02, 0.05)
"""Depths of V01 at 60 s [m]."""
STEP_RISE = (91.795949, 83.726865, 68.494259, 35.79627)
"""[degC]"""
FLUX = 3.2e5
"""Heat flux of V02 [W/m^2]."""
FLUX_TIMES = (1.0, 10.0, 60.0)
FLUX_SURFACE = (48.416629, 109.86127, 240.11426)
CONVECTION_TIMES = (100.0, 500.0, 1000.0, 1500.0)
CONVECTION_DEPTH = 0.05
CONVECTED = (114.981, 140.765, 158.598, 171.374)


def _run(cells, pitch, material, start, term, times):
    """A bar as long as heat does not come to its other end."""
    row = bar(cells, pitch)
    body = Body(FullVolume(row.grid), material, temperature=start)
    scene = Scene((body,), (term,), dtype="float64")
    dt = FOURIER * pitch**2 / float(material.diffusivity)
    solution = simulate(scene, times[-1], times, solver=ForwardEuler(dt=dt))
    return row, np.asarray(solution.surface_temperature)


def _measure_step() -> Row:
    """V01 at 10, 20 and 41 cells per diffusion length, 0.22 m deep."""
    found, pitches = [], (0.01 / 3.5, 0.01 / 7.5, 0.01 / 15.0)
    term = FixedTemperature(ZERO_CELSIUS + 100.0, on=LEFT)
    start = ZERO_CELSIUS + 20.0
    for pitch in pitches:
        cells = round(0.22 / pitch)
        row, surface = _run(cells, pitch, STEEL, start, term, (60.0,))
        profile = surface[0, row.along] - ZERO_CELSIUS
        at = between(row.depth, profile, DEPTHS)
        names = tuple(f"T({1e3 * x:g} mm, 60 s)" for x in DEPTHS)
        found.append(values(names, "degC", STEP_RISE, at, 1e-3 * 80.0))
    errors = tuple(map(largest_error, found))
    return result(found[1], Order(pitches, errors, expected=2.0))


def _measure_flux() -> Row:
    """V02: the surface at three times, and Holman's point inside."""
    found, pitches = [], (0.01 / 5, 0.01 / 10, 0.01 / 20)
    for pitch in pitches:
        cells = round(0.22 / pitch)
        term = HeatFlux(FLUX, on=LEFT)
        start = ZERO_CELSIUS + 20.0
        row, surface = _run(cells, pitch, STEEL, start, term, FLUX_TIMES)
        at = [row.end(now, LEFT) - ZERO_CELSIUS for now in surface]
        names = tuple(f"T(0, {t:g} s)" for t in FLUX_TIMES)
        found.append(values(names, "degC", FLUX_SURFACE, at, 0.2))
    errors = tuple(map(largest_error, found))
    return result((*found[-1], _holman()), Order(pitches, errors, expected=2.0))


def _holman() -> Value:
    term, start = HeatFlux(FLUX, on=LEFT), ZERO_CELSIUS + 35.0
    row, surface = _run(220, 1e-3, HOLMAN, start, term, (30.0,))
    profile = surface[0, row.along] - ZERO_CELSIUS
    (at,) = between(row.depth, profile, (0.025,))
    return Value("Holman 4.2: T(25 mm, 30 s)", "degC", 79.313554, at, 0.2)


def _measure_convection() -> Row:
    """A9 1fd at 13, 29 and 63 cells per diffusion length of the last time."""
    found, pitches = [], (0.05 / 1.5, 0.05 / 3.5, 0.05 / 7.5)
    term = Convection(200.0, 500.0, on=LEFT)
    for pitch in pitches:
        cells = round(2.5 / pitch)
        row, surface = _run(cells, pitch, COPPER, 100.0, term, CONVECTION_TIMES)
        at = [
            between(row.depth, now[row.along], (CONVECTION_DEPTH,))[0]
            for now in surface
        ]
        found.append(
            tuple(
                Value(f"T(5 cm, {t:g} s)", "K", exact, now, 0.0029 * exact)
                for t, exact, now in zip(CONVECTION_TIMES, CONVECTED, at, strict=True)
            )
        )
    errors = tuple(map(largest_error, found))
    return result(found[-1], Order(pitches, errors))


CASES = (
    Case(
        "V01",
        "half-space, surface suddenly at another temperature",
        "Carslaw and Jaeger 2.4; Incropera 5.60",
        "0.1 % of 80 K at 20 cells per diffusion length",
        "bar of 165 voxels of 1.33 mm; explicit",
        _measure_step,
    ),
    Case(
        "V02",
        "half-space, constant flux",
        "Incropera 5.62; Holman 4.2",
        "0.2 K",
        "bar of 440 voxels of 0.5 mm, Holman's of 220 of 1 mm; explicit",
        _measure_flux,
    ),
    Case(
        "A9 1fd",
        "half-space in a fluid",
        "TMAP8 ver-1fd",
        "0.29 %, what the peer is off by",
        "bar of 375 voxels of 6.7 mm; explicit; expected to 3 decimals",
        _measure_convection,
    ),
)
