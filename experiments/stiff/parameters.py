"""An optimizer that proposes a negative conductivity (S21)."""

from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.integrate.run.solution import result_name

from .bodies import COLD, HOT, block, two_halves
from .case import Case, Check, Row, broken, refusal


SOLVERS = {
    "ForwardEuler": jt.ForwardEuler(dt=1.0),
    "BackwardEuler": jt.BackwardEuler(dt=1.0),
}


def _scene(conductivity) -> jt.Scene:
    material = jt.Material(conductivity, 8000.0, 500.0)
    grid = block(8, 3, 3, 0.01)
    body = jt.Body(jt.FullVolume(grid), material, temperature=two_halves)
    return jt.Scene((body,), (), dtype="float64")


def proposals() -> Iterator[Row]:
    """S21."""
    yield refusal("k = -1", lambda: jt.Material(-1.0, 1.0, 1.0), "positive, finite")
    yield refusal("k is NaN", lambda: jt.Material(np.nan, 1.0, 1.0), "positive, finite")
    for name, solver in SOLVERS.items():
        try:
            yield _traced(name, solver)
            yield _by_logarithm(name, solver)
        except Exception as error:
            yield broken("a fit", error, name, "float64")


def _traced(name: str, solver) -> Row:
    """What k = -1 does where no check can see it: for comparison."""

    @eqx.filter_jit
    def run(k):
        found = jt.simulate(_scene(k), 50.0, solver=solver, throw=False)
        return found.surface_temperature, found.result

    with precision("float64"):
        surface, result = run(jnp.asarray(-1.0, jnp.float64))
    found = np.asarray(surface)
    over = max(float(found.max()) - HOT, COLD - float(found.min()))
    return Row(
        "k = -1, traced",
        name,
        "float64",
        overshoot_K=over,
        result=result_name(result),
        seen="a traced k is not checked: fit its logarithm",
    )


def _by_logarithm(name: str, solver) -> Row:
    """Steps of gradient descent on log k, 1000 times too long: k stays positive."""

    def loss(logarithm):
        run = jt.simulate(_scene(jnp.exp(logarithm)), 50.0, solver=solver, throw=False)
        # The more it keeps of its contrast the better: the best k is 0.
        return -jnp.abs(run.surface_temperature[-1] - 350.0).mean()

    step = jax.jit(jax.value_and_grad(loss))
    worst, least = 0.0, np.inf
    with precision("float64"):
        at = jnp.asarray(np.log(16.0), jnp.float64)
        for _ in range(20):
            value, slope = step(at)
            worst = max(worst, abs(float(slope)), abs(float(value)))
            # Held to what a fit would allow: a factor of 1e3 about the start.
            at = jnp.clip(at - 1e3 * slope, np.log(1.6e-2), np.log(1.6e4))
            least = min(least, float(jnp.exp(at)))
    checks = (Check("k", least, np.inf, 1e-3), Check("loss, slope", worst, 1e3, 0.0))
    return Row("log k, steps too long", name, "float64", checks=checks)


CASES = (
    Case(
        "S21",
        "an optimizer proposes k < 0",
        "a number is refused; a fit of log k stays positive and finite",
        "k = exp(p) is positive for any p",
        proposals,
    ),
)
