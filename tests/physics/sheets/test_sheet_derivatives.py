"""Derivatives with respect to every number of a sheet, against differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from tests.sheet_bodies import BACK, FRONT, open_cylinder


NUMBERS = {
    "conductivity of the front": 45.0,
    "density of the front": 7800.0,
    "specific heat of the front": 460.0,
    "thickness of the front": 1e-3,
    "conductivity of the back": 0.2,
    "density of the back": 900.0,
    "specific heat of the back": 1500.0,
    "thickness of the back": 8e-3,
    "emissivity of the front": 0.7,
    "absorptivity of the front": 0.6,
    "emissivity of the coated back": 0.4,
    "absorptivity of the coated back": 0.3,
    "coefficient at the front": 12.0,
    "coefficient at the back": 6.0,
    "start": 300.0,
}


def material_of(numbers, face, **radiative):
    return jt.Material(
        numbers[f"conductivity of the {face}"],
        density=numbers[f"density of the {face}"],
        specific_heat=numbers[f"specific heat of the {face}"],
        **radiative,
    )


@pytest.fixture(scope="module")
def mesh():
    return open_cylinder(0.05, 0.1, 12)


def scene_of(mesh, values, cells):
    """A cylinder of two layers in sun, sky and air."""
    numbers = dict(zip(NUMBERS, values, strict=True))
    front = material_of(
        numbers,
        "front",
        emissivity=numbers["emissivity of the front"],
        absorptivity=numbers["absorptivity of the front"],
    )
    layers = (
        jt.Layer(front, numbers["thickness of the front"]),
        jt.Layer(material_of(numbers, "back"), numbers["thickness of the back"]),
    )
    coating = jt.Coating(
        numbers["emissivity of the coated back"],
        absorptivity=numbers["absorptivity of the coated back"],
        on=BACK,
    )
    body = jt.Body(
        jt.Sheet(mesh, layers, pitch=0.04, cells=cells),
        temperature=numbers["start"],
        coatings=(coating,),
    )
    terms = (
        jt.Sun((-0.6, 0.0, -0.8), 800.0),
        jt.DiffuseSky(100.0, reflected=30.0),
        jt.Surroundings(270.0),
        jt.Convection(numbers["coefficient at the front"], 290.0, on=FRONT),
        jt.Convection(numbers["coefficient at the back"], 295.0, on=BACK),
    )
    return jt.Scene((body,), terms, dtype="float64")


def weighted_end(mesh, values, cells):
    """A sum over the surface at the end of a run, of different weights."""
    # Thin cells have short stable steps.
    solver = jt.ForwardEuler(dt=20.0) if cells == 1 else jt.TRBDF2(dt=50.0)
    solution = jt.simulate(scene_of(mesh, values, cells), 200.0, solver=solver)
    temperature = solution.surface_temperature[0]
    return jnp.mean(jnp.linspace(0.5, 1.5, len(temperature)) * temperature)


@pytest.mark.parametrize("cells", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_derivatives_with_respect_to_every_number_of_a_sheet(mesh, cells):
    values = jnp.array(list(NUMBERS.values()))
    run = jax.jit(lambda v: weighted_end(mesh, v, cells))
    gradient = np.asarray(
        jax.jit(jax.grad(lambda v: weighted_end(mesh, v, cells)))(values)
    )
    # Relative steps, with the error of fourth order.
    scaled = gradient * np.asarray(values)
    for number, name in enumerate(NUMBERS):

        def shifted(step, index=number):
            return float(run(values.at[index].multiply(1 + step)))

        step = 1e-3
        near = (shifted(step) - shifted(-step)) / (2 * step)
        wide = (shifted(2 * step) - shifted(-2 * step)) / (4 * step)
        difference = (4 * near - wide) / 3
        assert scaled[number] == pytest.approx(difference, rel=1e-6, abs=1e-7), name
