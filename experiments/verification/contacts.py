"""Bodies that touch, in time: V11, V12, A19."""

import functools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

import jaxthermo as jt
from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.integrate.energy import Energy
from jaxthermo.reference.semi_infinite import contact_surfaces, perfect_contact

from ..harness.case import Check, Row, case, converge, largest_error, near, values
from ..harness.scenes import full, single
from .bodies import LEFT, RIGHT, bar, explicit, run


COPPER = jt.Material(401.0, density=8933.0, specific_heat=385.0)
STEEL = jt.Material(15.1, density=8055.0, specific_heat=480.0)
# Lengths of the copper and steel bars: the far ends stay as they were.
_DIFFUSION_LENGTHS = (6.1, 7.0)
# Diffusion lengths of copper, in those of steel.
_IN_COPPER = float((COPPER.diffusivity / STEEL.diffusivity) ** 0.5)

CONDUCTANCE = 1000.0
INTERFACE = perfect_contact(
    100.0,
    temperature_b=0.0,
    effusivity_a=COPPER.effusivity,
    effusivity_b=STEEL.effusivity,
)


def resisted(time: float) -> list[float]:
    """Closed form: both surfaces [degC] and the flux [W/m^2] at that conductance."""
    surfaces_and_flux = contact_surfaces(
        time,
        temperature_a=100.0,
        temperature_b=0.0,
        effusivity_a=COPPER.effusivity,
        effusivity_b=STEEL.effusivity,
        contact_conductance=CONDUCTANCE,
    )
    return [float(value) for value in surfaces_and_flux]


# Three times of V12 have the same voxels, and so have both forms of V11.
_bar = functools.cache(bar)


def _cells(per_length: int) -> tuple[int, int]:
    copper, steel = _DIFFUSION_LENGTHS
    return round(copper * _IN_COPPER * per_length), round(steel * per_length)


def _pitch(per_length: int, end: float) -> float:
    # The diffusion length of steel at the end [s] of any run has as many voxels.
    return float(np.sqrt(STEEL.diffusivity * end)) / per_length


class _TwoBars(NamedTuple):
    """A copper bar from 100 degC and a steel one from 0 that touch."""

    copper: float
    """Temperature of the copper surface in contact [degC]."""
    steel: float
    """Temperature of the steel surface in contact [degC]."""
    energy: Energy
    """Energy ledger up to the end of the run [J]."""
    area: float
    """Area of contact [m^2]."""

    @property
    def surfaces(self) -> tuple[float, float]:
        """Both surfaces [degC]."""
        return self.copper, self.steel


def two_bars(contact: jt.Contact, per_length: int, end: float) -> _TwoBars:
    """Simulate both bars.

    Args:
        contact: between them.
        per_length: voxels in a diffusion length of steel.
        end: of the run [s].
    """
    pitch = _pitch(per_length, end)
    copper, steel = (_bar(count, pitch) for count in _cells(per_length))
    hot = ZERO_CELSIUS + 100.0
    cold = ZERO_CELSIUS
    # The explicit step is that of the first body, the faster one.
    bodies = (
        full(grid=copper.grid, material=COPPER, temperature=hot, x=-copper.length / 2),
        full(grid=steel.grid, material=STEEL, temperature=cold, x=steel.length / 2),
    )
    scene = jt.Scene(bodies, (contact,), dtype="float64")
    solution = run(scene, (end,))
    copper_surface = np.asarray(solution.of_body(0))[0]
    steel_surface = np.asarray(solution.of_body(1))[0]
    return _TwoBars(
        copper=copper.end(copper_surface, RIGHT) - ZERO_CELSIUS,
        steel=steel.end(steel_surface, LEFT) - ZERO_CELSIUS,
        energy=solution.energy,
        area=pitch**2,
    )


