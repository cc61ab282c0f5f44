"""Cells through a thick wall are columns: exact as links, and no shorter steps."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.scene.compile.compile import compile_scene
from tests.sheet_bodies import FRONT


HOUR = 3600.0
SOIL = jt.Material(1.2, density=1700.0, specific_heat=1100.0, emissivity=0.95)
SURFACE = jt.Material(0.7, density=2100.0, specific_heat=920.0, emissivity=0.95)


class LinkedSheet(jt.Sheet):
    """A sheet whose cells are linked like all other nodes."""

    @property
    def columns(self):
        return None


def ground(kind=jt.Sheet, cells=16, dtype: Dtype = "float64"):
    mesh = jt.shapes.rectangle(4.0, 2.0)
    layers = (jt.Layer(SURFACE, 0.05), jt.Layer(SOIL, 0.6))
    sheet = kind(mesh, layers, pitch=0.5, cells=cells)
    day = jt.Table(
        np.array([0.0, 6.0, 12.0, 18.0]) * HOUR,
        [0.0, 0.0, 700.0, 0.0],
    )
    # Half of the ground is in the shadow.
    half = jt.Region((0.0, -2.0, -1.0), (3.0, 2.0, 1.0))
    return jt.Scene(
        (jt.Body(sheet, temperature=290.0),),
        (
            jt.HeatFlux(day, on=FRONT & half),
            jt.Convection(15.0, 288.0, on=FRONT),
            jt.Surroundings(270.0, on=FRONT),
        ),
        dtype=dtype,
    )


@pytest.mark.slow
def test_agrees_with_links():
    ends = []
    for kind in (jt.Sheet, LinkedSheet):
        solution = jt.simulate(ground(kind), 18 * HOUR, save_at=[9 * HOUR, 18 * HOUR])
        ends.append(np.asarray(solution.surface_temperature))
        assert abs(solution.energy.residual_relative).max() < 1e-11
    assert np.ptp(ends[0][1]) > 3
    assert_allclose(ends[0], ends[1], atol=0.03)


@pytest.mark.slow
def test_implicit_steps_and_steady_states_agree_with_links():
    """Conjugate gradients take few iterations, however thin the cells are."""
    ends = {"steps": [], "steady": []}
    for kind in (jt.Sheet, LinkedSheet):
        scene = ground(kind)
        solution = jt.simulate(scene, 12 * HOUR, solver=jt.TRBDF2(dt=3 * HOUR))
        ends["steps"].append(np.asarray(solution.surface_temperature)[-1])
        assert abs(solution.energy.residual_relative).max() < 1e-9
        statistics = solution.run.statistics
        assert statistics is not None
        by_newton = statistics.linear_iterations / statistics.newton_iterations
        assert by_newton < (4 if kind is jt.Sheet else 100)
        steady = jt.steady(scene, at=12 * HOUR)
        ends["steady"].append(np.atleast_2d(steady.surface_temperature)[-1])
    for name, (columns, links) in ends.items():
        assert np.ptp(columns) > 3, name
        assert_allclose(columns, links, atol=1e-6)


@pytest.mark.slow
def test_energy_closes_in_single_precision():
    solution = jt.simulate(ground(dtype="float32"), 24 * HOUR)
    assert abs(solution.energy.residual_relative).max() < 1e-5


def test_thin_cells_do_not_shorten_the_step():
    steps = [
        float(compile_scene(ground(kind), 1, HOUR).stable_step)
        for kind in (jt.Sheet, LinkedSheet)
    ]
    assert steps[0] > 2 * steps[1]
