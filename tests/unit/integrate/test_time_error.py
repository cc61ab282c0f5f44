"""The steps of a selected solver follow the error in time of the run."""

from itertools import islice
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.choices import Dtype
from jaxthermo.integrate.run.checkpoint import load_checkpoint, save_checkpoint
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.run.segments import (
    begin_run,
    compile_segments,
    finish_run,
    run_segments,
)
from jaxthermo.integrate.run.simulate import run_plan, take_steps
from jaxthermo.integrate.run.time_error import Passes, of_pass
from jaxthermo.integrate.stepper import jit_in_place
from tests.bodies import bar


FRONT = jt.Side((1.0, 0.0, 0.0))
BACK = jt.Side((-1.0, 0.0, 0.0))
METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0)
END = 400.0
SAVES = (100.0, 250.0, 400.0)


def _plate():
    """One voxel thick, of Biot numbers 1/8 and 1/40 by half of its thickness."""
    grid = jt.voxelize(jt.shapes.box((0.001, 0.004, 0.004)), 0.001)
    plastic = jt.Material(0.2, density=1000.0, specific_heat=1000.0)
    terms = (jt.Convection(50.0, 300.0, on=FRONT), jt.Convection(10.0, 300.0, on=BACK))
    body = jt.Body(jt.FullVolume(grid), plastic, temperature=400.0)
    return jt.Scene((body,), terms, dtype="float64")


def _heated(heat_flux=2e4, dtype: Dtype = "float64"):
    """A bar with a heat flux that is switched off within the run."""
    body = jt.Body(jt.FullVolume(bar(9, 0.01)), METAL, temperature=300.0)
    until = jt.Until(heat_flux, 180.0)
    terms = (jt.HeatFlux(until, on=FRONT), jt.Convection(50.0, 290.0))
    return jt.Scene((body,), terms, dtype=dtype)


def _plate_mean(time):
    # Each side through half of a cell: 1 / (1 / h + d / 2 k).
    sides = sum(1 / (1 / h + 0.0005 / 0.2) for h in (50.0, 10.0))
    return 300.0 + 100.0 * np.exp(-sides * time / (1e6 * 0.001))


def test_a_plate_of_one_voxel_cools_as_the_closed_form():
    control = jt.ErrorControl()
    run = jt.simulate(_plate(), 30.0, solver=control)
    mean = float(run.mean_temperature[0, 0])
    limit = run.run.time_error_limit
    surface = np.asarray(run.surface_temperature)
    assert limit == pytest.approx(max(1e-3, 1e-3 * np.ptp(surface)))
    assert run.run.time_error is not None and limit is not None
    assert abs(mean - _plate_mean(30.0)) <= run.run.time_error <= limit
    assert run.receipt.notes[-1].startswith("error in time about")


@pytest.mark.slow
@pytest.mark.slice
def test_many_stable_steps_are_taken_by_steps_of_tr_bdf2():
    """A lump cools by exp(-t h A / C): 10 um voxels, 6 million stable steps."""
    pitch = 1e-5
    h = 0.1
    times = np.array([20.0, 80.0])
    body = jt.Body(jt.FullVolume(bar(3, pitch)), METAL, temperature=400.0)
    scene = jt.Scene((body,), (jt.Convection(h, 300.0),), dtype="float64")
    run = jt.simulate(scene, 80.0, list(times))
    rate = h * 14 * pitch**2 / (8000.0 * 500.0 * 3 * pitch**3)
    exact = 300.0 + 100.0 * np.exp(-rate * times)
    off = np.abs(np.asarray(run.mean_temperature)[:, 0] - exact).max()
    error = run.run.time_error
    limit = run.run.time_error_limit
    assert run.run.solver == "TRBDF2" and error is not None and limit == 1e-3
    assert off <= error <= 1e-3


def test_it_is_the_default(controlled):
    run = jt.simulate(_heated(), END, SAVES)
    assert run.run.time_error == controlled.run.time_error
    np.testing.assert_array_equal(
        run.surface_temperature, controlled.surface_temperature
    )


@pytest.fixture(scope="module")
def controlled():
    return jt.simulate(_heated(), END, SAVES, solver=jt.ErrorControl())


def test_the_error_is_below_its_estimate(controlled):
    with precision("float64"):
        todo = plan_run(
            _heated(),
            t1=END,
            save_at=SAVES,
            solver=jt.ErrorControl(),
            control_error=True,
        )
        # Steps so short that they are exact by comparison, in the program at hand.
        short = of_pass(todo, 9)
        exact = np.asarray(run_plan(short).surface_temperature)
    surface = np.asarray(controlled.surface_temperature)
    assert short.steps > 50 * controlled.run.steps
    off = np.abs(surface - exact).max()
    ranges = np.ptp(exact, axis=1)
    assert off <= controlled.run.time_error <= controlled.run.time_error_limit
    assert controlled.run.time_error_limit == pytest.approx(1e-3 * ranges.max(), 1e-3)


def _programs() -> int:
    as_graph = jax.default_backend() == "gpu"
    return jit_in_place(take_steps, as_graph)._cached._cache_size()