def _one_bar(per_length: int, end: float) -> float:
    """The same two materials in one body: the temperature between them [degC]."""
    pitch = _pitch(per_length, end)
    copper, steel = _cells(per_length)
    row = _bar(copper + steel, pitch)
    middle = float(row.grid.lattice.origin[0]) + copper * pitch
    wide = 2 * row.length
    beyond = jt.Region(lower=(middle, -wide, -wide), upper=(wide, wide, wide))

    def start_temperature(points: np.ndarray) -> np.ndarray:
        return ZERO_CELSIUS + np.where(points[:, 0] < middle, 100.0, 0.0)

    materials = jt.MaterialMap(COPPER, ((beyond, STEEL),))
    scene = single(row.grid, materials, start_temperature)
    solution = run(scene, (end,), explicit(pitch, COPPER))
    nodes = np.asarray(solution.surface_temperature)[0, row.along]
    # Half cells in series: the mean of both nodes by their conductivities.
    shared = 401.0 * nodes[copper - 1] + 15.1 * nodes[copper]
    return float(shared) / (401.0 + 15.1) - ZERO_CELSIUS


@case(
    "V11",
    title="copper at 100 degC on steel at 0, perfect contact",
    source="Carslaw and Jaeger 2.15",
    requirement="0.05 K from 5 cells per diffusion length",
    method="bars of 157 and 35 voxels, bonded, and one bar of both; explicit",
)
def _perfect() -> tuple[Check, ...]:
    names = ("two bodies, copper's side", "two bodies, steel's side", "one body")
    temperatures = [*two_bars(jt.bonded, 5, 1.0).surfaces, _one_bar(5, 1.0)]
    return values(
        expected=dict.fromkeys(names, INTERFACE),
        computed=temperatures,
        unit="degC",
        tolerance=0.05,
    )


@case(
    "V12",
    title="the same with 1000 W/(m^2 K) between them",
    source="closed form, and a Crank-Nicolson run of 8000 cells",
    requirement="0.2 % of 100 K; taken for the flux as 0.2 % of itself",
    method="20 cells per diffusion length of steel at each time; explicit",
)
def _resisting() -> Row:
    def at(per_length: int) -> Iterator[Check]:
        for end in (0.1, 1.0, 10.0):
            hot, cold, flux = resisted(end)
            bars = two_bars(jt.Contact(CONDUCTANCE), per_length, end)
            expected = {f"copper, {end:g} s": hot, f"steel, {end:g} s": cold}
            yield from values(
                expected=expected,
                computed=bars.surfaces,
                unit="degC",
                tolerance=0.002 * 100.0,
            )
            through = CONDUCTANCE * (bars.copper - bars.steel)
            yield near(f"flux, {end:g} s", through, flux, unit="W/m^2", fraction=0.002)

    # The flux follows from the surfaces, in another unit: the order is theirs.

    def error_of_surfaces(checks: Sequence[Check]) -> float:
        return largest_error(check for check in checks if check.unit == "degC")

    return converge(
        measure=at, at=(5, 10, 20), length=1, expected=2.0, error=error_of_surfaces
    )


def _two_boxes(distance: float) -> tuple[float, float]:
    """Excesses over 22 degC of two boxes of 6 cm after 0.05 s [K]."""
    stuff = jt.Material(200.0, density=2000.0, specific_heat=1.0)
    grid = jt.voxelize(jt.shapes.box((0.06, 0.06, 0.06)), 0.01)
    base = ZERO_CELSIUS + 22.0
    bodies = tuple(
        full(
            grid=grid,
            material=stuff,
            temperature=base + side * 80.0,
            x=side * distance / 2,
        )
        for side in (1.0, -1.0)
    )
    scene = jt.Scene(bodies, (jt.Contact(CONDUCTANCE),), dtype="float64")
    hot, cold = np.asarray(jt.simulate(scene, 0.05).mean_temperature)[0]
    return float(hot) - base, float(cold) - base


@case(
    "A19",
    title="two boxes in contact move toward each other, apart they stay",
    source="Genesis tests/test_sensors.py",
    requirement="by more than 1 K; within 0.05 K",
    method="boxes of 6 x 6 x 6 voxels, 1000 W/(m^2 K), 0.05 s",
)
def _boxes() -> Iterator[Check]:
    hot, cold = _two_boxes(0.06)
    for name, change in (
        ("hot box cools", 80.0 - hot),
        ("cold box warms", cold + 80.0),
    ):
        yield Check(
            name=f"touching: the {name} by",
            computed=change,
            highest=80.0,
            lowest=1.0,
            unit="K",
        )
    excesses = {
        "apart: excess of the hot box": 80.0,
        "apart: excess of the cold box": -80.0,
    }
    yield from values(
        expected=excesses, computed=_two_boxes(0.5), unit="K", tolerance=0.05
    )


CASES = (_perfect, _resisting, _boxes)
