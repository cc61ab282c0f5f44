"""Bodies that touch, in time: V11, V12, A19."""

import functools

import numpy as np

from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.geometry.mesh import Pose
from jaxthermo.geometry.shapes import box
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.material.material import Material
from jaxthermo.physics.contact.links import Contact, bonded
from jaxthermo.scene.scene import Body, MaterialMap, Scene
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.selection import Region
from jaxthermo.voxels.voxelize import voxelize

from ..harness.case import Bound, Case, Order, Row, Value, result, values
from .bodies import FOURIER, LEFT, RIGHT, bar


COPPER = Material(401.0, density=8933.0, specific_heat=385.0)
STEEL = Material(15.1, density=8055.0, specific_heat=480.0)
DIFFUSION_LENGTHS = (6.1, 7.0)
"""Lengths of the copper and steel bars: the far ends stay as they were."""
IN_COPPER = float((COPPER.diffusivity / STEEL.diffusivity) ** 0.5)
"""Diffusion lengths of copper, in those of steel."""

INTERFACE = 82.93590583
HELD_APART = {
    0.1: (99.080103, 4.470938, 94609.165),
    1.0: (97.340851, 12.924149, 84416.703),
    10.0: (93.450708, 31.831253, 61619.455),
}
"""By time [s]: both surfaces [degC] and the flux [W/m^2] at 1000 W/(m^2 K)."""
CONDUCTANCE = 1000.0

_bar = functools.cache(bar)


def _cells(per_length: int) -> tuple[int, int]:
    copper, steel = DIFFUSION_LENGTHS
    return round(copper * IN_COPPER * per_length), round(steel * per_length)


def _two_bars(contact: Contact, per_length: int, end: float) -> tuple[float, float]:
    """Surfaces of a copper bar at 100 degC and a steel one at 0 that touch [degC].

    Args:
        contact: between them.
        per_length: cells in a diffusion length of steel at the end.
        end: time of the result [s].
    """
    pitch = float(np.sqrt(STEEL.diffusivity * end)) / per_length
    rows = [_bar(count, pitch) for count in _cells(per_length)]
    bodies = tuple(
        Body(
            FullVolume(row.grid),
            material,
            temperature=ZERO_CELSIUS + start,
            pose=Pose((side * row.length / 2, 0.0, 0.0)),
        )
        for row, material, start, side in zip(
            rows, (COPPER, STEEL), (100.0, 0.0), (-1.0, 1.0), strict=True
        )
    )
    dt = FOURIER * pitch**2 / float(COPPER.diffusivity)
    scene = Scene(bodies, (contact,), dtype="float64")
    solution = simulate(scene, end, solver=ForwardEuler(dt=dt))
    one, other = (np.asarray(solution.of_body(b))[0] for b in (0, 1))
    return (
        rows[0].end(one, RIGHT) - ZERO_CELSIUS,
        rows[1].end(other, LEFT) - ZERO_CELSIUS,
    )


def _one_bar(per_length: int, end: float) -> float:
    """The same two materials in one body: the temperature between them [degC]."""
    pitch = float(np.sqrt(STEEL.diffusivity * end)) / per_length
    copper, steel = _cells(per_length)
    row = _bar(copper + steel, pitch)
    middle = float(row.grid.origin[0]) + copper * pitch
    wide = 2 * row.length
    beyond = Region(lower=(middle, -wide, -wide), upper=(wide, wide, wide))
    body = Body(
        FullVolume(row.grid),
        MaterialMap(COPPER, ((beyond, STEEL),)),
        temperature=lambda p: ZERO_CELSIUS + np.where(p[:, 0] < middle, 100.0, 0.0),
    )
    dt = FOURIER * pitch**2 / float(COPPER.diffusivity)
    scene = Scene((body,), dtype="float64")
    solution = simulate(scene, end, solver=ForwardEuler(dt=dt))
    nodes = np.asarray(solution.surface_temperature)[0, row.along]
    shared = 401.0 * nodes[copper - 1] + 15.1 * nodes[copper]
    return float(shared) / (401.0 + 15.1) - ZERO_CELSIUS


