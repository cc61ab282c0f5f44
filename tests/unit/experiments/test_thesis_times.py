"""Exhibits of times and growth, of the closure of 5.4, and of slips of the text."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.harness import meshes
from experiments.harness.power_law import Power, fitted_power
from experiments.thesis import statements
from experiments.thesis.exhibit import Verdict
from experiments.thesis.exhibits import closure, growth, real_time, shares
from experiments.thesis.nusselt import local_number
from jaxthermo.flow.body import body_links
from jaxthermo.flow.lattice import VELOCITIES
from jaxthermo.flow.run import FlowRun
from jaxthermo.flow.wake_runs import wake_channel, wake_setup
from jaxthermo.physics.convection.nusselt import cylinder_table
from jaxthermo.report.table import Cell, Table
from tests.exhibits import measured


def test_the_first_folder_with_a_mesh_wins(monkeypatch, tmp_path):
    first, second = tmp_path / "a", tmp_path / "b"
    for folder in (first, second):
        folder.mkdir()
        (folder / "max-planck.obj").write_text("")
    (second / "happy-buddha.obj").write_text("")
    monkeypatch.setenv("JAXTHERMO_MESHES", f"{first}:{second}")
    found = meshes.mesh_files()
    assert found["Max Planck"].parent == first
    assert found["Happy Buddha"].parent == second


def real_time_row(name: str, height: int, seconds: float) -> real_time.FrameRow:
    frames = real_time.FrameTimes(
        step_s=[seconds / 2],
        picture_s=[seconds / 2],
        frames_a_second=[1 / seconds] * 3,
        simulated_a_second=0.1 / seconds,
    )
    return real_time.FrameRow(
        structure=name,
        height=height,
        pixels="4 x 3",
        nodes=1000,
        fragments=600,
        stable_step_s=0.1,
        table_6_1_step_s=[0.055, 0.0055],
        one_step=frames,
        live=frames,
    )


def test_steps_of_the_thesis_are_at_most_as_many_frames():
    rows = [real_time_row(name, 60, 0.04) for name in real_time.STRUCTURES]
    found = real_time.summary(rows)
    full = found["beside_table_6_1"][-1]
    assert full["structure"] == "full volume"
    assert full["frames a second, thesis at most"] == pytest.approx(18.2, abs=0.05)
    assert full["here, one step"] == pytest.approx(25)
    # A step of 55 ms in 55 ms is real time, of copper a tenth of it.
    assert found["thesis_simulated"] == pytest.approx([1.0, 0.1])
    assert found["fluent"] == {"60 voxels": 4} and found["structures"] == 4
    slow = [real_time_row(name, 120, 0.2) for name in real_time.STRUCTURES]
    both = real_time.summary([*rows, *slow])
    assert both["fluent"] == {"60 voxels": 4, "120 voxels": 0}
    assert both["highest"] == 120


def test_shares_of_a_step_are_the_whole_of_it():
    spans = {"step": 10.0, "conduction": 4.0, "picture": 100.0}
    assert shares.shares_of(spans, by_mechanism=False) == {
        "conduction": 0.4,
        "surface": 0.6,
    }
    # Without contact it happened to take longer.
    spans |= {"radiation": 8.0, "convection": 9.0, "contact": 11.0}
    found = shares.shares_of(spans, by_mechanism=True)
    assert found == pytest.approx(
        {"conduction": 0.4, "radiation": 0.4, "convection": 0.2, "contact": 0.0}
    )


@pytest.mark.parametrize(
    ("conduction", "radiation", "verdict"),
    [
        (0.6, 0.2, Verdict.REPRODUCED),
        (0.4, 0.3, Verdict.DIFFERENT),
        (0.3, 0.5, Verdict.CONTRADICTED),
    ],
)
def test_conduction_is_said_to_take_most_of_a_step(conduction, radiation, verdict):
    of_step = {
        "conduction": conduction,
        "radiation": radiation,
        "convection": 1 - conduction - radiation,
    }
    rows = [
        shares.StepShares(
            structure=structure,
            height=80,
            nodes=1000,
            fragments=600,
            step_s=1e-3,
            picture_s=1e-2,
            voxelization_s=1.0,
            of_step=of_step,
        )
        for structure in ("full volume", "irregular levels")
    ]
    found, numbers = shares.judge(rows)
    assert found is verdict and numbers["conduction"][1] == conduction
    assert numbers["picture_steps"] == pytest.approx(10)


def test_a_power_is_found_with_its_standard_error():
    sizes = np.array([10, 20, 40, 80])
    exact = fitted_power(sizes, 3.0 * sizes**2.5)
    assert exact.power == pytest.approx(2.5) and exact.error < 1e-8
    noisy = fitted_power(sizes, sizes**2.0 * [1.1, 0.9, 1.1, 0.9])
    assert 0.05 < noisy.error < 0.5 and abs(noisy.power - 2) < 2 * noisy.error


@pytest.mark.parametrize(
    ("power", "verdict"), [(2.1, Verdict.DIFFERENT), (2.9, Verdict.CONTRADICTED)]
)
def test_growth_is_judged_by_what_is_counted(power, verdict):
    powers = {
        "nodes": Power(power, 0.01),
        "memory": Power(power, 0.01),
        "step": Power(2.9, 0.01),
    }
    assert growth.verdict_of_growth(powers) is verdict


def test_growth_beyond_the_shell_is_nearer_to_none_or_to_a_logarithm():
    logarithm = Power(0.25, 0.01)
    assert growth.is_without_logarithm(Power(0.05, 0.01), logarithm)
    assert not growth.is_without_logarithm(Power(0.2, 0.01), logarithm)


@pytest.fixture(scope="module")
def square():
    """A channel around a square rod of six cells, and random heat over its links."""
    setup = wake_setup(20.0, 6, heated=True)
    channel = wake_channel(20.0, setup, heated=True)
    mask = np.zeros(channel.shape, bool)
    height, length = (size // 2 for size in channel.shape)
    mask[height - 3 : height + 3, length - 3 : length + 3] = True
    channel = replace(channel, body=mask)
    is_link = np.asarray(body_links(channel.body, channel.shape).fraction) > 0
    return channel, is_link


def with_heat(channel, heat: np.ndarray) -> FlowRun:
    nothing: Any = None
    fields = dict.fromkeys(FlowRun._fields, nothing)
    return FlowRun(**{**fields, "channel": channel, "link_heat": heat})


def test_faces_of_a_square_share_all_of_its_heat(square):
    channel, is_link = square
    heat = np.random.default_rng(0).random(is_link.shape) * is_link
    found = closure.face_numbers(with_heat(channel, heat))
    total = found["front"] + 2 * found["each side"] + found["rear"]
    assert total == pytest.approx(heat.sum() / float(channel.diffusivity))
    even = closure.face_numbers(with_heat(channel, is_link.astype(float)))
    assert even["front"] == pytest.approx(even["each side"])
    assert even["front"] == pytest.approx(even["rear"])
    # All that leaves against the wind is the front's.
    ahead = np.zeros_like(heat)
    ahead[VELOCITIES.index((-1, 0)) - 1] = heat[VELOCITIES.index((-1, 0)) - 1]
    found = closure.face_numbers(with_heat(channel, ahead))
    assert found["front"] > 0 and found["rear"] == found["each side"] == 0


def test_the_number_has_the_average_and_the_shape_of_the_table():
    table = cylinder_table()
    row = int(np.flatnonzero(table.reynolds == 20.0)[0])
    around = local_number(np.arange(64) * 360.0 / 64, 20.0)
    assert around.mean() == pytest.approx(table.average[row])
    (front,) = local_number(np.zeros(1), 20.0)
    assert front == pytest.approx(table.average[row] * (1 + table.shape[row].sum()))


def rod(flow: float, number: float) -> Any:
    run: Any = SimpleNamespace(
        channel=SimpleNamespace(shape=(10, 20)), step=np.array([100])
    )
    shape = np.ones(len(closure.DEGREES))
    return closure.RoundRod(
        20.0, run, flow * shape, number * shape, flow, number, number
    )


def box(flow: float, number: float) -> Any:
    run: Any = SimpleNamespace()
    return closure.SquareRod(
        20.0,
        run=run,
        flow=dict.fromkeys(closure.FACES, flow),
        closure=dict.fromkeys(closure.FACES, number),
    )


@pytest.mark.parametrize(
    ("round_off", "square_off", "verdict"),
    [
        (1.02, 1.05, Verdict.REPRODUCED),
        (1.02, 1.25, Verdict.DIFFERENT),
        (1.25, 1.02, Verdict.CONTRADICTED),
    ],
)
def test_the_number_stands_for_the_flow_within_a_tenth(round_off, square_off, verdict):
    found, numbers = closure.judge(
        [rod(2.0, 2 * round_off)], [box(2.0, 2 * square_off)]
    )
    assert found is verdict
    assert numbers["round_rms"] == pytest.approx(round_off - 1)
    assert numbers["square_worst"] == pytest.approx(square_off - 1)
    assert numbers["square_total"] == pytest.approx(square_off - 1)
    assert numbers["updates"] == 2e4


@pytest.fixture(scope="module")
def slips():
    """Numbers that decide between statements of the text."""
    return measured("text-slips")


def test_numbers_behind_the_slips(slips):
    numbers = slips.numbers
    assert numbers["sun"] == pytest.approx(1388, abs=2)
    sheet = numbers["thin_sheet"]
    assert sheet["sheet_of_1_mm"] == pytest.approx(1000 * sheet["cube"])
    assert numbers["consistency"] < 1e-12
    element = numbers["element"]
    assert element["face"] == pytest.approx(0, abs=1e-12)
    assert 4 * element["edge"] * 3 + 8 * element["corner"] == pytest.approx(8 / 3)
    # Cells of twice the edge conduct twice as much.
    assert numbers["growth_of_conductance"] == pytest.approx(2)
    table = numbers["table_6_1"]
    assert table["side_of_a_cube_as_large"] == pytest.approx(303.7, abs=0.1)
    assert table["irregular_over_n2_log2_n"] == pytest.approx(4.21, abs=0.01)
    flows = numbers["transition"]
    assert flows["minima_at_the_highest"] == 2 and flows["two_minima_from"] == 1.4e5
    loss = numbers["emission"]
    assert loss["with_surroundings"] == pytest.approx(0, abs=1e-6)
    assert loss["radiation_per_kelvin"] == pytest.approx(6.12, abs=0.01)
    assert 9 < loss["wind_per_kelvin"] < 13


def test_slips_are_decided_by_numbers_where_there_are_any(slips):
    assert slips.verdict is Verdict.CONTRADICTED
    stated = statements.statement("text-slips", slips.numbers, {})
    table, _ = stated.blocks
    assert isinstance(table, Table)
    json.dumps(slips.numbers)
    with_number = sum(row[-1] != Cell("", wraps=True) for row in table.rows)
    assert f"{len(table.rows)} statements" in stated.reason
    assert f"{with_number} of them by a number" in stated.reason
    assert 0 < with_number < len(table.rows)
