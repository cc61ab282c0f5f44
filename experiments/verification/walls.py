"""Steady walls: V13, V18, V20a, 1fa and 1fc of A9, sol-air of V25, A11."""

import numpy as np

from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.geometry.mesh import Pose
from jaxthermo.geometry.shapes import box
from jaxthermo.integrate.run.solution import SteadySolution
from jaxthermo.integrate.steady import steady
from jaxthermo.material.material import Material
from jaxthermo.physics.boundary import Convection, FixedTemperature, HeatFlux
from jaxthermo.physics.contact.links import Contact
from jaxthermo.physics.heat_source import HeatSource
from jaxthermo.physics.radiation.emission import Surroundings
from jaxthermo.physics.radiation.source import Sun
from jaxthermo.scene.scene import Body, MaterialMap, Scene
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.selection import Region, Side
from jaxthermo.voxels.voxelize import voxelize

from ..harness.case import Case, Order, Row, Value, largest_error, result, values
from .bodies import LEFT, RIGHT, Bar, bar, between, mirrored, of_blocks


def solid(conductivity: float, emissivity: float = 0.9) -> Material:
    """A material of which a steady state needs only the conductivity."""
    return Material(conductivity, 1000.0, 1000.0, emissivity)


def solve(bodies: tuple[Body, ...], terms: tuple) -> SteadySolution:
    """The steady state in double precision."""
    return steady(Scene(bodies, terms, dtype="float64"))


def _on_bar(row: Bar, material, terms: tuple, start: float = 300.0) -> np.ndarray:
    """The surface of a bar in its steady state [K]."""
    body = Body(FullVolume(row.grid), material, temperature=start)
    return np.asarray(solve((body,), terms).surface_temperature)[0]


def _relative(name, unit, expected, computed, tolerance) -> Value:
    return Value(name, unit, expected, float(computed), tolerance * abs(expected))


COMPOSITE = {"q": 499.687851, "T1-": 99.987539, "T1+": 99.93757, "Ts": 49.968785}
"""Results of V13 as listed, with fewer digits than the tolerance needs."""


def composite() -> tuple[float, float, float, float]:
    """The same by series resistances [W/m^2], [degC]."""
    copper, contact, cover, air = 0.01 / 401.0, 1e-4, 0.02 / 0.2, 1 / 10.0
    q = 100.0 / (copper + contact + cover + air)
    return q, 100.0 - q * copper, q * (cover + air), q * air


def _measure_composite() -> Row:
    """V13: 100 degC, 10 mm of copper, a contact, 20 mm of insulation, air at 0."""
    pitch = 0.005
    copper, cover = bar(2, pitch), bar(4, pitch)
    beside = Pose(((copper.length + cover.length) / 2, 0.0, 0.0))
    cold = ZERO_CELSIUS
    bodies = (
        Body(FullVolume(copper.grid), solid(401.0), temperature=cold),
        Body(FullVolume(cover.grid), solid(0.2), temperature=cold, pose=beside),
    )
    terms = (
        FixedTemperature(cold + 100.0, on=LEFT),
        Contact(1e4),
        Convection(10.0, cold, on=Side(normal=RIGHT.normal, body=1)),
    )
    solution = solve(bodies, terms)
    one, other = (np.asarray(solution.of_body(b))[0] for b in (0, 1))
    through = float(solution.heat_rates.mechanisms["fixed_temperature"]) / pitch**2
    found = (
        through,
        copper.end(one, RIGHT) - cold,
        cover.end(other, LEFT) - cold,
        cover.end(other, RIGHT) - cold,
    )
    rows = zip(COMPOSITE, composite(), found, strict=True)
    return result(
        tuple(
            _relative(name, "W/m^2" if name == "q" else "degC", exact, now, 1e-9)
            for name, exact, now in rows
        )
    )


def _measure_source() -> Row:
    """V18: half a slab of 0.2 m; on cells the first node has what the centre has."""
    row = bar(10, 0.01)
    terms = HeatSource(1e4), Convection(20.0, 300.0, on=RIGHT)
    surface = _on_bar(row, solid(1.0), terms)
    found = [float(surface[row.along[0]]) - 300.0, row.end(surface, RIGHT) - 300.0]
    return result(values(("centre", "surface"), "K", (100.0, 50.0), found, 1e-6))


