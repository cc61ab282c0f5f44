"""A live simulation: the steps of `simulate`, whatever is changed by hand."""

import jax.monitoring
import numpy as np
import pytest
from scipy.sparse import csr_array

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.live.live_camera import LiveCamera
from jaxthermo.live.session import LiveSession
from jaxthermo.physics.windows import PiecewiseLinear


SCENE = """
bodies:
  - shape: {kind: box, size: [4 cm, 4 cm, 8 cm]}
    pitch: 1 cm
    material: stainless_steel
    temperature: 300
terms:
  - {kind: sun, direction: [-1, 0, -0.4], irradiance: 2 kW/m^2, until: 20}
  - {kind: convection, heat_transfer_coefficient: 10, temperature: 290}
  - {kind: surroundings, temperature: 280}
  - {kind: wind, velocity: [2, 0, 0], temperature: 290}
time: {end: 30, save_at: [5, 30]}
camera: {width: 32, height: 24}
"""
VALUES = {
    "terms.0.irradiance": "900",
    "terms.0.direction": "[0.3, -1, -0.5]",
    "terms.1.heat_transfer_coefficient": "40",
    "terms.2.temperature": "260",
    "terms.3.velocity": "[0, 4, 0]",
}
EVENTS: list[str] = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, *_, **__: EVENTS.append(event)
)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    config_path = tmp_path_factory.mktemp("live") / "box.yaml"
    config_path.write_text(SCENE)
    return config_path


@pytest.fixture
def session(path):
    return LiveSession(path, rate=10.0)


def simulated(session: LiveSession) -> np.ndarray:
    """The end of a run by `simulate`, with the solver and values of a session."""
    solver = jt.ForwardEuler(dt=0.5)
    end = session.end
    solution = jt.simulate(session.scene, end, [end], solver=solver)
    return np.asarray(solution.surface_temperature[-1])


