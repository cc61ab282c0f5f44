"""Limits that a run missed are said: of the error in time, and of the energy."""

import pytest

import jaxthermo as jt
from jaxthermo.integrate.run.missed_limits import EnergyResidual, judged_run
from jaxthermo.integrate.run.time_error import TimeError


@pytest.mark.parametrize(
    ("relative", "kelvin", "stated", "lines"),
    [
        (1e-7, 1e-6, 5e-4, ()),
        # Rounding raises what is stated, and is no fault.
        (1e-6, 6e-4, 6e-4, ()),
        (2e-5, 6e-4, 6e-4, ("energy",)),
        (2e-4, 1e-6, 5e-4, ("energy",)),
        (1e-3, 0.2, 0.2, ("energy", "above the limit of 0.001 K: the energy")),
    ],
)
def test_the_energy_residual_is_part_of_the_stated_error(
    relative, kelvin, stated, lines
):
    error = TimeError(5e-4, limit=1e-3)
    judged = judged_run(error, EnergyResidual(relative, kelvin), "float32")
    assert judged.error is not None
    assert judged.error.kelvin == stated
    assert len(judged.warnings) == len(lines)
    for text, words in zip(judged.warnings, lines, strict=True):
        assert words in text


@pytest.mark.parametrize(("dtype", "remedy"), [("float32", "64"), ("float64", "step")])
def test_without_passes_the_energy_alone_is_judged(dtype, remedy):
    judged = judged_run(None, EnergyResidual(2e-4, 0.1), dtype)
    assert judged.error is None
    (text,) = judged.warnings
    assert remedy in text and "2.0e-04" in text and "0.1 K" in text


def test_a_limit_that_was_missed_has_its_cause():
    error = TimeError(5e-3, limit=1e-3, cause="a jump")
    judged = judged_run(error, EnergyResidual(0.0, 0.0), "float32")
    assert judged.error == error
    assert judged.warnings == (
        "error in time about 0.005 K, above the limit of 0.001 K: a jump",
    )


def test_a_limit_out_of_reach_is_said_by_every_run_of_a_scene():
    grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), 0.01)
    body = jt.Body(jt.FullVolume(grid), jt.materials["steel"], temperature=350.0)
    scene = jt.Scene((body,), (jt.Convection(20.0, 300.0),))
    control = jt.ErrorControl(relative_error=1e-12, error=1e-12)
    with pytest.warns(UserWarning, match="above the limit of 1e-12 K: steps half as"):
        solution = jt.simulate(scene, 200.0, solver=control)
    assert solution.run.warnings
    assert solution.receipt.warnings == solution.run.warnings
    run = jt.compile_simulation(scene, 200.0, solver=control)
    with pytest.warns(UserWarning, match="above the limit of 1e-12 K"):
        run()