def _measure_perfect() -> Row:
    """V11 at 5 cells per diffusion length of steel."""
    one, other = _two_bars(bonded, 5, 1.0)
    return result(
        values(
            ("two bodies, copper's side", "two bodies, steel's side", "one body"),
            "degC",
            (INTERFACE,) * 3,
            [one, other, _one_bar(5, 1.0)],
            0.05,
        )
    )


def _measure_resisting() -> Row:
    """V12, at each time on voxels that are as fine beside the diffusion length."""
    sizes, found = (5, 10, 20), []
    for per_length in sizes:
        checks, worst = [], 0.0
        for end, (hot, cold, flux) in HELD_APART.items():
            one, other = _two_bars(Contact(CONDUCTANCE), per_length, end)
            surfaces = values(
                (f"copper, {end:g} s", f"steel, {end:g} s"),
                "degC",
                (hot, cold),
                [one, other],
                0.002 * 100.0,
            )
            through = CONDUCTANCE * (one - other)
            name = f"flux, {end:g} s"
            checks += [
                *surfaces, Value(name, "W/m^2", flux, through, 0.002 * flux)
            ]  # fmt: skip
            worst = max(worst, *(abs(value.error) for value in surfaces))
        found.append((tuple(checks), worst))
    errors = tuple(worst for _, worst in found)
    order = Order(tuple(1 / n for n in sizes), errors, expected=2.0)
    return result(found[-1][0], order)


def _two_boxes(distance: float) -> tuple[float, float]:
    """Excesses over 22 degC of two boxes of 6 cm after 0.05 s [K]."""
    stuff = Material(200.0, density=2000.0, specific_heat=1.0)
    grid = voxelize(box((0.06, 0.06, 0.06)), 0.01)
    bodies = tuple(
        Body(
            FullVolume(grid),
            stuff,
            temperature=ZERO_CELSIUS + 22.0 + side * 80.0,
            pose=Pose((side * distance / 2, 0.0, 0.0)),
        )
        for side in (1.0, -1.0)
    )
    scene = Scene(bodies, (Contact(CONDUCTANCE),), dtype="float64")
    hot, cold = np.asarray(simulate(scene, 0.05).mean_temperature)[0]
    base = ZERO_CELSIUS + 22.0
    return float(hot) - base, float(cold) - base


def _measure_boxes() -> Row:
    """A19: inequalities only."""
    (hot, cold), far = _two_boxes(0.06), _two_boxes(0.5)
    return result(
        (
            Bound("touching: the hot box cools by", 80.0 - hot, 80.0, 1.0, "K"),
            Bound("touching: the cold box warms by", cold + 80.0, 80.0, 1.0, "K"),
            *values(
                ("apart: excess of the hot box", "apart: excess of the cold box"),
                "K",
                (80.0, -80.0),
                list(far),
                0.05,
            ),
        )
    )


CASES = (
    Case(
        "V11",
        "copper at 100 degC on steel at 0, perfect contact",
        "Carslaw and Jaeger 2.15",
        "0.05 K from 5 cells per diffusion length",
        "bars of 157 and 35 voxels, bonded, and one bar of both; explicit",
        _measure_perfect,
    ),
    Case(
        "V12",
        "the same with 1000 W/(m^2 K) between them",
        "closed form, and a Crank-Nicolson run of 8000 cells",
        "0.2 % of 100 K; taken for the flux as 0.2 % of itself",
        "20 cells per diffusion length of steel at each time; explicit",
        _measure_resisting,
    ),
    Case(
        "A19",
        "two boxes in contact move toward each other, apart they stay",
        "Genesis tests/test_sensors.py",
        "by more than 1 K; within 0.05 K",
        "boxes of 6 x 6 x 6 voxels, 1000 W/(m^2 K), 0.05 s",
        _measure_boxes,
    ),
)
