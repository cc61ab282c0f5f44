"""The wake's claims and the benchmark of the flow, on small lattices."""

import json

import numpy as np
import pytest

from experiments.benchmarks import lattice_boltzmann
from experiments.thesis.exhibition import plain
from experiments.thesis.exhibits import wake
from experiments.thesis.exhibits.wake import SETUPS, Setup, Tail, measure_pair


def test_the_setups_are_the_thesis_channels_at_its_size():
    shapes = [setup.flow(300).shape for setup in SETUPS]
    assert shapes == [(300, 800)] + 4 * [(600, 800)]
    assert [setup.reynolds for setup in SETUPS] == [100.0, 100.0, 80.0, 40.0, 20.0]
    assert SETUPS[0].flow(300).body.diameter == 40.0


def test_curves_apart_are_not_one_curve():
    x = np.linspace(0.1, 10.0, 50)
    tails = [Tail(Setup("wide", s), x, 1 - np.exp(-x / (1 + s))) for s in (1.0, 0.5)]
    (row,) = wake.measure_collapse(tails)
    assert row["speeds"] == [1.0, 0.5]
    assert row["largest"] == pytest.approx(
        np.abs(np.subtract(*[t.ratio for t in tails])).max()
    )
    assert 0 < row["rms"] < row["largest"]


@pytest.mark.slow
@pytest.mark.slice
def test_the_second_cylinder_takes_less_heat_the_nearer_it_is():
    factors = [row["factor"] for row in measure_pair()]
    assert 0.2 < factors[0] < 1.0 and max(factors) < 1.0


@pytest.mark.slow
def test_a_flow_is_measured_drawn_and_charted():
    setup = Setup("narrow", 0.4)
    flow = wake.compute_flow(setup, 45)
    tail = wake.tail_of(setup, flow)
    row = wake.measure_flow(tail, flow)
    json.dumps(plain(row), allow_nan=False)
    assert row["fits"]["power"]["rms"] < 0.1 and row["fastest"] > 1.0
    assert wake.tail_chart([row], [tail]).to_dict()["mark"]["type"] == "line"
    curves = {p["curve"] for p in wake.fit_chart(row, tail).to_dict()["data"]["values"]}
    assert curves == {"computed", "exponential", "power", "confined", "remainder"}
    tiles = wake.speed_tiles(flow)
    assert [tile.pixels.shape for tile in tiles] == 2 * [(45, 120, 3)]


@pytest.mark.slow
def test_every_fit_is_close_and_a_wide_channel_has_the_longer_tail():
    assert wake.convergent_functions(True).numbers["best_of_each"] < 0.03
    flows = wake.two_pipes(True).numbers
    assert flows["narrow"]["tail_0.9"] < flows["wide"]["tail_0.9"]


@pytest.mark.slow
def test_the_benchmark_has_its_rows():
    found = lattice_boltzmann.run(shape=(60, 160), repeats=2)
    json.dumps(found, allow_nan=False)
    assert [row["peer_name"] for row in found["measurements"]][2] == ""
    assert found["largest_difference"] < 1e-8
