"""Steady walls: V13, V18, V20a, 1fa and 1fc of A9, sol-air of V25, A11."""

from collections.abc import Iterator

import numpy as np

import jaxthermo as jt
from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.reference.radiation import sol_air_temperature

from ..harness.case import Check, Row, case, converge, near, values
from ..harness.scenes import full, single
from .bodies import LEFT, RIGHT, Bar, bar, between, conductor, mirrored, of_blocks


def _on_bar(row: Bar, material, *terms) -> np.ndarray:
    """The surface of a bar in its steady state [K]."""
    solution = jt.steady(single(row.grid, material, 300.0, *terms))
    return np.asarray(solution.surface_temperature)[0]


def _composite() -> dict[str, float]:
    """Results of V13 by series resistances [W/m^2], [degC]."""
    # The source lists them with fewer digits than the tolerance needs.
    copper = 0.01 / 401.0
    contact = 1e-4
    cover = 0.02 / 0.2
    air = 1 / 10.0
    q = 100.0 / (copper + contact + cover + air)
    return {
        "q": q,
        "T1-": 100.0 - q * copper,
        "T1+": q * (cover + air),
        "Ts": q * air,
    }


@case(
    "V13",
    title="composite wall with a contact resistance",
    source="series resistances",
    requirement="1e-9 relative",
    method="two bodies of 2 and 4 voxels; steady",
)
def _wall() -> Iterator[Check]:
    # 100 degC, 10 mm of copper, a contact, 20 mm of insulation, air at 0.
    pitch = 0.005
    cold = ZERO_CELSIUS
    copper = bar(2, pitch)
    cover = bar(4, pitch)
    bodies = (
        full(copper.grid, conductor(401.0), cold),
        full(
            grid=cover.grid,
            material=conductor(0.2),
            temperature=cold,
            x=(copper.length + cover.length) / 2,
        ),
    )
    terms = (
        jt.FixedTemperature(cold + 100.0, on=LEFT),
        jt.Contact(1e4),
        jt.Convection(10.0, cold, on=jt.Side(normal=RIGHT.normal, body=1)),
    )
    solution = jt.steady(jt.Scene(bodies, terms, dtype="float64"))
    copper_surface = np.asarray(solution.of_body(0))[0]
    cover_surface = np.asarray(solution.of_body(1))[0]
    heat = float(solution.heat_rates.mechanisms["fixed_temperature"])
    temperatures = np.array(
        [
            copper.end(copper_surface, RIGHT),
            cover.end(cover_surface, LEFT),
            cover.end(cover_surface, RIGHT),
        ]
    )
    exact = _composite()
    flux = {"q": exact.pop("q")}
    yield from values(
        expected=flux, computed=[heat / pitch**2], unit="W/m^2", fraction=1e-9
    )
    yield from values(
        expected=exact, computed=temperatures - cold, unit="degC", fraction=1e-9
    )


@case(
    "V18",
    title="slab with a heat source, in a fluid",
    source="Incropera 3.47",
    requirement="1e-6",
    method="half of it, 10 voxels; steady",
)
def _source() -> tuple[Check, ...]:
    row = bar(10, 0.01)
    air = jt.Convection(20.0, 300.0, on=RIGHT)
    surface = _on_bar(row, conductor(1.0), jt.HeatSource(1e4), air)
    # On cells the first node has what the centre has.
    centre = float(surface[row.along[0]])
    excesses = [centre - 300.0, row.end(surface, RIGHT) - 300.0]
    return values(
        expected={"centre": 100.0, "surface": 50.0},
        computed=excesses,
        unit="K",
        tolerance=1e-6,
    )


