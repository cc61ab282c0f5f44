"""Solvers of the front's rivals, against those of this package."""

import numpy as np
import pytest

import jaxthermo as jt
from experiments.front.linear_body import LinearBody, linear_body
from experiments.front.numba_loops import explicit_run, rkl2_run
from experiments.front.scipy_run import scipy_run
from tests.shallow import SHALLOW


# The ball is coarse: what is compared is the arithmetic.
pytestmark = [pytest.mark.filterwarnings("ignore:body 0 represents"), SHALLOW]

SAVE_AT = (30.0, 60.0, 90.0)
STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0, absorptivity=1.0)
STEP = 15.0


def scene(cells: str) -> jt.Scene:
    """A ball under a lamp that is switched off at a time at which nothing is saved."""
    # Two to three voxels from the surface to the centre: nodes deep inside as well.
    grid = jt.voxelize(jt.shapes.sphere(0.05), 0.1 / 7, cells)  # type: ignore

    def warm(x):
        return 300.0 + 100.0 * x[:, 0]

    body = jt.Body(jt.FullVolume(grid), STEEL, temperature=warm)
    lamp = jt.Sun((-1.0, 0.0, -0.3), jt.Until(5000.0, 45.0))
    return jt.Scene((body,), (lamp, jt.Convection(200.0, 290.0)), dtype="float32")


def body_of(ball_scene: jt.Scene) -> LinearBody:
    return linear_body(ball_scene, 90.0, SAVE_AT)


def surface(ball_scene: jt.Scene, solver) -> np.ndarray:
    solution = jt.simulate(ball_scene, 90.0, SAVE_AT, solver=solver)
    return np.asarray(solution.surface_temperature)


@pytest.fixture(scope="module")
def ball() -> tuple[jt.Scene, LinearBody]:
    ball_scene = scene("crossings")
    return ball_scene, body_of(ball_scene)


# By default steps of RKL2 are those of the solver: they have more to get wrong.
@pytest.mark.slow
@pytest.mark.parametrize("cells", ["crossings", "dominant_axis"])
def test_explicit_steps_are_those_of_forward_euler(ball, cells):
    ball_scene = ball[0] if cells == "crossings" else scene(cells)
    body = ball[1] if cells == "crossings" else body_of(ball_scene)
    expected = surface(ball_scene, jt.ForwardEuler())
    for layout in ("compact", "dense"):
        run = explicit_run(body.with_layout(layout), "interpreted")
        np.testing.assert_allclose(run.call(), expected, atol=1e-4, rtol=0)


def test_rkl2_steps_are_those_of_super_time_stepping(ball):
    ball_scene, body = ball
    expected = surface(ball_scene, jt.SuperTimeStepping(dt=STEP))
    for layout in ("compact", "dense"):
        run = rkl2_run(body.with_layout(layout), STEP, "interpreted")
        np.testing.assert_allclose(run.call(), expected, atol=1e-4, rtol=0)
    assert run.steps == 6


@pytest.mark.slow
def test_conjugate_gradients_are_those_of_trbdf2(ball):
    ball_scene, body = ball
    # Its linear systems are solved to a residual, not to rounding.
    expected = surface(ball_scene, jt.TRBDF2(dt=STEP))
    np.testing.assert_allclose(
        scipy_run(body, STEP).call(), expected, atol=2e-3, rtol=0
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "threads", ["one", pytest.param("all", marks=pytest.mark.slice)]
)
def test_compiled_loops_are_the_interpreted_ones(ball, threads):
    _, body = ball
    for make in (explicit_run, lambda b, t: rkl2_run(b, STEP, t)):
        expected = make(body, "interpreted").call()
        np.testing.assert_allclose(make(body, threads).call(), expected, atol=1e-4)


def test_nonlinear_scenes_have_no_rivals(ball):
    ball_scene, _ = ball
    warm = jt.Scene(ball_scene.bodies, (jt.Surroundings(280.0),), dtype="float32")
    with pytest.raises(jt.InputError, match="linear surface terms"):
        body_of(warm)


def test_loads_that_vary_between_events_have_no_rivals(ball):
    ball_scene, _ = ball
    ramp = jt.Table((0.0, 90.0), (0.0, 5000.0))
    lit = jt.Scene(
        ball_scene.bodies, (jt.Sun((-1.0, 0.0, 0.0), ramp),), dtype="float32"
    )
    with pytest.raises(jt.InputError, match="constant between events"):
        body_of(lit)
