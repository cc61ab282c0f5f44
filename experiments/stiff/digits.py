"""Precision of float32: slow changes (S10) and sums over 1e7 voxels (S20)."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.network.network import precise_sum

from ..harness.case import REPORTED, Bound, Case, Row
from .bodies import COLD, HOT, STEEL, block, two_halves
from .solved import Method, row_of, run_nodes


FLUX, STEPS = 31.15, 1000
"""Heat flux of the thesis' table 5.1 [W/m^2], and number of steps of 1 s."""
METALS = {
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


def heated(metal: jt.Material, pitch: float, dtype: str) -> jt.Scene:
    """One voxel, heated from one side.

    Args:
        metal: of the voxel.
        pitch: its edge [m].
        dtype: of the scene.
    """
    side = jt.HeatFlux(FLUX, on=jt.Side((1.0, 0.0, 0.0)))
    body = jt.Body(jt.FullVolume(block(1, 1, 1, pitch)), metal, temperature=300.0)
    return jt.Scene((body,), (side,), dtype=dtype)


def _slow_changes() -> Iterator[Row]:
    """S10."""
    for name in METALS:
        yield _rise(name, "float64", "ForwardEuler")
        for solver in SOLVERS:
            yield _rise(name, "float32", solver)
    yield _stored_as_kelvin()


def _rise(name: str, dtype: str, solver: str) -> Row:
    """Temperature rise of a cubic metre after all steps."""
    metal, stated = METALS[name]
    exact = FLUX * STEPS / float(metal.volumetric_heat_capacity)
    method = Method(solver, SOLVERS[solver], float(STEPS))
    ran = run_nodes(heated(metal, 1.0, dtype), method.solver, method.end)
    rise = float(ran.nodes[0][0]) - 300.0
    checks = (
        Bound("relative error", abs(rise / exact - 1), 1e-3),
        Bound("off the table", abs(rise / STEPS / stated - 1), 5e-3),
    )
    what, bounds = f"{name}, 1 m^3", (300.0, 300.0 + exact + _under_surface(metal))
    row = row_of(what, dtype, method, ran, bounds, more=checks)
    return row._replace(seen=f"+{rise:.6f} K, exact {exact:.6f} K")


def _under_surface(metal: jt.Material) -> float:
    """Excess of the heated surface over its node, half a metre below it [K]."""
    return FLUX * 0.5 / float(np.asarray(metal.conductivity))


def _stored_as_kelvin() -> Row:
    """The same if 300 K were part of what is stored."""
    copper, _ = METALS["copper"]
    exact = FLUX * STEPS / float(copper.volumetric_heat_capacity)
    temperature, rise = np.float32(300.0), np.float32(exact / STEPS)
    for _ in range(STEPS):
        temperature = temperature + rise
    seen = f"+{float(temperature) - 300:.6f} K if temperatures were stored themselves"
    return Row("copper, for comparison", "ForwardEuler", "float32", seen=seen)


SIDE = 216
"""Voxels along each edge: 1.008e7."""


def _many_voxels() -> Iterator[Row]:
    """S20."""
    values = np.random.default_rng(0).uniform(0, 100, 10**7).astype(np.float32)
    exact = float(values.sum(dtype=np.float64))
    off = lambda total: abs(float(total) / exact - 1)
    found = off(jax.jit(precise_sum)(jnp.asarray(values)))
    yield Row(
        "1e7 values, blocks of 64",
        dtype="float32",
        seen=f"off by {found:.2g}",
        checks=(Bound("relative error", found, 1e-6),),
    )
    in_turn = off(np.cumsum(values, dtype=np.float32)[-1])
    yield Row(
        "1e7 values, one after the other",
        dtype="float32",
        seen=f"off by {in_turn:.2g}",
        if_met=REPORTED,
    )
    body = jt.Body(
        jt.FullVolume(block(SIDE, SIDE, SIDE, 1e-3)), STEEL, temperature=two_halves
    )
    scene = jt.Scene((body,), (), dtype="float32")
    solver = jt.ForwardEuler()
    ran = run_nodes(scene, solver, 0.5)
    drift = Bound("energy drift", ran.residual, 1e-6)
    method = Method("ForwardEuler, at its limit", solver, 0.5)
    yield row_of(
        f"{SIDE**3:.3g} voxels", "float32", method, ran, (COLD, HOT), more=(drift,)
    )


CASES = (
    Case(
        "S10",
        "changes below one rounding of 300 K a step: table 5.1 of the thesis",
        "q A / (rho c V); one float32 rounding of 300 K is 3.05e-5 K",
        "the rise after 1000 steps of 1 s, to 1e-3, and the table's three digits",
        "",
        _slow_changes,
    ),
    Case(
        "S20",
        "energy of 1e7 voxels in float32",
        "pairwise summation: error of order eps log n",
        "sums and the ledger's drift to 1e-6",
        "",
        _many_voxels,
    ),
)
