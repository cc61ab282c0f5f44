"""Benchmarks compare equal things: one that does not is stopped before it is timed."""

import numpy as np
import pytest

import jaxthermo as jt
from experiments import __main__ as command_line, catalogue
from experiments.benchmarks import accelerator, multigrid, stencil, steps
from experiments.harness.agreement import (
    DisagreementError,
    largest_difference,
    require_within,
)
from jaxthermo.network.stencil import solid_degree
from tests.bodies import blocks


def test_the_largest_difference_is_that_from_the_first():
    results = {"ours": [1.0, 2.0], "one": [1.1, 2.0], "other": [1.0, 1.8]}
    difference = largest_difference("x", results, tolerance=0.3)
    assert difference == pytest.approx(0.2)
    with pytest.raises(DisagreementError, match="x, other against ours: 0.2 K, more"):
        largest_difference("x", results, tolerance=0.15, unit="K")


@pytest.mark.parametrize("peer", [[1.0, np.nan], [1.0], [1.0, np.inf]])
def test_what_is_no_number_or_of_another_shape_disagrees(peer):
    with pytest.raises(DisagreementError):
        largest_difference("x", {"ours": [1.0, 2.0], "peer": peer}, tolerance=1e9)
    with pytest.raises(DisagreementError):
        require_within("x", float("nan"), tolerance=1.0)


@pytest.fixture
def figurine(monkeypatch):
    monkeypatch.setenv("JAXTHERMO_MESHES", "no/such/folder")


def test_multigrid_solves_what_its_peers_solve(tmp_path, figurine):
    (experiment,) = catalogue.find("multigrid")
    result = catalogue.run(experiment, tmp_path, quick=True, height=24)["result"]
    for comparison in result["steps"].values():
        assert comparison["largest_difference"] < 1e-6
        for row in comparison["solvers"].values():
            assert row["residual"] < 2e-8


def test_links_of_another_conductance_are_no_peer(tmp_path, figurine, monkeypatch):
    """Six links of k times pitch for every node, as if no voxel was cut."""
    whole = multigrid._system

    def uncut(height, dt):
        system = whole(height, dt)
        matrix = system.matrix.copy()
        links = matrix.data < 0
        matrix.data[links] = -multigrid._CONDUCTIVITY * multigrid._HEIGHT / height
        return system._replace(matrix=matrix)

    monkeypatch.setattr(multigrid, "_system", uncut)
    monkeypatch.setattr(multigrid, "_STEPS", {"step of 5 s": 5.0})
    with pytest.raises(DisagreementError, match="temperatures, scipy"):
        multigrid.run(tmp_path, height=24, repeats=1)


def test_a_stencil_that_loses_heat_is_no_peer(monkeypatch):
    def wrong(state, next_state, degree):
        state *= 0.999

    monkeypatch.setattr(stencil, "_numba_steps", wrong)
    with pytest.raises(DisagreementError, match="after 40 steps"):
        stencil.run(shape=(12, 12, 12), repeats=1)


def test_slices_of_an_array_library_take_the_same_steps():
    """Those of torch and cupy, with numpy."""
    solid = np.ones((4, 5, 6), bool)
    structure = jt.FullVolume(blocks(solid, 1e-3))
    degree = np.pad(solid_degree(solid), 1)
    start = steps.random_state(structure)
    peer = accelerator.slice_steps(start, np.zeros_like(start), degree, lambda: None)
    ours = steps.conduction_of(structure)(accelerator._STEPS)
    largest_difference("state", {"numpy": peer, "ours": ours}, tolerance=1e-5)


def test_a_benchmark_of_unequal_things_exits_with_status_3(monkeypatch, capsys):
    def disagree(*_, **__):
        raise DisagreementError("temperatures: 3 K, more than 1 K")

    monkeypatch.setattr(catalogue, "run", disagree)
    with pytest.raises(SystemExit) as stop:
        command_line.main(["run", "multigrid"])
    assert stop.value.code == 3
    assert capsys.readouterr().err == (
        "experiments: multigrid: temperatures: 3 K, more than 1 K\n"
    )