@case(
    "V20a",
    title="NAFEMS T2: a bar with a radiating end",
    source="NAFEMS Standard Benchmarks (927.0 K)",
    requirement="0.1 K",
    method="4 voxels in an insulating sleeve; steady",
)
def _radiating_end() -> tuple[Check, ...]:
    row = bar(4, 0.025)
    # Surroundings act on every bare surface: a sleeve without contact covers the
    # sides. 1e-9 W/(m^2 K) leak into the sleeve, so that it has a steady state.
    wall = 0.025 * np.array([-1.5, -0.5, 0.5, 1.5])
    around = np.ones((1, 3, 3), bool)
    around[:, 1, 1] = False
    mesh = of_blocks(around, np.array([-0.05, 0.05]), wall, wall)
    bodies = (
        full(row.grid, conductor(55.6, 0.98), 1000.0),
        full(jt.voxelize(mesh, 0.025), conductor(1.0), 300.0),
    )
    hot = jt.FixedTemperature(1000.0, on=LEFT)
    terms = (hot, jt.Surroundings(300.0), jt.Contact(1e-9))
    solution = jt.steady(jt.Scene(bodies, terms, dtype="float64"))
    end = row.end(np.asarray(solution.of_body(0))[0], RIGHT)
    return (near("radiating end", end, 927.00395, unit="K", tolerance=0.1),)


@case(
    "A9 1fa",
    title="slab with a heat source, one face at a prescribed temperature",
    source="TMAP8 ver-1fa",
    requirement="0.05 %, what the peer is off by",
    method="40 voxels of 40 mm; steady",
)
def _slab_with_source() -> Row:
    places = (0.0, 0.4, 0.8, 1.2)
    exact = {f"T({x:g} m)": 300.0 + 1280.0 * (1.0 - x * x / 2.56) for x in places}

    def at(cells: int) -> tuple[Check, ...]:
        row = bar(cells, 1.6 / cells)
        cold = jt.FixedTemperature(300.0, on=RIGHT)
        surface = _on_bar(row, conductor(10.0), jt.HeatSource(1e4), cold)
        depth, profile = mirrored(row.depth, surface[row.along])
        temperatures = between(depth, profile, places)
        return values(expected=exact, computed=temperatures, unit="K", fraction=5e-4)

    # Nodes of cells stand q h^2 / 8 k above the parabola: of second order.
    return converge(measure=at, at=(10, 20, 40), length=1.6, expected=2.0)


@case(
    "A9 1fc",
    title="copper and iron between 600 and 0 K",
    source="TMAP8 ver-1fc",
    requirement="none stated; 1e-9 relative as for V13",
    method="one body of 4 and 4 voxels; steady",
)
def _two_metals() -> tuple[Check, ...]:
    # 40 cm of each.
    row = bar(8, 0.1)
    beyond = jt.Region(lower=(0.0, -1.0, -1.0), upper=(1.0, 1.0, 1.0))
    iron = jt.Material(80.2, 1.0, 3.5179e6)
    copper = jt.Material(401.0, 1.0, 3.4392e6)
    metals = jt.MaterialMap(copper, ((beyond, iron),))
    ends = map(jt.FixedTemperature, (600.0, 0.0), (LEFT, RIGHT))
    nodes = _on_bar(row, metals, *ends)[row.along]
    # Half cells in series: the mean of both nodes by their conductivities.
    interface = (401.0 * nodes[3] + 80.2 * nodes[4]) / (401.0 + 80.2)
    return (near("interface", interface, 500.0, unit="K", fraction=1e-9),)


@case(
    "V25, sol-air",
    title="insulated walls in sun and air",
    source="ASHRAE Handbook, Fundamentals",
    requirement="1e-6",
    method="3 voxels; steady",
)
def _sol_air() -> tuple[Check, ...]:
    # Walls that let nothing through stand at the sol-air temperature.
    row = bar(3, 0.01)
    painted = jt.Material(1.0, 1000.0, 1000.0, 0.9, absorptivity=0.9)
    air = jt.Convection(17.0, ZERO_CELSIUS + 35.0, on=RIGHT)
    sun = jt.Sun((-1.0, 0.0, 0.0), 1000.0)
    to_sky = jt.HeatFlux(-0.9 * 63.0, on=RIGHT)
    temperatures = [
        row.end(_on_bar(row, painted, *terms), RIGHT) - ZERO_CELSIUS
        for terms in ((air, sun), (air, sun, to_sky))
    ]
    losses = {"wall": 0.0, "with 0.9 x 63 W/m^2 to the sky": 0.9 * 63.0}
    exact = {
        name: sol_air_temperature(
            35.0, absorbed=900.0, heat_transfer_coefficient=17.0, to_sky=loss
        )
        for name, loss in losses.items()
    }
    return values(expected=exact, computed=temperatures, unit="degC", tolerance=1e-6)


