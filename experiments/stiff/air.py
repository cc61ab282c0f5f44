"""Air at rest and at 1 km/s (S17); a body at the temperature of all around (S18)."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.physics.convection.nusselt import churchill_bernstein

from ..harness.case import Bound, Case, Row, broken
from .bodies import COLD, HOT, STEEL, block
from .methods import damping
from .solved import judged, row_of, run_nodes, stable_step


def _body(temperature) -> jt.Body:
    return jt.Body(jt.FullVolume(block(4, 4, 6, 0.01)), STEEL, temperature=temperature)


def _scene(*terms, temperature=HOT) -> jt.Scene:
    return jt.Scene((_body(temperature),), terms, dtype="float64")


AHEAD = (1.0, 0.0, 0.0)


def _winds() -> Iterator[Row]:
    """S17."""
    yield _at_rest()
    for what, term in {
        "h = 0": jt.Convection(0.0, COLD),
        "V = 0": jt.Wind((0.0, 0.0, 0.0), COLD),
    }.items():
        ran = run_nodes(_scene(term), jt.ForwardEuler(), 10.0)
        moved = float(np.abs(ran.nodes[0] - HOT).max())
        left_out = [o.why for o in ran.solution.receipt.left_out]
        check = Bound("moved", moved, 0.0)
        yield Row(what, "ForwardEuler", "float64", seen=str(left_out), checks=(check,))
    for speed in (1e-6, 1e3):
        scene = _scene(jt.Wind(AHEAD, COLD, speed=speed))
        for method in damping(stable_step(scene), ratio=100.0):
            row = judged(f"V = {speed:g} m/s", scene, method, (COLD, HOT))
            yield row
    notes = jt.compile_scene(_scene(jt.Wind(AHEAD, COLD, speed=1e3))).receipt.notes
    noted = Bound("notes", len(notes), np.inf, 1)
    yield Row("V = 1000 m/s: the receipt", seen="; ".join(notes), checks=(noted,))
    for name, solver in _SOLVERS.items():
        by_speed = lambda v: _scene(jt.Wind(AHEAD, COLD, speed=v))
        yield _slope("d(mean)/dV at V = 0", by_speed, 0.0, name, solver)


_SOLVERS = {
    "ForwardEuler": jt.ForwardEuler(dt=0.1),
    "BackwardEuler": jt.BackwardEuler(dt=0.1),
}


def _at_rest() -> Row:
    """The correlation and its slope at Re = 0."""
    with precision("float64"):
        at = jnp.zeros((), jnp.float64)
        average = lambda re: churchill_bernstein(re, jnp.asarray(0.707, jnp.float64))
        value, slope = jax.value_and_grad(average)(at)
    checks = (
        Bound("Nu(0) - 0.3", abs(float(value) - 0.3), 1e-12),
        Bound("dNu/dRe", float(slope), 1e3, 0.0),
    )
    return Row("Nu at Re = 0", dtype="float64", checks=checks)


def _slope(what: str, scene_of, at: float, name: str, solver) -> Row:
    """A derivative of the mean after a second, that must be finite."""

    def mean(value):
        run = jt.simulate(scene_of(value), 1.0, solver=solver, throw=False)
        return run.mean_temperature[-1, 0]

    try:
        with precision("float64"):
            found = jax.jit(jax.value_and_grad(mean))(jnp.asarray(at, jnp.float64))
            value, slope = (float(v) for v in found)
    except Exception as error:
        return broken(what, error, name, "float64")
    checks = (Bound("mean", value, HOT + 1e-9, COLD), Bound("slope", slope, 1e3, -1e3))
    return Row(what, name, "float64", seen=f"{slope:.4g}", checks=checks)


def _nothing_to_exchange() -> Iterator[Row]:
    """S18."""
    still = lambda t: (
        jt.Convection(10.0, t, on=jt.Side((0.0, 0.0, 1.0))),
        jt.FreeConvection(t),
        jt.Surroundings(t),
    )
    scene = _scene(*still(COLD), temperature=COLD)
    for method in damping(stable_step(scene), ratio=100.0):
        ran = run_nodes(scene, method.solver, method.end)
        moved = float(np.abs(ran.nodes[0] - COLD).max())
        check, what = Bound("moved", moved, 0.0), "all at 300 K"
        yield row_of(what, scene.dtype, method, ran, (COLD, COLD), more=(check,))
    for name, solver in _SOLVERS.items():
        by_air = lambda t: _scene(*still(t), temperature=COLD)
        yield _slope("d(mean)/dT_air", by_air, COLD, name, solver)


CASES = (
    Case(
        "S17",
        "h = 0, wind of 0 m/s and 1000 m/s",
        "Churchill and Bernstein, J. Heat Transfer 99 (1977) 300",
        "Nu(0) = 0.3 with finite slopes; bounds hold; the receipt notes a Re "
        "out of range",
        "",
        _winds,
    ),
    Case(
        "S18",
        "a body at the temperature of air and surroundings",
        "no difference, no heat; Ra^(1/4) has an infinite slope at 0",
        "nothing moves, bit by bit; slopes are finite",
        "",
        _nothing_to_exchange,
    ),
)
