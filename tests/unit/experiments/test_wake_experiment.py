"""The wake's claims and the benchmark of the flow, on small lattices."""

import json

import numpy as np
import pytest

from experiments.benchmarks import lattice_boltzmann
from experiments.thesis.exhibition import plain
from experiments.thesis.exhibits import wake
from experiments.thesis.exhibits.wake import SETUPS, Setup, measure_pair
from tests.exhibits import measured


def test_the_setups_are_the_thesis_channels_at_its_size():
    shapes = [setup.flow(300).shape for setup in SETUPS]
    assert shapes == [(300, 800)] + 4 * [(600, 800)]
    assert [setup.reynolds for setup in SETUPS] == [100.0, 100.0, 80.0, 40.0, 20.0]
    assert SETUPS[0].flow(300).body.diameter == 40.0


def test_curves_apart_are_not_one_curve():
    x = np.linspace(0.1, 10.0, 50)
    tails = {s: 1 - np.exp(-x / (1 + s)) for s in (1.0, 0.5)}
    (row,) = wake.measure_collapse(tails)
    assert row["speeds"] == [1.0, 0.5]
    assert row["largest"] == pytest.approx(np.abs(np.subtract(*tails.values())).max())
    assert 0 < row["rms"] < row["largest"]


@pytest.mark.slow
@pytest.mark.slice
def test_the_second_cylinder_takes_less_heat_the_nearer_it_is():
    factors = [row["factor"] for row in measure_pair()]
    assert 0.2 < factors[0] < 1.0 and max(factors) < 1.0


@pytest.mark.slow
def test_a_flow_is_measured_drawn_and_charted():
    flow = wake.compute_wake(Setup("narrow", 0.4), 45)
    json.dumps(plain([flow.numbers(), flow.fits]), allow_nan=False)
    assert flow.fits["power"].rms < 0.1 and flow.fastest > 1.0
    (curve,) = wake.tail_chart([flow]).to_dict()["layer"]
    assert curve["mark"]["type"] == "line"
    points = wake.fit_chart(flow).to_dict()["data"]["values"]
    curves = {point["curve"] for point in points}
    assert curves == {"computed", "exponential", "power", "confined", "remainder"}
    tiles = wake.speed_tiles(flow.run, "", edge=120)
    assert [tile.pixels.shape for tile in tiles] == 2 * [(45, 120, 3)]


@pytest.mark.slow
def test_every_fit_is_close_and_a_wide_channel_has_the_longer_tail():
    assert measured("figure-6.5").numbers["best_of_each"] < 0.03
    flows = measured("figure-6.4").numbers
    assert flows["narrow"]["tail_0.9"] < flows["wide"]["tail_0.9"]


@pytest.mark.slow
def test_the_benchmark_has_its_rows():
    found = lattice_boltzmann.run(shape=(60, 160), repeats=2)
    json.dumps(found, allow_nan=False)
    assert [row["peer_name"] for row in found["measurements"]][2] == ""
    assert found["largest_difference"] < 1e-8
