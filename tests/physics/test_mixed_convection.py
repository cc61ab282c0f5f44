"""Wind and free convection together: the cubes of their coefficients add up."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.physics.convection.mixed_convection import MixedConvection
from jaxthermo.physics.flux_law import Forcing
from jaxthermo.scene.compile.compile import compile_scene
from tests.bodies import body_at


METAL = jt.Material(50.0, density=2000.0, specific_heat=500.0)
AIR = 290.0
START = 320.0
GUST = jt.Wind((1.0, 0.0, 0.0), AIR, speed=jt.Table([0.0, 5.0], [0.5, 3.0]))
STILL = jt.FreeConvection(AIR)
UPPER = jt.Region((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0))
SHAPES = {
    "cylinder": jt.shapes.box((0.03, 0.03, 0.05)),
    "plate": jt.shapes.box((0.1, 0.08, 0.01)),
    "sphere": jt.shapes.sphere(0.03),
}


def bodies(*names):
    return tuple(
        body_at(jt.voxelize(SHAPES[name], 0.01), METAL, START, at=(0.2 * n, 0.0, 0.0))
        for n, name in enumerate(names)
    )


def laws_of(*terms):
    """Laws of the terms on bodies of all shapes, with the places where they act."""
    scene = jt.Scene(bodies(*SHAPES), terms, dtype="float64")
    program = compile_scene(scene, end=5.0).program
    natural = program.fragment_terms.natural
    return [(term.law, np.asarray(term.effective_area) > 0) for _, term in natural]


@eqx.filter_jit
def _evaluated(law, theta):
    """Flux, its slope by the law and by differentiation, and the coefficient."""
    time = jnp.zeros(())
    flux, change = jax.jvp(
        lambda theta: law.flux(time, theta), (theta,), (jnp.ones_like(theta),)
    )
    h = law.heat_transfer_coefficient(time, theta)
    return flux, law.slope(time, theta), -change, h


def coefficients(laws):
    """Heat transfer coefficient of all fragments at the start [W/(m^2 K)]."""
    rows = [
        np.where(acts, _evaluated(law, np.zeros(len(acts)))[3], 0) for law, acts in laws
    ]
    return np.sum(rows, axis=0)


@pytest.fixture(scope="module")
def free():
    return coefficients(laws_of(STILL))


@pytest.fixture(scope="module")
def mixed_laws():
    return laws_of(GUST, STILL)


def test_the_cubes_of_the_coefficients_add_up_on_every_shape(mixed_laws, free):
    forced = coefficients(laws_of(GUST))
    both = coefficients(mixed_laws)
    assert_allclose(both**3, forced**3 + free**3, rtol=1e-9)
    assert (both / (forced + free)).min() < 0.8


def test_only_the_part_on_which_both_act_mixes(free):
    wind = jt.Wind((1.0, 0.3, 0.0), AIR, on=UPPER)
    forced = coefficients(laws_of(wind))
    both = coefficients(laws_of(wind, STILL))
    is_windy = forced > 0
    assert 0 < is_windy.sum() < is_windy.size
    assert_allclose(both**3, forced**3 + free**3, rtol=1e-9)
    assert_allclose(both[~is_windy], free[~is_windy], rtol=1e-12)


def test_terms_on_parts_of_their_own_do_not_mix():
    still = jt.FreeConvection(AIR, on=~UPPER)
    laws = laws_of(jt.Wind((1.0, 0.3, 0.0), AIR, on=UPPER), still)
    assert not any(isinstance(law, MixedConvection) for law, _ in laws)


def test_what_each_brings_adds_up_to_all_heat():
    scene = jt.Scene(bodies("plate"), (GUST, STILL), dtype="float64")
    energy = jt.simulate(scene, 5.0).energy
    parts = [energy.mechanisms[name][-1] for name in ("wind", "free_convection")]
    assert (np.array(parts) < 0).all()
    assert abs(energy.residual_relative[-1]) < 1e-11


def test_slopes_are_derivatives_within_their_bounds(mixed_laws):
    reach = Forcing(highest=450.0, lowest=230.0)
    kelvin = AIR + np.append(
        -np.geomspace(1e-3, 60, 12), np.append(0, np.geomspace(1e-3, 160, 15))
    )
    assert len(mixed_laws) == 1 + len(SHAPES)
    for law, acts in mixed_laws:
        assert isinstance(law, MixedConvection)
        steepest = float(law.max_slope(jnp.asarray(reach.highest), 5.0))
        for theta in kelvin - START:
            values = _evaluated(law, np.full(len(acts), theta))
            flux, slope, change, _ = (np.asarray(value)[acts] for value in values)
            # The sixth root of a difference is approximated.
            assert_allclose(slope, np.maximum(change, 0), rtol=1e-4, atol=1e-12)
            # What each brings grows with the difference, but for the film.
            assert (change > -0.01 * steepest).all()
            assert (slope <= steepest).all()
            assert (np.abs(flux) <= law.max_flux(reach, 5.0)).all()
