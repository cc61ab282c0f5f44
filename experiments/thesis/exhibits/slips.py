"""Numbers that decide between statements of the thesis' text that do not fit."""

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
from jaxthermo.reference.radiation import solar_irradiance

from ..exhibit import Finding, Verdict, exhibit
from ..heated import END
from ..nusselt import FAST, measure_knots
from ..table_6_1 import FULL, IRREGULAR, TABLE_TIMES, TABLE_VOXELS


# Of the thesis: flux on its cubes [W/m^2], and temperature around it [K].
_FLUX = 31.15
_AROUND = 300.0
# Cylinder of the comparisons [m], and wind, the fastest of section 6.2 [m/s].
_DIAMETER = 0.1
_WIND = 1.0
# Mass of a mole of copper [kg].
_COPPER_MOLE = 0.063546
# Height of a voxel of table 6.1 in a statue of half a metre [m].
_VOXEL = 0.5 / 550


@exhibit("text-slips", "7, and others")
def _slips_of_the_text(_: bool) -> Finding:
    """Compute the numbers that decide between statements."""
    return Finding(
        Verdict.CONTRADICTED,
        {
            "emission": _emission(),
            "table_6_1": _table_6_1(),
            "transition": _transition(),
            "thin_sheet": _thin_sheet(),
            "element": _element_weights(),
            "atoms": _atoms_in_a_voxel(_VOXEL),
            # The error by compression is the square of the largest Mach number.
            "compressibility": MAX_MACH**2,
            # A black sun of the thesis' 5800 K, above the air [W/m^2].
            "sun": solar_irradiance(SOLAR_TEMPERATURE),
            "growth_of_conductance": _growth_of_conductance(),
            "consistency": _consistency_of_5_to_8(),
            "iterations_s": [END, END * 4000 / 3600],
        },
    )


def _emission() -> dict[str, float]:
    """Emission of a black body as warm as its surroundings, by equation 1 [W/m^2].

    Also what it loses per kelvin of excess by radiation both ways, and by wind.
    """
    air = jnp.asarray(_AROUND)
    reynolds = _WIND * _DIAMETER / kinematic_viscosity(air)
    number = churchill_bernstein(reynolds, prandtl(air))
    cube = jt.FullVolume(jt.voxelize(box((1.0, 1.0, 1.0)), 1.0))
    body = jt.Body(cube, thesis_material("iron"), temperature=_AROUND)
    scene = jt.Scene((body,), (jt.Surroundings(_AROUND),), dtype="float64")
    run = jt.simulate(scene, 1.0, solver=jt.ForwardEuler(dt=1.0))
    return {
        "by_equation_1": STEFAN_BOLTZMANN * _AROUND**4,
        "with_surroundings": abs(float(run.energy.stored_J[0])),
        "radiation_per_kelvin": 4 * STEFAN_BOLTZMANN * _AROUND**3,
        "wind_per_kelvin": float(number * conductivity(air)) / _DIAMETER,
    }


def _thin_sheet() -> dict[str, float]:
    """Warming of 1 m² of aluminium by the flux of table 5.1 [K/s]: cube and 1 mm."""
    heat = float(thesis_material("aluminium").volumetric_heat_capacity)
    return {"cube": _FLUX / heat, "sheet_of_1_mm": _FLUX / heat / 1e-3}


def _consistency_of_5_to_8() -> float:
    """Largest relative difference of equation 8 from 5 with 7, of random numbers."""
    random = np.random.default_rng(0)
    k, excess, number, width = random.uniform(0.1, 10, (4, 1000))
    eighth = k * excess * number / width
    fifth = (number * k / width) * excess
    return float(np.abs(eighth / fifth - 1).max())


def _transition() -> dict[str, float]:
    """Minima of the local number over Re, and the winds that figure 5.6 needs."""
    minima = {row["Re"]: len(row["minima_deg"]) for row in measure_knots()}
    viscosity = float(kinematic_viscosity(jnp.asarray(_AROUND)))
    return {
        "highest": FAST[-1],
        "minima_at_the_highest": minima[FAST[-1]],
        "two_minima_from": min(re for re, count in minima.items() if count == 2),
        "lowest_wind_m_s": FAST[0] * viscosity / _DIAMETER,
        "reynolds_of_6_2": _WIND * _DIAMETER / viscosity,
    }


def _atoms_in_a_voxel(width: float) -> float:
    """Atoms of copper in a voxel of some width [m]."""
    density = float(thesis_material("copper").density)
    return density * width**3 / _COPPER_MOLE * constants.N_A


def _element_weights() -> dict[str, float]:
    """Coupling of a node to face, edge and corner neighbours by trilinear elements.

    Over that of equation 4 to a face neighbour, for cubes.
    """
    # One dimension: stiffness and mass of linear elements, for steps of 0 and 1.
    stiffness = np.array([2.0, -1.0])
    mass = np.array([4.0, 1.0]) / 6
    steps_to = {"face": (1, 0, 0), "edge": (1, 1, 0), "corner": (1, 1, 1)}
    weights = {}
    for name, steps in steps_to.items():
        products = [
            stiffness[steps[axis]]
            * mass[steps[(axis + 1) % 3]]
            * mass[steps[(axis + 2) % 3]]
            for axis in range(3)
        ]
        weights[name] = -float(sum(products))
    return weights


def _growth_of_conductance() -> float:
    """Conductance within a level of irregular cells over that in the one above [-].

    At one conductivity: by size alone.
    """
    cube = jt.voxelize(box((1.0, 1.0, 1.0)), 1.0 / 32)
    structure = jt.IrregularMultiLevel(cube)
    links = structure.links()
    level = structure.nodes().level
    is_within = level[links.src] == level[links.dst]
    conductance = links.area / links.length
    coarse, fine = (
        np.median(conductance[is_within & (level[links.src] == number)])
        for number in (2, 1)
    )
    return float(coarse / fine)


def _table_6_1() -> dict[str, float]:
    """Numbers that follow from the thesis' table 6.1 alone."""
    side = TABLE_VOXELS[FULL] ** (1 / 3)
    law = side**2 * np.log2(side)
    return {
        "side_of_a_cube_as_large": side,
        "n2_log2_n": law,
        "irregular_over_n2_log2_n": TABLE_VOXELS[IRREGULAR] / law,
        "fewer_voxels": TABLE_VOXELS[FULL] / TABLE_VOXELS[IRREGULAR],
        "times_faster": TABLE_TIMES[FULL] / TABLE_TIMES[IRREGULAR],
        **{
            f"{structure}, a voxel_ns": 1e9 * TABLE_TIMES[structure] / voxels
            for structure, voxels in TABLE_VOXELS.items()
        },
    }
