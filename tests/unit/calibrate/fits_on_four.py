"""Fits and sweeps on four devices against one: for a process that has four."""

import sys
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from calibrate.config.schema import FitConfig
from calibrate.problem.problem import Problem, RunDiagnostics, trace
from calibrate.solvers.fit import Fit, Fitting
from calibrate.solvers.levenberg_marquardt import jacobian_rows
from calibrate.solvers.search import (
    Objective,
    Search,
    losses,
    residuals,
    start_points,
)
from calibrate.solvers.starts import search_starts
from calibrate.study.evaluate import evaluate_group, find_truth
from jaxthermo.parallel.batch import on_every_device
from jaxthermo.parallel.devices import mesh_of
from tests.calibrating import BETWEEN, WITHIN, twin
from tests.sweeping import sweep_cases


# Rounding of a run in float64.
close = partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-9)


def problem() -> Problem:
    """A twin of one case and two parameters."""
    twin_problem = twin((WITHIN, BETWEEN))
    return Problem(twin_problem.parameters, twin_problem.cases[:1])


def check(fit: Fit, expected: Fit) -> None:
    assert fit.jacobian is not None and expected.jacobian is not None
    assert len(fit.steps) == len(expected.steps) and fit.ended == expected.ended
    close(fit.z, expected.z)
    close(fit.residual, expected.residual)
    close(fit.jacobian, expected.jacobian)
    for step, its_step in zip(fit.steps, expected.steps, strict=True):
        assert step.outcome == its_step.outcome
        close(step.loss, its_step.loss)


def model(z, tables, views):
    """Residuals of five values, of no run, with the diagnostics of one."""
    times = jnp.linspace(0.0, 2.0, 9)
    decay = jnp.exp(-jnp.exp(z[:, None]) * times)
    rates = jnp.arange(1.0, 6.0) @ decay - jnp.arange(1.0, 6.0) @ jnp.exp(
        -jnp.linspace(0.5, 2.5, 5)[:, None] * times
    )
    return rates, RunDiagnostics(jnp.ones(1), jnp.isfinite(rates).all(), (rates,))


def solver() -> None:
    """Derivatives and steps of a model that takes no time are those on one."""
    z = jnp.linspace(-0.5, 0.5, 5)
    settings = FitConfig(tolerance=1e-6)
    nothing = jnp.zeros(9)
    objective_of_model = Objective(
        traced=trace(model, z, (), ()),
        step_tables=(),
        knee=jnp.asarray(jnp.inf),
        noise=nothing,
    )
    results_by_devices = []
    for mesh in (None, mesh_of(4)):
        objective, first = on_every_device(mesh, (objective_of_model, z))
        # All at once, and one after the other on each device.
        results = [
            jacobian_rows(residuals, args=objective, z=first, batch=batch, mesh=mesh)
            for batch in (5, 2)
        ]
        search = Search(
            objective=objective, settings=settings, batch=5, use_broyden=True, mesh=mesh
        )
        state = search.start(first)
        best = first
        advance = search.compile(best, state)
        for _ in range(6):
            best, state, _ = advance(best, state, objective)
            results += [best, state.f_info.residual]
        points = on_every_device(mesh, first + jnp.arange(6.0)[:, None] / 10)
        results.append(losses(objective, points=points, batch=5, mesh=mesh))
        results_by_devices.append([np.asarray(result) for result in results])
    on_one, on_four = results_by_devices
    assert on_one[-1].shape == (6,) and on_one[0].shape == (5, 9)
    assert (on_one[3] ** 2).sum() > 1.1 * (on_one[13] ** 2).sum()
    for on_one_device, on_four_devices in zip(on_one, on_four, strict=True):
        close(on_four_devices, on_one_device)


def columns() -> None:
    """A fit is that of one device, and goes on on another number of devices."""
    settings = FitConfig(tolerance=1e-9, max_steps=40, starts=4)
    fittings = {n: Fitting(problem(), settings, devices=n) for n in (1, 4)}
    uninterrupted = {n: fitting.run() for n, fitting in fittings.items()}
    assert (
        uninterrupted[1].ended == "converged"
        and uninterrupted[1].loss < 1e-6 * uninterrupted[1].steps[0].loss
    )
    check(uninterrupted[4], uninterrupted[1])
    checkpoint = Path("state.npz")
    for first_devices, later_devices in ((4, 1), (1, 4)):
        asked = iter(range(3))

        def stop(asked=asked):
            return next(asked, None) is None

        interrupted = fittings[first_devices].run(checkpoint=checkpoint, stop=stop)
        assert interrupted.ended == "interrupted" and len(interrupted.steps) == 3
        check(fittings[later_devices].run(checkpoint=checkpoint), uninterrupted[1])
        checkpoint.unlink()


def starts() -> None:
    """Five starts on four devices lead where they do on one."""
    settings = FitConfig(tolerance=1e-6, max_steps=6, starts=5)
    points = start_points(5, 2, 0.5, seed=3)
    on_one, on_four = (
        search_starts(Fitting(problem(), settings, devices=n), points).best
        for n in (1, 4)
    )
    assert np.abs(on_one).max() > 0.1
    close(on_four, on_one)


def cases() -> None:
    """Three cases of one shape have the same errors on four devices as on one."""
    load_cases = [case for case in sweep_cases(Path()) if case.load == "+x"]
    truths = {"+x": find_truth(load_cases[0], lambda _: None)}
    on_one, on_four = (evaluate_group(load_cases, truths, devices=n) for n in (1, 4))
    assert [evaluated.row["together"] for evaluated in on_four] == [3, 3, 3]
    for shared, alone in zip(on_four, on_one, strict=True):
        assert shared.row["id"] == alone.row["id"]
        assert shared.row["steps"] == alone.row["steps"]
        for name in ("rms_kelvin", "p99_kelvin", "bias_kelvin"):
            close(shared.row["error"][name], alone.row["error"][name])


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    assert jax.device_count() == 4
    commands = {"solver": solver, "columns": columns, "starts": starts, "cases": cases}
    commands[sys.argv[1]]()
    print("equal")