# Of 16 x 8 x 1 voxels [m]; one watt in all goes in through x = 2 m [W/m^2].
_PITCH = 2.0 / 16
_SLAB_FLUX = 1.0 / _PITCH
# At x = 0, where the source has 0 [K].
_SLAB_COLD = 300.0
# Compliance by density.
_FORWARD = {
    0.05: 14223.80,
    0.1: 8004.001,
    0.2: 1779.359,
    0.4: 246.3964,
    0.6: 73.80618,
    0.8: 31.22024,
    0.95: 18.65851,
}
# Compliance by the source's amplitude, at density 0.5.
_WITH_SOURCE = {
    0.1: 127.3077,
    0.25: 127.6039,
    0.5: 128.0975,
    1.0: 129.0848,
    2.0: 131.0594,
    4.0: 135.0086,
}
# Relative: half a unit of the seventh digit, and single precision.
_ROUNDING = 1e-6


def _slab() -> jt.VoxelGrid:
    return jt.voxelize(jt.shapes.box((2.0, 1.0, _PITCH)), _PITCH)


def _compliance(grid: jt.VoxelGrid, density: float, *sources) -> float:
    """The flux times the temperature where it enters [W K]."""
    # Penalized as in the source: cubic in the density, with a floor.
    material = conductor(1e-3 + 0.999 * density**3)
    cold = jt.FixedTemperature(_SLAB_COLD, on=LEFT)
    flux = jt.HeatFlux(_SLAB_FLUX, on=RIGHT)
    solution = jt.steady(single(grid, material, _SLAB_COLD, cold, flux, *sources))
    surface = np.asarray(solution.surface_temperature)[0]
    right = grid.fragment_normal[:, 0] > 0.9
    excess = surface[right] - _SLAB_COLD
    return float(_SLAB_FLUX * grid.fragment_area[right] @ excess)


def _gaussian(grid: jt.VoxelGrid, amplitude: float) -> Iterator[jt.HeatSource]:
    """Sources a exp(-r^2 / (2 0.2^2)) around the middle, one a slice across x."""
    # The compliance does not depend on where in a slice the heat is released.
    wide, deep, _ = grid.lattice.shape
    x = _PITCH * (np.arange(wide) + 0.5)
    y = _PITCH * (np.arange(deep) + 0.5)
    square = (x[:, None] - 1.0) ** 2 + (y[None] - 0.5) ** 2
    gaussian = amplitude * np.exp(-square / (2 * 0.2**2))
    mean = gaussian.mean(axis=1)
    left = float(grid.origin[0])
    for i, density in enumerate(mean):
        lower = (left + i * _PITCH, -9.0, -9.0)
        upper = (left + (i + 1) * _PITCH, 9.0, 9.0)
        yield jt.HeatSource(float(density), jt.Region(lower=lower, upper=upper))


@case(
    "A11",
    title="Mosaic thermal-mesh: a uniform slab by its density",
    source="mosaic, thermal_mesh forward_agreement (single precision, 7 digits)",
    requirement="none stated; 1e-6 relative, its digits",
    method="16 x 8 x 1 voxels; steady",
)
def _forward() -> tuple[Check, ...]:
    grid = _slab()
    compliances = [_compliance(grid, density) for density in _FORWARD]
    listed = {f"compliance, density {x:g}": value for x, value in _FORWARD.items()}
    return values(expected=listed, computed=compliances, unit="W K", fraction=_ROUNDING)


@case(
    "A11, source",
    title="the same with a Gaussian source inside",
    source="mosaic, thermal_mesh (single precision, 7 digits)",
    requirement="none stated; 1e-6 relative, its digits",
    method="16 x 8 x 1 voxels, a source for each of 16 slices; steady",
)
def _forward_with_source() -> tuple[Check, ...]:
    grid = _slab()
    compliances = [
        _compliance(grid, 0.5, *_gaussian(grid, amplitude))
        for amplitude in _WITH_SOURCE
    ]
    listed = {
        f"compliance, amplitude {x:g}": value for x, value in _WITH_SOURCE.items()
    }
    return values(expected=listed, computed=compliances, unit="W K", fraction=_ROUNDING)


CASES = (
    _wall,
    _source,
    _radiating_end,
    _slab_with_source,
    _two_metals,
    _sol_air,
    _forward,
    _forward_with_source,
)
