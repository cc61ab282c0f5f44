"""The view that a browser shows, asked as its widgets ask, without a browser."""

import functools
import socket

import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.live.server import LiveView, serving
from jaxthermo.live.session import LiveSession
from jaxthermo.live.surface_points import surface_points


SCENE = """
bodies:
  - shape: {kind: box, size: [4 cm, 4 cm, 8 cm]}
    pitch: 1 cm
    material: copper
    temperature: 300
terms:
  - {kind: sun, direction: [-1, 0, -0.4], irradiance: 2 kW/m^2, until: 20}
  - {kind: convection, heat_transfer_coefficient: 10, temperature: 290}
  - {kind: wind, velocity: [2, 0, 0], temperature: 290}
time: {end: 30, save_at: [30]}
camera: {width: 64, height: 48}
"""


@pytest.fixture
def server(monkeypatch):
    with serving("127.0.0.1", 0) as live_server:
        # As if a browser was there.
        monkeypatch.setattr(live_server, "get_clients", lambda: {0: None})
        yield live_server


@pytest.fixture
def session(tmp_path):
    path = tmp_path / "box.yaml"
    path.write_text(SCENE)
    return LiveSession(path)


@pytest.fixture
def view(server, session, monkeypatch):
    # Few points: how they cover a surface is tested in `test_surface_points`.
    few = functools.partial(surface_points, count=3000)
    monkeypatch.setattr("jaxthermo.live.server.surface_points", few)
    return LiveView(server, run=session, config=session.config, rate=10.0)


def status(view) -> str:
    return view._controls._status.content


def play(view, begin: float, end: float) -> None:
    for clock in np.arange(begin, end, 0.05).tolist():
        view.step(clock)


def test_play_runs_at_the_rate_and_shows_both_speeds(view, session):
    colours = view._view._clouds[0].colors.copy()
    assert "paused" in status(view)
    view.ask("toggle", None)
    play(view, 0.0, 1.5)
    assert session.time == pytest.approx(14.0, abs=1.0)
    assert (view._view._clouds[0].colors != colours).any()
    assert "running" in status(view)
    assert "simulated s/s, 20 frames/s" in status(view)
    view.ask("toggle", None)
    play(view, 1.5, 1.7)
    assert "paused" in status(view)
    view.ask("reset", None)
    view.step(2.0)
    assert session.time == 0.0


def test_the_arrow_of_the_sun_is_there_while_it_shines(view, session):
    sun, wind = (arrow for arrow, _ in view._view._arrows)
    assert sun.visible and wind.visible
    view.ask("rate", 50.0)
    view.ask("toggle", None)
    play(view, 0.0, 1.0)
    assert session.finished and not sun.visible and wind.visible
    view.ask("reset", None)
    play(view, 1.0, 1.1)
    assert sun.visible


def test_values_moved_by_hand_are_used(view, session):
    for strength in ("100", "900"):
        view.ask("value", ("terms.0.irradiance", strength))
    view.ask("value", ("terms.0.direction", "[0, -1, -1]"))
    view.step(0.0)
    assert session.config.terms[0].irradiance == 900.0
    assert session.config.terms[0].direction == (0.0, -1.0, -1.0)
    view.ask("rate", 50.0)
    view.step(0.1)
    assert view._player.rate == 50.0


def test_a_mistake_is_one_line_on_the_page(view, session):
    view.ask("value", ("terms.0.irradiance", "-900"))
    view.step(0.0)
    assert "irradiance" in status(view)
    assert session.config.terms[0].irradiance == 2000.0
    view.ask("low", 99.0)
    view.step(0.5)
    assert "below the high one" in status(view)


def test_another_structure_is_announced_and_starts_again(view, session, monkeypatch):
    view.ask("toggle", None)
    play(view, 0.0, 0.5)
    assert session.time > 0
    said = []
    monkeypatch.setattr(view._server, "flush", lambda: said.append(status(view)))
    view.ask("structure", "{kind: aggregate, factor: 2}")
    view.step(0.6)
    assert "compiling" in said[0]
    assert session.time < 1.0 and "compiling" not in status(view)
    assert session.config.bodies[0].structure.kind == "aggregate"
    assert len(session.temperature) == view._view.points.weights.shape[1]


def test_probes_are_set_on_bodies_and_have_curves(view, session):
    view.ask("toggle", None)
    play(view, 0.0, 0.5)
    centre = np.zeros(3)
    from_x = np.array([1.0, 0.0, 0.0])
    missing = np.array([1.0, 0.5, 0.0])
    for origin in (from_x, missing):
        view.ask("probe", (tuple(origin), tuple(centre - from_x)))
    play(view, 0.5, 1.5)
    assert len(view._probes) == 1
    times, kelvin = view._controls._plot.data
    assert times[0] == 0.0 and times[-1] == pytest.approx(session.time, abs=4.0)
    assert kelvin[0] == pytest.approx(300 - 273.15, abs=0.1)
    view.ask("unprobe", None)
    play(view, 1.5, 2.0)
    assert not view._probes and not view._controls._plot.visible


def test_colours_hold_the_range_unless_it_is_set(view, session):
    view.ask("toggle", None)
    play(view, 0.0, 1.0)
    kelvin = session.temperature
    assert view._scale.low < kelvin.min() and kelvin.max() < view._scale.high
    view.ask("low", 20.0)
    view.ask("palette", "ember")
    play(view, 1.0, 1.2)
    assert view._scale.low == pytest.approx(293.15)
    assert view._scale.palette == "ember" and view._controls._fixed.value
    view.ask("fixed", False)
    play(view, 1.2, 1.4)
    assert view._scale.low < session.temperature.min()


def test_without_a_browser_the_simulation_waits(view, session, monkeypatch):
    view.ask("toggle", None)
    play(view, 0.0, 0.5)
    time_at_stop = session.time
    monkeypatch.setattr(view._server, "get_clients", dict)
    play(view, 0.5, 5.0)
    assert session.time == time_at_stop
    monkeypatch.setattr(view._server, "get_clients", lambda: {0: None})
    play(view, 5.0, 5.5)
    assert time_at_stop < session.time < time_at_stop + 6.0


def test_a_host_or_port_that_is_none_is_refused():
    with pytest.raises(InputError, match="0 to 65535"), serving("127.0.0.1", 70_000):
        pass
    # An address for documentation, which no computer has.
    refused = pytest.raises(InputError, match="192.0.2.1: cannot listen")
    with refused, serving("192.0.2.1", 8080):
        pass


def test_a_port_that_is_taken_leads_to_the_next(server):
    with serving("127.0.0.1", server.get_port()) as second_server:
        assert second_server.get_port() != server.get_port()
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
        with serving("127.0.0.1", port) as second_server:
            assert second_server.get_port() != port
