"""Free convection: Churchill and Chu's formula, its fast form, its slopes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from wind_bodies import (
    flux_and_slope,
    flux_at,
    law_of,
    upright_cylinder,
)

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.geometry.mesh import Pose
from jaxthermo.physics.convection.air import (
    conductivity,
    kinematic_viscosity,
    prandtl,
)
from jaxthermo.physics.convection.buoyancy import (
    _GRAVITY,
    CYLINDER,
    PLATE,
)
from jaxthermo.physics.convection.free_convection import FreeConvection
from jaxthermo.voxels.cylinders import Cylinder, parts_of
from tests.radiating import surface_of, whole


LYING = Pose((0.0, 0.0, 0.0), ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)))
APART = np.array([0.02, 0.3, 1.0, 5.0, 30.0, 100.0, 300.0])


@pytest.fixture(scope="module")
def grid():
    return upright_cylinder()


def churchill_chu(rayleigh, pr, shape):
    """Average Nusselt number."""
    return (shape.a + shape.b(pr) * rayleigh ** (1 / 6)) ** 2


@jax.jit
def formula(surface, ambient, length):
    """h of plates and of cylinders by the formula itself."""
    surface, ambient, length = jnp.broadcast_arrays(surface, ambient, length)
    film = (surface + ambient) / 2
    pr = prandtl(film)
    buoyancy = _GRAVITY * jnp.abs(surface - ambient) / film
    rayleigh = buoyancy * length**3 * pr / kinematic_viscosity(film) ** 2
    per_length = conductivity(film) / length
    shapes = (PLATE, CYLINDER)
    return jnp.stack([churchill_chu(rayleigh, pr, s) * per_length for s in shapes])


@pytest.mark.parametrize(
    ("shape", "expected"),
    [(PLATE, 147.16185223770603), (CYLINDER, 139.13493970073597)],
)
def test_values_of_the_library_ht(shape, expected):
    """Values of its documentation, at Pr 0.69 and Gr 2.63e9."""
    nusselt = churchill_chu(jnp.array(0.69 * 2.63e9), jnp.array(0.69), shape)
    assert float(nusselt) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("pose", [Pose(), LYING])
@pytest.mark.parametrize("ambient", [250.0, 300.0])
def test_the_law_is_the_formula(grid, pose, ambient):
    """Standing by its height as a plate, lying by its diameter as a cylinder."""
    (cylinder,) = parts_of(grid, (), 0).cylinders
    law = law_of(FreeConvection(ambient), surface_of(grid, pose))
    length = cylinder.length if pose == Pose() else cylinder.diameter
    for sign in (1, -1):
        hot = jnp.asarray(ambient + sign * APART[: 7 if sign > 0 else 5])
        exact = np.asarray(formula(hot, ambient, length))[int(pose is LYING)]
        flux = np.array([flux_at(law, float(t))[0] for t in hot])
        h = flux / (ambient - np.asarray(hot))
        # The difference is rounded off at 0.01 K: by 4 % of itself at 0.02 K.
        assert_allclose(h[0], exact[0], rtol=0.03)
        assert_allclose(h[1:], exact[1:], rtol=1e-3)


def test_the_slope_is_that_of_the_flux_and_below_the_steepest(grid):
    law = law_of(FreeConvection(300.0), surface_of(grid))
    count = len(grid.fragment_area)
    theta = np.zeros(count)
    theta[:14] = np.concatenate([-APART[:6], [0.0], APART])
    time = jnp.zeros(())
    slope = np.asarray(flux_and_slope(law, jnp.asarray(theta), time)[1])
    above, _ = flux_and_slope(law, jnp.asarray(theta + 1e-6), time)
    below, _ = flux_and_slope(law, jnp.asarray(theta - 1e-6), time)
    rise = (above - below) / 2e-6
    assert_allclose(slope, -rise, rtol=1e-4)
    assert (slope > 0).all()
    steepest = float(law.max_slope(jnp.array(600.0), 1.0))
    assert slope.max() <= steepest < 10 * slope.max()


def test_nothing_flows_at_equal_temperatures_and_gradients_are_finite(grid):
    seen = surface_of(grid)

    def heat(air, theta):
        law = law_of(FreeConvection(air), seen)
        return law.flux(jnp.zeros(()), jnp.full(len(seen.area), theta)).mean()

    value_and_slopes = jax.jit(jax.value_and_grad(heat, (0, 1)))
    value, slopes = value_and_slopes(jnp.array(300.0), jnp.array(0.0))
    assert float(value) == 0.0
    assert float(slopes[0]) == pytest.approx(-float(slopes[1])) and slopes[0] > 0


def test_a_length_takes_the_place_of_the_bodys_own(grid):
    law = law_of(FreeConvection(300.0, length=2.0), surface_of(grid))
    exact = float(formula(350.0, 300.0, 2.0)[0])
    flux = flux_at(law, 350.0)
    assert_allclose(flux / -50.0, exact, rtol=1e-3)


def test_an_upright_cylinder_without_ends_needs_a_length(grid):
    endless = Cylinder((0.0, 0.0, 0.0), (0, 0, 1), 0.1)
    with pytest.raises(InputError, match="has no length"):
        FreeConvection(300.0, cylinders=[endless]).bind(whole(surface_of(grid)))
    law_of(FreeConvection(300.0, cylinders=[endless]), surface_of(grid, LYING))


@pytest.mark.parametrize(
    "arguments",
    [{"temperature": -1.0}, {"temperature": np.nan}, {"length": 0.0}]
    + [{"length": -2.0}, {"length": np.inf}, {"cylinders": [1]}],
)
def test_a_mistake_is_one_line(arguments):
    with pytest.raises(InputError) as raised:
        FreeConvection(**{"temperature": 300.0, **arguments})
    assert "\n" not in str(raised.value)


def test_laws_of_solids_and_sheets_keep_the_precision_of_jax():
    # Tests have warnings as errors: JAX warns of a float64 that it does not have.
    grid = jt.voxelize(jt.shapes.box((0.1, 0.1, 0.1)), pitch=0.05)
    solid = jt.Body(jt.FullVolume(grid), jt.materials["brick"], temperature=300.0)
    steel = (jt.Layer("steel", 1e-3),)
    sheet = jt.Sheet(jt.shapes.box((0.1, 0.1, 0.05)), steel, pitch=0.05)
    apart = jt.Body(sheet, temperature=300.0, pose=jt.Pose((0.3, 0.0, 0.0)))
    with jax.enable_x64(False):
        scene = jt.Scene((solid, apart), (jt.FreeConvection(290.0),))
        receipt = jt.compile_scene(scene, end=600.0, save_times=(600.0,)).receipt
    assert "free_convection" in receipt.included
