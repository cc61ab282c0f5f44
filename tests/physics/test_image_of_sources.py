"""A camera sees sources, and what surfaces reflect of them, as they heat the scene."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN as SIGMA
from jaxthermo.image.radiance.draw import Moment, draw
from jaxthermo.image.surface.view import compute_view
from jaxthermo.physics.boundary import ImposedFlux
from tests.imaging import at_start, block, metal, radiosity


def test_a_surface_without_absorption_reflects_all():
    """A perfect mirror and white paint take no heat, and show what reaches them."""
    body = block((0.04, 0.04, 0.04), 300.0, metal(0.0, 0.0))
    solution = at_start(
        (body,), jt.Surroundings(250.0), jt.Sun((-1.0, 0.0, 0.0), 500.0)
    )
    normal = body.structure.grid.fragment_normal
    expected = SIGMA * 250.0**4 + 500.0 * np.maximum(normal[:, 0], 0)
    assert_allclose(radiosity(solution), expected, rtol=1e-12)


def test_sources_are_seen_where_nothing_hides_them():
    """A panel, a lamp and the sun beside a block, each with its own radiance."""
    body = block((0.04, 0.04, 0.04), 300.0, metal(0.9))
    panel = jt.AreaSource(
        (0.0, 0.0, 0.1), (0.0, -1.0, 0.0), (0.08, 0.04), radiance=90.0
    )
    lamp = jt.PointSource((0.1, 0.0, 0.0), 0.02, min_distance=0.02)
    behind = jt.PointSource((0.0, 0.2, 0.0), 0.02, min_distance=0.02)
    sun = jt.Sun((0.3, -1.0, 0.0), jt.Until(800.0, 5.0))
    surroundings = jt.Surroundings(250.0)
    solution = at_start((body,), surroundings, panel, lamp, behind, sun)
    front = jt.OrthographicCamera(
        (0.0, -0.5, 0.0), (0.0, 0.0, 0.0), 0.3, width=60, height=60
    )
    image = jt.render(solution, front, 0, band=None)
    radiance = np.asarray(image.radiance)
    depth = np.asarray(image.depth)
    sky = SIGMA * 250.0**4 / np.pi
    lit = np.abs(radiance / 90.0 - 1) < 1e-6
    # Pixels of 5 mm: the panel has 16 x 8 of them, the lamp's disc pi 4^2.
    assert lit.sum() == 16 * 8 and lit[6:14, 22:38].all()
    assert_allclose(depth[lit], 0.5, rtol=1e-6)
    disc = np.abs(radiance / (0.02 / (np.pi * 0.02**2)) - 1) < 1e-5
    assert disc.sum() == pytest.approx(np.pi * 16, abs=4) and disc[30, 50]
    # The second lamp is behind the block, and the sun outside of parallel rays.
    assert np.asarray(image.object_id)[30, 30] == 0
    background = ~lit & ~disc & (np.asarray(image.object_id) < 0)
    assert_allclose(radiance[background], sky, rtol=1e-5)
    # Past the block to the sun, 32 minutes of arc wide: its disc sends the irradiance.
    at_sun = jt.Camera(
        (0.074, -0.39, 0.0),
        (-0.226, 0.61, 0.0),
        field_of_view=0.2,
        width=200,
        height=200,
    )
    terms = (surroundings, panel, lamp, behind, sun)
    view = compute_view(solution.surfaces, terms, at_sun)

    def radiance_at(time):
        image = draw(
            view,
            Moment(
                surfaces=solution.surfaces,
                terms=terms,
                temperature=solution.surface_temperature[0],
                received=solution.irradiance(0),
                time=time,
            ),
        )
        return np.asarray(image.radiance)

    seen = radiance_at(0.0)
    pixel = (np.tan(0.1) / 100) ** 2
    sends = (seen[seen > 1e5] * pixel).sum()
    assert sends == pytest.approx(800.0, rel=0.05)
    # It sets at 5 s.
    assert radiance_at(6.0).max() < 1e3


@pytest.mark.parametrize(
    "dtype", ["float32", pytest.param("float64", marks=pytest.mark.slow)]
)
def test_a_source_that_ends_at_a_saved_time_is_seen_there(dtype):
    """The surface at that time is still heated by it, so the image has it as well."""
    body = block((0.02, 0.02, 0.02), 300.0, metal(1.0, 0.4))
    lamp = jt.PointSource((0.04, 0.0, 0.0), jt.Until(3.0, 0.3), min_distance=0.01)
    scene = jt.Scene((body,), (jt.Surroundings(250.0), lamp), dtype=dtype)
    solver = jt.ForwardEuler(dt=0.05)
    solution = jt.simulate(scene, 0.35, [0.25, 0.3, 0.35], solver=solver)
    sources = [np.asarray(solution.reflected_sources(k)) for k in (-3, -2, -1)]
    assert_array_equal(sources[0], sources[1])
    assert sources[0].any() and not sources[2].any()
    camera = jt.OrthographicCamera(
        (0.0, -0.5, 0.0), (0.02, 0.0, 0.0), 0.1, width=20, height=20
    )
    lit_pixel = 3.0 / (np.pi * 0.01**2)
    brightest = [
        float(jt.render(solution, camera, k, band=None).radiance.max())
        for k in (-2, -1)
    ]
    assert brightest[0] == pytest.approx(lit_pixel, rel=1e-5) and brightest[1] < 200.0


@pytest.mark.slow
def test_what_is_switched_at_the_time_of_a_steady_state_counts_as_after_it():
    body = block((0.02, 0.02, 0.02), 300.0, metal(1.0, 0.4))
    sun = jt.Sun((0.0, 0.0, -1.0), jt.Until(800.0, 300.0))
    scene = jt.Scene((body,), (jt.Surroundings(250.0), sun), dtype="float64")
    assert not jt.steady(scene, at=300.0).reflected_sources(0).any()
    assert jt.steady(scene, at=299.0).reflected_sources(0).any()


class Glow(jt.AbstractRadiativeTerm):
    """A user's own radiation: of the upper half of a room, evenly."""

    name = "glow"
    absorbed_by = "absorptivity"
    irradiance: float

    def irradiation(self, surface):
        normal = np.concatenate([body.normal for body in surface.bodies])
        law = ImposedFlux(jnp.asarray(self.irradiance, surface.dtype))
        return (jt.Irradiation((1 + normal[:, 2]) / 2, law),)


def test_a_radiation_of_the_user_heats_and_is_seen():
    body = block((0.04, 0.04, 0.04), 300.0, metal(1.0, 0.3))
    scene = jt.Scene((body,), (Glow(600.0),), dtype="float64")
    dt = 0.1
    solution = jt.simulate(scene, dt, solver=jt.ForwardEuler(dt=dt))
    grid = body.structure.grid
    lit = 600.0 * (1 + grid.fragment_normal[:, 2]) / 2
    assert_allclose(solution.reflected(-1), 0.7 * lit, rtol=1e-12)
    heat = solution.energy.mechanisms["glow"][-1]
    assert float(heat) == pytest.approx(dt * 0.3 * grid.fragment_area @ lit, rel=1e-12)
