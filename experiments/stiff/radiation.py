"""Emission at any temperature (S06, S07, S08, S09) and grazing sources (S19)."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.constants import STEFAN_BOLTZMANN

from ..harness.case import Bound, Case, Row, broken
from .bodies import COLD, STEEL, block
from .methods import LONG, adaptive, damping, explicit, implicit, too_long
from .solved import Limits, Method, judged, run_nodes, stable_step


AROUND = 300.0
METAL = jt.Material(200.0, density=2700.0, specific_heat=900.0, emissivity=1.0)
EDGE = 1e-3
"""Edge of a voxel [m]; the cube's time constant is far below 1 s."""
MAX_NEWTON = 20
STEPS = (1.0, 1e4, 1e8, 1e12)
LIMITS = Limits(
    # Two roundings of 5800 K in float32.
    overshoot={"float64": 1e-9, "float32": 5e-3},
    energy={"float64": 1e-11, "float32": 1e-4},
)


def cube(start, dtype: str = "float64", around: float = AROUND) -> jt.Scene:
    """A metal cube in an enclosure.

    Args:
        start: its temperature [K].
        dtype: of the scene.
        around: temperature of the enclosure [K].
    """
    body = jt.Body(jt.FullVolume(block(2, 2, 2, EDGE)), METAL, temperature=start)
    return jt.Scene((body,), (jt.Surroundings(around),), dtype=dtype)


def _from(start: float) -> Iterator[Row]:
    bounds = (min(start, AROUND), max(start, AROUND))
    for dtype in ("float64", "float32"):
        scene = cube(start, dtype)
        stable = stable_step(scene)
        what = f"{start:g} K in {AROUND:g} K"
        methods = [
            *explicit(stable),
            *(m for dt in STEPS for m in implicit(dt, f"{dt:g} s", 1)),
            adaptive(1e3, error=0.1),
        ]
        for method in methods:
            # Newton's steps are counted over all stages: one for backward Euler.
            one = method.name.startswith(("BackwardEuler", "CrankNicolson"))
            max_newton = MAX_NEWTON if one else None
            yield judged(what, scene, method, bounds, LIMITS, max_newton)
        yield too_long(what, scene, LONG)


def _from_the_sun() -> Iterator[Row]:
    """S06."""
    return _from(5800.0)


def _from_near_zero() -> Iterator[Row]:
    """S07."""
    return _from(1e-3)


END = 0.01
"""Within the explicit limit [s]."""
SOLVERS = {
    "ForwardEuler": jt.ForwardEuler(dt=END / 4),
    "SuperTimeStepping": jt.SuperTimeStepping(dt=END / 4, stages=5),
    "BackwardEuler": jt.BackwardEuler(dt=END / 4),
    "CrankNicolson": jt.CrankNicolson(dt=END / 4),
    "TRBDF2": jt.TRBDF2(dt=END / 4),
}


def _at_zero() -> Iterator[Row]:
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
        Bound("end", value, 300.0, 0.0),
        Bound("reverse", reverse, 1 + 1e-6, 1 - 1e-2),
        Bound("forward - reverse", abs(forward - reverse), 1e-9),
    )
    seen = f"ends at {value:.4g} K, slope {forward:.6g}"
    return Row("from 0 K", name, "float64", seen=seen, checks=checks)


GAP = 1e-3


def _close_temperatures() -> Iterator[Row]:
    """S09."""
    yield _close("float64", "ForwardEuler")
    for name in SOLVERS:
        yield _close("float32", name)


def _close(dtype: str, name: str) -> Row:
    """The flux between close temperatures, of a step too short to change them."""
    # The surface lies half a voxel of metal away from its node.
    k = float(np.asarray(METAL.conductivity))
    between = 4 * STEFAN_BOLTZMANN * 300.0**3 * EDGE / 2 / k
    exact = STEFAN_BOLTZMANN * ((300 + GAP) ** 4 - 300.0**4) / (1 + between)
    # Half a rounding of 300 K, over the gap: what the inputs themselves are off.
    rounding = 0.5 * float(np.spacing(np.asarray(300.0, dtype))) / GAP
    dt = 1e-6
    ran = run_nodes(cube(300.0 + GAP, dtype), type(SOLVERS[name])(dt=dt), dt)
    lost = -float(ran.solution.energy.mechanisms["emission"][-1])
    flux = lost / (dt * 6 * (2 * EDGE) ** 2)
    off = Bound("relative error", abs(flux / exact - 1), max(1.5 * rounding, 1e-8))
    naive = STEFAN_BOLTZMANN * _naive(dtype)
    seen = f"{flux:.7f} W/m^2; exact {exact:.7f}, T1^4 - T2^4 {naive:.7f}"
    return Row(f"{GAP:g} K apart", name, dtype, seen=seen, checks=(off,))


