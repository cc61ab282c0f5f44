"""Numbers that decide between statements of the thesis' text that do not fit."""

from functools import cache

import jax.numpy as jnp
import numpy as np
from scipy import constants

import jaxthermo as jt
from jaxthermo.constants import SOLAR_TEMPERATURE, STEFAN_BOLTZMANN
from jaxthermo.flow.channel import MAX_MACH
from jaxthermo.geometry.shapes import box
from jaxthermo.material.table import thesis_material
from jaxthermo.physics.convection.air import conductivity, kinematic_viscosity, prandtl
from jaxthermo.physics.convection.nusselt import churchill_bernstein

from .convection_numbers import FAST, measure_local
from .counting import TABLE, TIMES


# Of the thesis: flux on its cubes [W/m^2], and temperature around it [K].
_FLUX, _AROUND = 31.15, 300.0
# Cylinder of the comparisons [m], and wind, the fastest of section 6.2 [m/s].
_DIAMETER, _WIND = 0.1, 1.0
# Nominal radius of the sun (IAU 2015) [m].
_SUN_RADIUS = 6.957e8
# Mass of a mole of copper [kg].
_COPPER_MOLE = 0.063546


def sun_at_the_earth() -> float:
    """Irradiance of a black sun of the thesis' 5800 K, above the air [W/m^2]."""
    distance = _SUN_RADIUS / constants.au
    return STEFAN_BOLTZMANN * SOLAR_TEMPERATURE**4 * distance**2


def emission() -> dict[str, float]:
    """Emission of a black body as warm as its surroundings, by equation 1 [W/m^2].

    Besides what it loses, both ways counted, per kelvin of excess, beside the wind's.
    """
    air = jnp.asarray(_AROUND)
    reynolds = _WIND * _DIAMETER / kinematic_viscosity(air)
    number = churchill_bernstein(reynolds, prandtl(air))
    run = jt.simulate(
        jt.Scene((_cube(),), (jt.Surroundings(_AROUND),), dtype="float64"),
        1.0,
        solver=jt.ForwardEuler(dt=1.0),
    )
    return {
        "by_equation_1": STEFAN_BOLTZMANN * _AROUND**4,
        "with_surroundings": float(run.energy.stored_J[0]),
        "radiation_per_kelvin": 4 * STEFAN_BOLTZMANN * _AROUND**3,
        "wind_per_kelvin": float(number * conductivity(air)) / _DIAMETER,
    }


def _cube() -> jt.Body:
    cube = jt.FullVolume(jt.voxelize(box((1.0, 1.0, 1.0)), 1.0))
    return jt.Body(cube, thesis_material("iron"), temperature=_AROUND)


def thin_sheet() -> dict[str, float]:
    """Warming of 1 m² of aluminium by the flux of table 5.1 [K/s]: cube and 1 mm."""
    heat = float(thesis_material("aluminium").volumetric_heat_capacity)
    return {"cube": _FLUX / heat, "sheet_of_1_mm": _FLUX / heat / 1e-3}


def consistency_of_5_to_8() -> float:
    """Largest relative difference of equation 8 from 5 with 7, of random numbers."""
    k, excess, number, width = np.random.default_rng(0).uniform(0.1, 10, (4, 1000))
    eighth = k * excess * number / width
    fifth = (number * k / width) * excess
    return float(np.abs(eighth / fifth - 1).max())


@cache
def transition() -> dict[str, float]:
    """Minima of the local number over Re, and the winds that figure 5.6 needs."""
    rows = measure_local()
    minima = {row["Re"]: len(row["minima_deg"]) for row in rows}
    viscosity = float(kinematic_viscosity(jnp.asarray(_AROUND)))
    return {
        "highest": FAST[-1],
        "minima_at_the_highest": minima[FAST[-1]],
        "two_minima_from": min(re for re, count in minima.items() if count == 2),
        "lowest_wind_m_s": FAST[0] * viscosity / _DIAMETER,
        "reynolds_of_6_2": _WIND * _DIAMETER / viscosity,
    }


def compressibility() -> float:
    """Square of the largest Mach number of our lattice: its error by compression."""
    return MAX_MACH**2


def atoms_in_a_voxel(width: float) -> float:
    """Atoms of copper in a voxel of some width [m]."""
    density = float(thesis_material("copper").density)
    return density * width**3 / _COPPER_MOLE * constants.N_A


def element_weights() -> dict[str, float]:
    """Coupling of a node to face, edge and corner neighbours by trilinear elements.

    Over that of equation 4 to a face neighbour, for cubes.
    """
    # One dimension: stiffness and mass of linear elements, for steps of 0 and 1.
    stiffness, mass = np.array([2.0, -1.0]), np.array([4.0, 1.0]) / 6
    weight = lambda *steps: (
        -sum(
            stiffness[steps[a]] * mass[steps[(a + 1) % 3]] * mass[steps[(a + 2) % 3]]
            for a in range(3)
        )
    )
    ways = {"face": (1, 0, 0), "edge": (1, 1, 0), "corner": (1, 1, 1)}
    return {name: float(weight(*steps)) for name, steps in ways.items()}


def growth_of_conductance() -> float:
    """Conductance within a level of irregular cells over that in the one above [-].

    At one conductivity: by size alone.
    """
    cube = jt.voxelize(box((1.0, 1.0, 1.0)), 1.0 / 32)
    structure = jt.IrregularMultiLevel(cube)
    links, level = structure.links(), structure.nodes().level
    same = level[links.src] == level[links.dst]
    own = (links.area / (links.distance_src + links.distance_dst))[same]
    middle = [np.median(own[level[links.src][same] == n]) for n in (1, 2)]
    return float(middle[1] / middle[0])


def table_6_1() -> dict[str, float]:
    """Numbers that follow from the thesis' table 6.1 alone."""
    side = TABLE["full_volume"] ** (1 / 3)
    own = {f"{name}_ns": 1e9 * TIMES[name] / TABLE[name] for name in TABLE}
    return {
        "side_of_a_cube_as_large": side,
        "n2_log2_n": side**2 * np.log2(side),
        "irregular_over_n2_log2_n": TABLE["irregular"] / (side**2 * np.log2(side)),
        "fewer_voxels": TABLE["full_volume"] / TABLE["irregular"],
        "times_faster": TIMES["full_volume"] / TIMES["irregular"],
        **own,
    }
