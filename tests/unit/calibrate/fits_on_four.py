"""Fits and sweeps on four devices against one: for a process that has four."""

import sys
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from calibrate.config.schema import FitConfig
from calibrate.problem.problem import Problem, RunDiagnostics, trace
from calibrate.runs.evaluate import evaluate_group
from calibrate.runs.truth import find_truth
from calibrate.solvers.fit import Fit, Fitting
from calibrate.solvers.levenberg_marquardt import jacobian_rows
from calibrate.solvers.search import (
    Objective,
    Search,
    losses,
    residuals,
    start_points,
)
from experiments.sweep.config import load_sweep
from experiments.sweep.points import cases_of, choices
from jaxthermo.parallel.batch import on_every_device
from jaxthermo.parallel.devices import mesh_of
from tests.calibrating import BETWEEN, WITHIN, twin
from tests.sweeping import SWEEP, sweep_file


# Rounding of a run in float64.
close = partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-9)


def problem() -> Problem:
    """A twin of one case and two parameters."""
    both = twin((WITHIN, BETWEEN))
    return Problem(both.parameters, both.cases[:1])


def check(fit: Fit, other: Fit) -> None:
    assert fit.jacobian is not None and other.jacobian is not None
    assert len(fit.steps) == len(other.steps) and fit.ended == other.ended
    close(fit.z, other.z)
    close(fit.residual, other.residual)
    close(fit.jacobian, other.jacobian)
    for step, its_step in zip(fit.steps, other.steps, strict=True):
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
    z, settings = jnp.linspace(-0.5, 0.5, 5), FitConfig(tolerance=1e-6)
    nothing = jnp.zeros(9)
    made = Objective(trace(model, z, (), ()), (), jnp.asarray(jnp.inf), nothing)
    found = []
    for mesh in (None, mesh_of(4)):
        objective, first = on_every_device(mesh, (made, z))
        # All at once, and one after the other on each device.
        results = [
            jacobian_rows(residuals, objective, first, batch, mesh) for batch in (5, 2)
        ]
        search = Search(objective, settings, 5, True, mesh)
        state, best = search.start(first), first
        advance = search.compile(best, state)
        for _ in range(6):
            best, state, _ = advance(best, state, objective)
            results += [best, state.f_info.residual]
        points = on_every_device(mesh, first + jnp.arange(6.0)[:, None] / 10)
        results.append(losses(objective, points, 5, mesh))
        found.append([np.asarray(each) for each in results])
    one, four = found
    assert one[-1].shape == (6,) and one[0].shape == (5, 9)
    assert (one[3] ** 2).sum() > 1.1 * (one[13] ** 2).sum()
    for each, other in zip(one, four, strict=True):
        close(other, each)


def columns() -> None:
    """A fit is that of one device, and goes on on another number of devices."""
    settings = FitConfig(tolerance=1e-9, max_steps=40, starts=4)
    fittings = {n: Fitting(problem(), settings, devices=n) for n in (1, 4)}
    whole = {n: fitting.run() for n, fitting in fittings.items()}
    assert (
        whole[1].ended == "converged" and whole[1].loss < 1e-6 * whole[1].steps[0].loss
    )
    check(whole[4], whole[1])
    checkpoint = Path("state.npz")
    for before, after in ((4, 1), (1, 4)):
        asked = iter(range(3))
        stop = lambda asked=asked: next(asked, None) is None
        part = fittings[before].run(checkpoint=checkpoint, stop=stop)
        assert part.ended == "interrupted" and len(part.steps) == 3
        check(fittings[after].run(checkpoint=checkpoint), whole[1])
        checkpoint.unlink()


def starts() -> None:
    """Five starts on four devices lead where they do on one."""
    settings = FitConfig(tolerance=1e-6, max_steps=6, starts=5)
    points = start_points(5, 2, 0.5, seed=3)
    one, four = (
        Fitting(problem(), settings, devices=n).best_start(points) for n in (1, 4)
    )
    assert np.abs(one).max() > 0.1
    close(four, one)


def cases() -> None:
    """Three cases of one shape have the same errors on four devices as on one."""
    config = load_sweep(sweep_file(Path(), SWEEP))
    every = [case for choice in choices(config) for case in cases_of(config, choice)]
    own = [case for case in every if case.load == "+x"]
    truths = {"+x": find_truth(own[0], lambda _: None)}
    one, four = (evaluate_group(own, truths, devices=n) for n in (1, 4))
    assert [made.row["together"] for made in four] == [3, 3, 3]
    for made, other in zip(four, one, strict=True):
        assert made.row["id"] == other.row["id"]
        assert made.row["steps"] == other.row["steps"]
        for name in ("rms_kelvin", "p99_kelvin", "bias_kelvin"):
            errors = made.row["error"][name], other.row["error"][name]
            close(*errors)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    assert jax.device_count() == 4
    parts = {"solver": solver, "columns": columns, "starts": starts, "cases": cases}
    parts[sys.argv[1]]()
    print("equal")