def test_a_live_run_equals_simulate_bit_for_bit(session):
    # In uneven pieces, as frames are.
    for time in (0.2, 3.7, 3.9, 19.0, 28.0, 99.0):
        session.advance_to(time)
        assert session.time == pytest.approx(min(30.0, time // 0.5 * 0.5))
    assert session.finished
    np.testing.assert_array_equal(session.temperature, simulated(session))


def test_changed_values_equal_simulate_with_them(session, path):
    session.advance_to(4.0)
    session.change(VALUES)
    session.reset()
    assert session.time == 0.0
    session.advance_to(30.0)
    texts = tuple(f"{name}={value}" for name, value in VALUES.items())
    fresh_session = LiveSession(path, texts)
    np.testing.assert_array_equal(session.temperature, simulated(fresh_session))


def test_values_change_from_now_on(session, path):
    session.advance_to(10.0)
    kelvin = session.temperature
    session.change({"terms.2.temperature": "200"})
    assert session.time == 10.0
    # The heat in the body is what it was; the balance at its surface is another one.
    assert 0 < abs(session.temperature - kelvin).max() < 1.0
    session.advance_to(30.0)
    assert session.temperature.mean() < simulated(LiveSession(path)).mean()


def test_values_and_rates_are_changed_without_tracing(session):
    session.advance_to(2.0)
    session.change({"terms.1.heat_transfer_coefficient": "11"})
    session.advance_to(2.5)
    _ = session.temperature
    _ = session.irradiance()
    EVENTS.clear()
    # Directions are bound again, which compiles nothing.
    for name, value in VALUES.items():
        change = session.prepare({name: value})
        assert not change.compiles and not change.restarts
        session.use(change)
        session.advance_to(session.time + 1.0)
        _ = session.temperature
        _ = session.irradiance()
        is_direction = value.startswith("[")
        stage = "backend_compile" if is_direction else ""
        assert not [e for e in EVENTS if "/jax/core/compile/" + stage in e]
        EVENTS.clear()
    session.set_rate(8.0)
    session.advance_to(session.time + 1.0)
    session.reset()
    assert not [name for name in EVENTS if "/jax/core/compile/" in name]


def test_a_frame_looks_up_tables_within_its_programs(path, monkeypatch):
    """Not one operation after the other, which take longer than all steps."""
    strength = "{times: [0, 10, 30], values: [100, 900, 200]}"
    air = "{times: [0, 15, 30], values: [290, 280, 285]}"
    texts = (
        f"terms.0={{kind: sun, direction: [-1, 0, -0.4], irradiance: {strength}}}",
    )
    session = LiveSession(path, (*texts, f"terms.2.temperature={air}"))
    camera = LiveCamera(session.config, session.surfaces)

    def frame(time):
        session.advance_to(time)
        return camera.frame(session)

    frame(1.0)
    monkeypatch.setattr(PiecewiseLinear, "over", lambda *_: pytest.fail("a look-up"))
    monkeypatch.setattr(PiecewiseLinear, "__call__", lambda *_: pytest.fail("a call"))
    assert np.nanmax(frame(2.0)) > 290.0


def test_another_structure_compiles_and_starts_again(session):
    session.advance_to(4.0)
    name = "bodies.0.structure"
    change = session.prepare({name: "{kind: aggregate, factor: 2}"})
    assert change.restarts and change.compiles
    session.use(change)
    assert session.time == 0.0
    session.advance_to(30.0)
    np.testing.assert_array_equal(session.temperature, simulated(session))
    # Back to that of the config, which is compiled already.
    change = session.prepare({name: None})
    assert change.restarts and not change.compiles


def test_a_mechanism_that_is_switched_off_compiles_and_goes_on(session):
    session.advance_to(10.0)
    change = session.prepare({"terms.0.irradiance": "0"})
    assert change.compiles and not change.restarts
    session.use(change)
    assert session.time == 10.0
    warm = session.temperature.max()
    session.advance_to(30.0)
    assert session.temperature.max() < warm


def test_a_mistake_leaves_the_session_as_it_was(session):
    session.advance_to(4.0)
    kelvin = session.temperature
    with pytest.raises(InputError, match="irradiance"):
        session.change({"terms.0.irradiance": "-5"})
    assert session.time == 4.0
    np.testing.assert_array_equal(session.temperature, kelvin)
    session.advance_to(5.0)
    with pytest.raises(InputError, match="rate nan"):
        session.set_rate(float("nan"))


def test_work_is_limited(session):
    session.advance_to(30.0, budget=1e-9)
    assert session.time == 0.5


def test_curves_have_all_since_the_start(session):
    weights = np.zeros((2, len(session.temperature)))
    weights[0, 3] = weights[1, 7] = 1
    expected = []
    for k in range(61):
        session.advance_to(k * 0.5)
        expected.append(session.temperature[[3, 7]])
    curves = session.curves(csr_array(weights))
    np.testing.assert_allclose(curves.times, np.arange(61) * 0.5)
    np.testing.assert_array_equal(curves.kelvin.T, expected)
    session.reset()
    assert session.curves(csr_array(weights)).times.tolist() == [0.0]


def test_steps_are_no_longer_than_a_frame(path):
    for rate, dt in ((2.0, 0.1), (10.0, 0.5)):
        session = LiveSession(path, rate=rate)
        assert max(i.dt for i in session.plan.intervals) == pytest.approx(dt)


def test_fast_conduction_runs_in_stages(path):
    # Copper is stable for a fifteenth of these frames only.
    texts = ("bodies.0.material=copper", "time={end: 60, save_at: [60]}")
    session = LiveSession(path, texts, rate=600.0)
    assert isinstance(session.plan.solver, jt.SuperTimeStepping)
    session.advance_to(60.0)
    assert session.finished
    finer = jt.simulate(session.scene, 60.0, [60.0], solver=jt.ForwardEuler())
    kelvin = np.asarray(finer.surface_temperature[-1])
    np.testing.assert_allclose(session.temperature, kelvin, atol=0.2)


def test_the_weather_stays_where_a_value_is_changed(tmp_path, monkeypatch):
    # Nothing is computed, so that nothing of it is compiled.
    monkeypatch.setattr(LiveSession, "_take", lambda session, steps: 0.0)
    path = tmp_path / "day.yaml"
    path.write_text(
        """
bodies:
  - shape: {kind: box, size: [4 cm, 4 cm, 8 cm]}
    pitch: 1 cm
    material: stainless_steel
    temperature: 300
terms: [{kind: heat_flux, heat_flux: 10}]
outdoors:
  place: {latitude: 48 deg, longitude: 11 deg}
  start: 2026-06-21T09:00+02:00
  clear_sky: {air: [285, 300], wind_speed: 2 m/s, wind_direction: 270 deg}
time: {end: 10 min, save_at: [10 min]}
camera: {width: 32, height: 24}
"""
    )
    session = LiveSession(path, rate=60.0)
    names = [term.name for term in session.terms]
    assert names == ["heat_flux", "sun", "diffuse_sky", "emission", "wind"]
    session.change({"terms.0.heat_flux": "5"})
    assert [term.name for term in session.terms] == names