def _measure_radiating_end() -> Row:
    """V20a: the sides radiate nothing because a sleeve covers them, bonded to nothing.

    Surroundings act on all that is bare; 1e-9 W/(m^2 K) leak into the sleeve.
    """
    row = bar(4, 0.025)
    wall = 0.025 * np.array([-1.5, -0.5, 0.5, 1.5])
    around = np.ones((1, 3, 3), bool)
    around[:, 1, 1] = False
    sleeve = voxelize(of_blocks(around, np.array([-0.05, 0.05]), wall, wall), 0.025)
    bodies = (
        Body(FullVolume(row.grid), solid(55.6, 0.98), temperature=1000.0),
        Body(FullVolume(sleeve), solid(1.0), temperature=300.0),
    )
    terms = FixedTemperature(1000.0, on=LEFT), Surroundings(300.0), Contact(1e-9)
    found = np.asarray(solve(bodies, terms).of_body(0))[0]
    end = row.end(found, RIGHT)
    return result((Value("radiating end", "K", 927.00395, end, 0.1),))


def _measure_slab_with_source() -> Row:
    """A9 1fa: 300 + 1280 (1 - x^2 / 2.56); nodes of cells stand q h^2 / 8 k above."""
    found, sizes, places = [], (10, 20, 40), (0.0, 0.4, 0.8, 1.2)
    terms = HeatSource(1e4), FixedTemperature(300.0, on=RIGHT)
    for cells in sizes:
        row = bar(cells, 1.6 / cells)
        surface = _on_bar(row, solid(10.0), terms)
        at = between(*mirrored(row.depth, surface[row.along]), places)
        exact = (300.0 + 1280.0 * (1.0 - x * x / 2.56) for x in places)
        found.append(
            tuple(
                _relative(f"T({x:g} m)", "K", full, now, 5e-4)
                for x, full, now in zip(places, exact, at, strict=True)
            )
        )
    errors = tuple(map(largest_error, found))
    order = Order(tuple(1.6 / n for n in sizes), errors, expected=2.0)
    return result(found[-1], order)


def _measure_two_metals() -> Row:
    """A9 1fc: the interface of 40 cm of copper and 40 cm of iron, 600 and 0 K."""
    row = bar(8, 0.1)
    beyond = Region(lower=(0.0, -1.0, -1.0), upper=(1.0, 1.0, 1.0))
    metals = MaterialMap(
        Material(401.0, 1.0, 3.4392e6), ((beyond, Material(80.2, 1.0, 3.5179e6)),)
    )
    terms = FixedTemperature(600.0, on=LEFT), FixedTemperature(0.0, on=RIGHT)
    nodes = _on_bar(row, metals, terms)[row.along]
    interface = (401.0 * nodes[3] + 80.2 * nodes[4]) / (401.0 + 80.2)
    return result((_relative("interface", "K", 500.0, interface, 1e-9),))


def _measure_sol_air() -> Row:
    """V25: walls that let nothing through stand at the sol-air temperature."""
    row = bar(3, 0.01)
    painted = Material(1.0, 1000.0, 1000.0, 0.9, absorptivity=0.9)
    air = Convection(17.0, ZERO_CELSIUS + 35.0, on=RIGHT)
    sun = Sun((-1.0, 0.0, 0.0), 1000.0)
    to_sky = HeatFlux(-0.9 * 63.0, on=RIGHT)
    found = [
        row.end(_on_bar(row, painted, terms), RIGHT) - ZERO_CELSIUS
        for terms in ((air, sun), (air, sun, to_sky))
    ]
    names = ("wall", "with 0.9 x 63 W/m^2 to the sky")
    return result(values(names, "degC", (87.941176, 84.605882), found, 1e-6))


PITCH = 2.0 / 16
"""Edge of one of 16 x 8 x 1 voxels [m]."""
SLAB_FLUX = 1.0 / PITCH
"""Through x = 2: one watt in all [W/m^2]."""
SLAB_COLD = 300.0
"""At x = 0, for 0 there [K]."""
FORWARD = {
    0.05: 14223.80,
    0.1: 8004.001,
    0.2: 1779.359,
    0.4: 246.3964,
    0.6: 73.80618,
    0.8: 31.22024,
    0.95: 18.65851,
}
"""Compliance by density."""
WITH_SOURCE = {
    0.1: 127.3077,
    0.25: 127.6039,
    0.5: 128.0975,
    1.0: 129.0848,
    2.0: 131.0594,
    4.0: 135.0086,
}
"""Compliance by the source's amplitude, at density 0.5."""
ROUNDING = 1e-6
"""Relative: half a unit of the seventh digit, and single precision."""


