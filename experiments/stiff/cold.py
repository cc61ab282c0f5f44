"""Emission at 0 K with its derivatives (S08), and between close temperatures (S09)."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.constants import STEFAN_BOLTZMANN

from .case import Case, Check, Row, broken
from .emission import EDGE, METAL, cube
from .solved import run_nodes


END = 0.01
"""Within the explicit limit [s]."""
SOLVERS = {
    "ForwardEuler": jt.ForwardEuler(dt=END / 4),
    "SuperTimeStepping": jt.SuperTimeStepping(dt=END / 4, stages=5),
    "BackwardEuler": jt.BackwardEuler(dt=END / 4),
    "CrankNicolson": jt.CrankNicolson(dt=END / 4),
    "TRBDF2": jt.TRBDF2(dt=END / 4),
}


def at_zero() -> Iterator[Row]:
    """S08."""
    for name, solver in SOLVERS.items():
        try:
            yield _derivatives(name, solver)
        except Exception as error:
            yield broken("from 0 K", error, name, "float64")


def _derivatives(name: str, solver) -> Row:
    """The mean at the end and its slope by the start, forward and reverse, at 0 K."""

    def mean(start):
        run = jt.simulate(cube(start), END, solver=solver, throw=False)
        return run.mean_temperature[-1, 0]

    @jax.jit
    def both(start):
        value, reverse = jax.value_and_grad(mean)(start)
        return value, reverse, jax.jvp(mean, (start,), (jnp.ones_like(start),))[1]

    with precision("float64"):
        found = both(jnp.asarray(0.0, jnp.float64))
        value, reverse, forward = (float(v) for v in found)
    # Nothing emits at 0 K: by the start the end moves by 1.
    checks = (
        Check("end", value, 300.0, 0.0),
        Check("reverse", reverse, 1 + 1e-6, 1 - 1e-2),
        Check("forward - reverse", abs(forward - reverse), 1e-9),
    )
    seen = f"ends at {value:.4g} K, slope {forward:.6g}"
    return Row("from 0 K", name, "float64", seen=seen, checks=checks)


GAP = 1e-3


def close_temperatures() -> Iterator[Row]:
    """S09."""
    yield _close("float64", "ForwardEuler")
    for name in SOLVERS:
        yield _close("float32", name)


def _close(dtype: str, name: str) -> Row:
    """The flux between close temperatures, of a step too short to change them."""
    # The surface lies half a voxel of metal away from its node.
    between = 4 * STEFAN_BOLTZMANN * 300.0**3 * EDGE / 2 / float(METAL.conductivity)
    exact = STEFAN_BOLTZMANN * ((300 + GAP) ** 4 - 300.0**4) / (1 + between)
    # Half a rounding of 300 K, over the gap: what the inputs themselves are off.
    rounding = 0.5 * float(np.spacing(np.asarray(300.0, dtype))) / GAP
    dt = 1e-6
    ran = run_nodes(cube(300.0 + GAP, dtype), type(SOLVERS[name])(dt=dt), dt)
    lost = -float(ran.solution.energy.mechanisms["emission"][-1])
    flux = lost / (dt * 6 * (2 * EDGE) ** 2)
    off = Check("relative error", abs(flux / exact - 1), max(1.5 * rounding, 1e-8))
    naive = STEFAN_BOLTZMANN * _naive(dtype)
    seen = f"{flux:.7f} W/m^2; exact {exact:.7f}, T1^4 - T2^4 {naive:.7f}"
    return Row(f"{GAP:g} K apart", name, dtype, seen=seen, checks=(off,))


def _naive(dtype: str) -> float:
    hot, cold = (np.asarray(t, dtype) for t in (300.0 + GAP, 300.0))
    return float(hot * hot * hot * hot - cold * cold * cold * cold)


CASES = (
    Case(
        "S08",
        "a body at 0 K: emission has slope 0 there",
        "finite value, forward and reverse derivative, which agree to 1e-9",
        f"d(T^4)/dT = 0 at 0 K; a cube of {METAL.volumetric_heat_capacity:.3g} J/m^3K",
        at_zero,
    ),
    Case(
        "S09",
        "emission between 300.001 K and 300 K",
        "as exact as the temperatures: 1.5 roundings of 300 K over the gap",
        "T1^4 - T2^4 = (T1 - T2)(T1 + T2)(T1^2 + T2^2)",
        close_temperatures,
    ),
)