def _naive(dtype: str) -> float:
    hot, cold = (np.asarray(t, dtype) for t in (300.0 + GAP, 300.0))
    return float(hot * hot * hot * hot - cold * cold * cold * cold)


PITCH = 0.01
PLACES = {
    "grazing, in the plane of the top": (1.0, 0.0, 0.03),
    "behind the top": (0.0, 0.0, -1.0),
    "on the surface": (0.005, 0.005, 0.03),
    "1 nm above it": (0.005, 0.005, 0.03 + 1e-9),
}
LEAST = 0.01
"""Distance from on which a source is a point [m]."""


def _grazing_sources() -> Iterator[Row]:
    """S19."""
    grid = block(6, 6, 6, PITCH)
    top = grid.fragment_normal[:, 2] > 0.9
    for what, place in PLACES.items():
        try:
            source = jt.PointSource(place, 1.0, min_distance=LEAST)
            found = source.exposure(
                grid.mesh.triangles,
                grid.fragment_position,
                grid.fragment_normal,
                grid.pitch,
            )
        except Exception as error:
            yield broken(what, error)
            continue
        brightest = float(found[top].max())
        dark = 0.0 if "above" not in what else 1 / LEAST**2
        checks = (
            Bound("exposure of the top", brightest, dark, 0.0),
            Bound("anywhere", float(found.max()), 1 / LEAST**2, 0.0),
        )
        yield Row(what, seen=f"top at most {brightest:.4g} 1/m^2", checks=checks)
    body = jt.Body(jt.FullVolume(grid), STEEL, temperature=COLD)
    lamp = jt.PointSource((1.0, 0.0, 0.03), 100.0, min_distance=LEAST)
    scene = jt.Scene((body,), (lamp,), dtype="float64")
    for method in damping(stable_step(scene), ratio=100.0)[:3]:
        yield _grazed(scene, method, grid)


def _grazed(scene: jt.Scene, method: Method, grid: jt.VoxelGrid) -> Row:
    """A lamp in the plane of the top: energy closes, and nothing cools."""
    try:
        ran = run_nodes(scene, method.solver, method.end)
    except Exception as error:
        return broken("a lamp that grazes", error, method.name, scene.dtype)
    cooled = COLD - float(ran.nodes[0].min())
    checks = (
        Bound("energy", ran.residual, 1e-12),
        Bound("cooled", cooled, 1e-8),
        Bound("not finite", float(not np.isfinite(ran.nodes[0]).all()), 0),
    )
    return Row(
        "a lamp that grazes",
        method.name,
        scene.dtype,
        energy_residual=ran.residual,
        compile_s=ran.compile_s,
        run_s=ran.run_s,
        result=ran.result,
        checks=checks,
    )


CASES = (
    Case(
        "S06",
        "emission from 5800 K into 300 K, steps of 1 to 1e12 s",
        "maximum principle; undamped Newton from the hot side takes 14 to 16 steps",
        "at most 20 steps of Newton's method; ends within [300, 5800] K",
        "",
        _from_the_sun,
    ),
    Case(
        "S07",
        "emission from 1 mK in 300 K, steps of 1 to 1e12 s",
        "maximum principle; undamped Newton takes 104 steps from there",
        "at most 20 steps of Newton's method; ends within [0.001, 300] K",
        "",
        _from_near_zero,
    ),
    Case(
        "S08",
        "a body at 0 K: emission has slope 0 there",
        f"d(T^4)/dT = 0 at 0 K; a cube of {METAL.volumetric_heat_capacity:.3g} J/m^3K",
        "finite value, forward and reverse derivative, which agree to 1e-9",
        "",
        _at_zero,
    ),
    Case(
        "S09",
        "emission between 300.001 K and 300 K",
        "T1^4 - T2^4 = (T1 - T2)(T1 + T2)(T1^2 + T2^2)",
        "as exact as the temperatures: 1.5 roundings of 300 K over the gap",
        "",
        _close_temperatures,
    ),
    Case(
        "S19",
        "a point source that grazes, stands behind or touches a surface",
        "I max(0, L . n) / max(R, R_0)^2",
        "max(0, L . n) is 0 there; 1 / R^2 stops at the least distance",
        "",
        _grazing_sources,
    ),
)