def _conductivity(density: float) -> float:
    return 1e-3 + 0.999 * density**3


def _slab():
    return voxelize(box((2.0, 1.0, PITCH)), PITCH)


def _compliance(grid, conductivity: float, sources: tuple = ()) -> float:
    """The flux times the temperature where it enters [W K]."""
    body = Body(FullVolume(grid), solid(conductivity), temperature=SLAB_COLD)
    terms = (
        FixedTemperature(SLAB_COLD, on=LEFT),
        HeatFlux(SLAB_FLUX, on=RIGHT),
        *sources,
    )
    surface = np.asarray(solve((body,), terms).surface_temperature)[0]
    right = grid.fragment_normal[:, 0] > 0.9
    return float(SLAB_FLUX * grid.fragment_area[right] @ (surface[right] - SLAB_COLD))


def _gaussian(grid, amplitude: float) -> tuple[HeatSource, ...]:
    """Sources a exp(-r^2 / (2 0.2^2)) around the middle, one for each slice across x.

    The compliance takes no notice of where in a slice the heat is made.
    """
    x, y = (PITCH * (np.arange(n) + 0.5) for n in grid.lattice.shape[:2])
    square = (x[:, None] - 1.0) ** 2 + (y[None] - 0.5) ** 2
    mean = (amplitude * np.exp(-square / (2 * 0.2**2))).mean(axis=1)
    left = float(grid.origin[0])
    return tuple(
        HeatSource(
            float(density),
            Region(
                lower=(left + i * PITCH, -9.0, -9.0),
                upper=(left + (i + 1) * PITCH, 9.0, 9.0),
            ),
        )
        for i, density in enumerate(mean)
    )


def _measure_forward() -> Row:
    """Seven densities."""
    grid = _slab()
    return result(
        tuple(
            Value(
                f"compliance, density {density:g}",
                "W K",
                listed,
                _compliance(grid, _conductivity(density)),
                ROUNDING * listed,
            )
            for density, listed in FORWARD.items()
        )
    )


def _measure_slab_source() -> Row:
    """Six amplitudes of a source inside."""
    grid = _slab()
    k = _conductivity(0.5)
    return result(
        tuple(
            Value(
                f"compliance, amplitude {amplitude:g}",
                "W K",
                listed,
                _compliance(grid, k, _gaussian(grid, amplitude)),
                ROUNDING * listed,
            )
            for amplitude, listed in WITH_SOURCE.items()
        )
    )


CASES = (
    Case(
        "V13",
        "composite wall with a contact resistance",
        "series resistances",
        "1e-9 relative",
        "two bodies of 2 and 4 voxels; steady",
        _measure_composite,
    ),
    Case(
        "V18",
        "slab with a heat source, in a fluid",
        "Incropera 3.47",
        "1e-6",
        "half of it, 10 voxels; steady",
        _measure_source,
    ),
    Case(
        "V20a",
        "NAFEMS T2: a bar with a radiating end",
        "NAFEMS Standard Benchmarks (927.0 K)",
        "0.1 K",
        "4 voxels in an insulating sleeve; steady",
        _measure_radiating_end,
    ),
    Case(
        "A9 1fa",
        "slab with a heat source, one face at a prescribed temperature",
        "TMAP8 ver-1fa",
        "0.05 %, what the peer is off by",
        "40 voxels of 40 mm; steady",
        _measure_slab_with_source,
    ),
    Case(
        "A9 1fc",
        "copper and iron between 600 and 0 K",
        "TMAP8 ver-1fc",
        "none stated; 1e-9 relative as for V13",
        "one body of 4 and 4 voxels; steady",
        _measure_two_metals,
    ),
    Case(
        "V25, sol-air",
        "insulated walls in sun and air",
        "ASHRAE Handbook, Fundamentals",
        "1e-6",
        "3 voxels; steady; expected to 6 decimals",
        _measure_sol_air,
    ),
    Case(
        "A11",
        "Mosaic thermal-mesh: a uniform slab by its density",
        "mosaic, thermal_mesh forward_agreement (single precision, 7 digits)",
        "none stated; 1e-6 relative, its digits",
        "16 x 8 x 1 voxels; steady",
        _measure_forward,
    ),
    Case(
        "A11, source",
        "the same with a Gaussian source inside",
        "mosaic, thermal_mesh (single precision, 7 digits)",
        "none stated; 1e-6 relative, its digits",
        "16 x 8 x 1 voxels, a source for each of 16 slices; steady",
        _measure_slab_source,
    ),
)