def test_a_smaller_error_takes_more_steps_in_the_same_program(controlled):
    programs = _programs()
    control = jt.ErrorControl(relative_error=1e-5)
    # Of other numbers too: another heat flux, and so other passes.
    finer = jt.simulate(_heated(3e4), END, SAVES, solver=control)
    limit = finer.run.time_error_limit
    assert finer.run.time_error is not None and limit is not None
    assert finer.run.time_error <= limit
    assert finer.run.steps > controlled.run.steps
    assert _programs() == programs


def test_segments_and_checkpoints_take_the_same_passes(tmp_path, controlled):
    path = tmp_path / "checkpoint.npz"
    with precision("float64"):
        todo = plan_run(
            _heated(),
            t1=END,
            save_at=SAVES,
            solver=jt.ErrorControl(),
            control_error=True,
        )
        progress = compile_segments(todo, begin_run(todo))
        count = 0
        while not progress.passes.finished:
            for reached in islice(run_segments(todo, progress, seconds=0.0), 7):
                count = count + 1
                progress = reached
            # From a file, as after a break.
            save_checkpoint(path, plan=todo, progress=progress, key="key")
            progress = load_checkpoint(
                path, plan=todo, fresh=begin_run(todo), key="key"
            )
            assert progress is not None
        solution = finish_run(todo, progress)
    assert count > controlled.run.steps / 2
    assert solution.run.time_error == controlled.run.time_error
    assert solution.run.steps == controlled.run.steps
    for name in ("surface_temperature", "mean_temperature", "energy"):
        pairs = (jax.tree.leaves(getattr(run, name)) for run in (solution, controlled))
        for leaf, expected in zip(*pairs, strict=True):
            np.testing.assert_array_equal(leaf, expected)


def test_a_traced_scene_takes_second_order_steps_and_says_so():
    """Of the plate that is several percent off in Euler steps as long as is stable."""
    seen = []

    def mean(temperature):
        scene = _plate()
        body = eqx.tree_at(lambda b: b.temperature, scene.bodies[0], temperature)
        run = jt.simulate(eqx.tree_at(lambda s: s.bodies, scene, (body,)), 30.0)
        seen.append(run)
        return run.mean_temperature[0, 0]

    traced, slope = jax.jvp(mean, (400.0,), (1.0,))
    assert traced == pytest.approx(_plate_mean(30.0), abs=0.01)
    # Linear in the excess over the air.
    assert slope == pytest.approx((_plate_mean(30.0) - 300.0) / 100.0, abs=1e-4)
    assert seen[0].run.solver == "SuperTimeStepping"
    assert any("values are traced" in note for note in seen[0].receipt.notes)


def test_passes_end_at_the_limit_or_at_rounding(controlled):
    with precision("float64"):
        todo = plan_run(_heated(), END, SAVES)
        first = begin_run(todo).initial
    rows = jax.tree.map(lambda a: jnp.stack([a] * 2), first)

    def seen(off, finite=True):
        surface = np.asarray([[300.0, 310.0], [300.0, 320.0 + off]])
        return rows._replace(surface_temperature=surface, is_finite=jnp.full(2, finite))

    control = jt.ErrorControl()

    def next_passes(passes, *given, **how) -> Any:
        return passes.after(seen(*given, **how), control)

    # Second order: a quarter each, of which a ratio of 2.5 is relied on.
    passes = next_passes(next_passes(next_passes(Passes(), 16.0), 4.0), 1.0)
    assert (passes.number, passes.finished) == (3, False)
    assert passes.error[:2] == pytest.approx((3 / 1.5, 0.021))
    # No difference is believed to fall to less than a sixteenth at once.
    fallen = next_passes(passes, 0.96)
    assert (fallen.number, fallen.finished) == (4, False)
    assert fallen.error[:2] == pytest.approx((3 / 16 / 1.5, 0.02096))
    held = next_passes(fallen, 0.95)
    assert (held.number, held.finished) == (4, True)
    assert held.error[:2] == pytest.approx((0.01 / 1.5, 0.02095))
    unclear = next_passes(passes, 5.0)
    assert (unclear.number, unclear.finished) == (4, False)
    stalled = next_passes(unclear, 1.0)
    assert (stalled.number, stalled.finished) == (4, True)
    assert "above the limit" in stalled.error.text()
    # Shorter steps that fail give way to longer ones that did not.
    failed = next_passes(passes, 0.0, finite=False)
    assert (failed.number, failed.finished) == (2, True)
    assert failed.error.kelvin == pytest.approx(2.0)
    assert "shorter steps failed" in failed.error.text()
    assert float(failed.rows.surface_temperature[1, 1]) == 321.0
    never = next_passes(next_passes(Passes(), 0.0, finite=False), 0.0, finite=False)
    assert (never.number, never.finished, never.error) == (1, True, None)


@pytest.mark.parametrize("options", [{"error": 0.0}, {"relative_error": float("nan")}])
def test_errors_that_are_none_are_refused(options):
    with pytest.raises(jt.InputError, match="give a positive one"):
        jt.ErrorControl(**options)
