"""Precision of float32: slow changes (S10) and sums over 1e7 voxels (S20)."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.network.network import precise_sum

from ..harness.case import REPORTED, Bound, Row, case
from .bodies import COLD, FLUX, HOT, STEEL, block, heated, single, two_halves
from .solved import Method, Ran, judged


# In steps of 1 s.
_STEPS = 1000
# With the rates of the thesis' table 5.1 [K/s].
_METALS = {
    "copper": (jt.Material(401.0, 8960.0, 385.0), 9.01e-6),
    "lead": (jt.Material(35.0, 11340.0, 128.0), 2.15e-5),
}
SOLVERS = {
    "ForwardEuler": jt.ForwardEuler(dt=1.0),
    "SuperTimeStepping": jt.SuperTimeStepping(dt=1.0, stages=3),
    "BackwardEuler": jt.BackwardEuler(dt=1.0),
    "CrankNicolson": jt.CrankNicolson(dt=1.0),
    "TRBDF2": jt.TRBDF2(dt=1.0),
    "TRBDF2, adaptive": jt.TRBDF2(),
}


@case(
    "S10",
    "changes below one rounding of 300 K a step: table 5.1 of the thesis",
    "q A / (rho c V); one float32 rounding of 300 K is 3.05e-5 K",
    "the rise after 1000 steps of 1 s, to 1e-3, and the table's three digits",
)
def _slow_changes() -> Iterator[Row]:
    for name in _METALS:
        yield _rise(name, "float64", "ForwardEuler")
        for solver in SOLVERS:
            yield _rise(name, "float32", solver)
    yield _stored_as_kelvin()


def _rise(name: str, dtype: str, solver: str) -> Row:
    """Temperature rise of a cubic metre after all steps."""
    metal, stated = _METALS[name]
    exact = FLUX * _STEPS / float(metal.volumetric_heat_capacity)

    def more(ran: Ran):
        rise = float(ran.nodes[0][0]) - 300.0
        return f"+{rise:.6f} K, exact {exact:.6f} K", (
            Bound("relative error", abs(rise / exact - 1), 1e-3),
            # Half a unit of the table's third digit.
            Bound("off the table", abs(rise / _STEPS / stated - 1), 5e-3),
        )

    # The heated surface is warmer than its node, half a metre below it.
    under = FLUX * 0.5 / float(np.asarray(metal.conductivity))
    method = Method(solver, SOLVERS[solver], float(_STEPS))
    bounds = (300.0, 300.0 + exact + under)
    return judged(f"{name}, 1 m^3", heated(metal, 1.0, dtype), method, bounds, more)


def _stored_as_kelvin() -> Row:
    """The same if 300 K were part of what is stored."""
    copper, _ = _METALS["copper"]
    exact = FLUX * _STEPS / float(copper.volumetric_heat_capacity)
    temperature, rise = np.float32(300.0), np.float32(exact / _STEPS)
    # One by one: each sum is rounded.
    for _ in range(_STEPS):
        temperature = temperature + rise
    seen = f"+{float(temperature) - 300:.6f} K if temperatures were stored themselves"
    return Row("copper, for comparison", "ForwardEuler", "float32", seen=seen)


# Voxels along each edge: 1.008e7.
_SIDE = 216


@case(
    "S20",
    "energy of 1e7 voxels in float32",
    "pairwise summation: error of order eps log n",
    "sums and the ledger's drift to 1e-6",
)
def _many_voxels() -> Iterator[Row]:
    values = np.random.default_rng(0).uniform(0, 100, 10**7).astype(np.float32)
    exact = float(values.sum(dtype=np.float64))
    off = lambda total: abs(float(total) / exact - 1)
    found = off(jax.jit(precise_sum)(jnp.asarray(values)))
    check, seen = Bound("relative error", found, 1e-6), f"off by {found:.2g}"
    yield Row("1e7 values, blocks of 64", "", "float32", seen=seen, checks=(check,))
    # `cumsum` adds them in turn, which `sum` does not.
    seen = f"off by {off(np.cumsum(values, dtype=np.float32)[-1]):.2g}"
    what = "1e7 values, one after the other"
    yield Row(what, "", "float32", seen=seen, if_met=REPORTED)
    grid = block(_SIDE, _SIDE, _SIDE, 1e-3)
    scene = single(grid, STEEL, two_halves, dtype="float32")
    method = Method("ForwardEuler, at its limit", jt.ForwardEuler(), 0.5)
    drift = lambda ran: ("", (Bound("energy drift", ran.residual, 1e-6),))
    yield judged(f"{_SIDE**3:.3g} voxels", scene, method, (COLD, HOT), drift)


CASES = (_slow_changes, _many_voxels)
