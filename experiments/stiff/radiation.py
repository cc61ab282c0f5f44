"""Emission at any temperature (S06 to S09), air (S17), rest (S18), sources (S19)."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.physics.convection.nusselt import churchill_bernstein

from ..harness.case import Bound, Row, attempt, case
from .bodies import COLD, HOT, STEEL, block, single
from .solved import (
    LONG,
    Limits,
    Method,
    adaptive,
    damping,
    explicit,
    implicit,
    judged,
    run_nodes,
    stable_step,
    too_long,
)


_AROUND = 300.0
_METAL = jt.Material(200.0, density=2700.0, specific_heat=900.0, emissivity=1.0)
# Of a voxel [m]; the cube's time constant is far below 1 s.
_EDGE = 1e-3
# Undamped steps from the hot side take 14 to 16.
_MAX_NEWTON = 20
_LIMITS = Limits(
    # Two roundings of 5800 K in float32.
    overshoot={"float64": 1e-9, "float32": 5e-3},
    energy={"float64": 1e-11, "float32": 1e-4},
)


def _cube(start, dtype: str = "float64") -> jt.Scene:
    """A metal cube in an enclosure."""
    around = jt.Surroundings(_AROUND)
    return single(block(2, 2, 2, _EDGE), _METAL, start, around, dtype=dtype)


def _from(start: float) -> Iterator[Row]:
    bounds = (min(start, _AROUND), max(start, _AROUND))
    for dtype in ("float64", "float32"):
        scene = _cube(start, dtype)
        stable = stable_step(scene)
        what = f"{start:g} K in {_AROUND:g} K"
        steps = (1.0, 1e4, 1e8, 1e12)
        methods = [
            *explicit(stable),
            *(m for dt in steps for m in implicit(dt, f"{dt:g} s", 1)),
            adaptive(1e3, error=0.1),
        ]
        for method in methods:
            # Newton's steps are counted over all stages: one for backward Euler.
            one = method.name.startswith(("BackwardEuler", "CrankNicolson"))
            most = _MAX_NEWTON if one else None
            yield judged(what, scene, method, bounds, limits=_LIMITS, max_newton=most)
        yield too_long(what, scene, LONG)


@case(
    "S06",
    "emission from 5800 K into 300 K, steps of 1 to 1e12 s",
    "maximum principle; undamped Newton from the hot side takes 14 to 16 steps",
    "at most 20 steps of Newton's method; ends within [300, 5800] K",
)
def _from_the_sun() -> Iterator[Row]:
    return _from(5800.0)


@case(
    "S07",
    "emission from 1 mK in 300 K, steps of 1 to 1e12 s",
    "maximum principle; undamped Newton takes 104 steps from there",
    "at most 20 steps of Newton's method; ends within [0.001, 300] K",
)
def _from_near_zero() -> Iterator[Row]:
    return _from(1e-3)


# Within the explicit limit [s].
_END = 0.01
_SOLVERS = {
    "ForwardEuler": jt.ForwardEuler(dt=_END / 4),
    "SuperTimeStepping": jt.SuperTimeStepping(dt=_END / 4, stages=5),
    "BackwardEuler": jt.BackwardEuler(dt=_END / 4),
    "CrankNicolson": jt.CrankNicolson(dt=_END / 4),
    "TRBDF2": jt.TRBDF2(dt=_END / 4),
}


@case(
    "S08",
    "a body at 0 K: emission has slope 0 there",
    f"d(T^4)/dT = 0 at 0 K; a cube of {_METAL.volumetric_heat_capacity:.3g} J/m^3K",
    "finite value, forward and reverse derivative, which agree to 1e-9",
)
def _at_zero() -> Iterator[Row]:
    for name, solver in _SOLVERS.items():
        derive = lambda n=name, s=solver: _derivatives(n, s)
        yield attempt("from 0 K", derive, name, "float64")


def _derivatives(name: str, solver) -> Row:
    """The mean at the end and its slope by the start, forward and reverse, at 0 K."""

    def mean(start):
        run = jt.simulate(_cube(start), _END, solver=solver, throw=False)
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


_GAP = 1e-3


@case(
    "S09",
    "emission between 300.001 K and 300 K",
    "T1^4 - T2^4 = (T1 - T2)(T1 + T2)(T1^2 + T2^2)",
    "as exact as the temperatures: 1.5 roundings of 300 K over the gap",
)
def _close_temperatures() -> Iterator[Row]:
    yield _close("float64", "ForwardEuler")
    for name in _SOLVERS:
        yield _close("float32", name)


def _close(dtype: str, name: str) -> Row:
    """The flux between close temperatures, of a step too short to change them."""
    # The surface lies half a voxel of metal away from its node.
    k = float(np.asarray(_METAL.conductivity))
    between = 4 * STEFAN_BOLTZMANN * 300.0**3 * _EDGE / 2 / k
    exact = STEFAN_BOLTZMANN * ((300 + _GAP) ** 4 - 300.0**4) / (1 + between)
    # Half a rounding of 300 K, over the gap: what the inputs themselves are off.
    rounding = 0.5 * float(np.spacing(np.asarray(300.0, dtype))) / _GAP
    dt = 1e-6
    method = Method(name, type(_SOLVERS[name])(dt=dt), dt)
    ran = run_nodes(_cube(300.0 + _GAP, dtype), method)
    lost = -float(ran.solution.energy.mechanisms["emission"][-1])
    flux = lost / (dt * 6 * (2 * _EDGE) ** 2)
    off = Bound("relative error", abs(flux / exact - 1), max(1.5 * rounding, 1e-8))
    # The difference of fourth powers, which cancels in this precision.
    hot, cold = (np.asarray(t, dtype) for t in (300.0 + _GAP, 300.0))
    naive = STEFAN_BOLTZMANN * float(hot * hot * hot * hot - cold * cold * cold * cold)
    seen = f"{flux:.7f} W/m^2; exact {exact:.7f}, T1^4 - T2^4 {naive:.7f}"
    return Row(f"{_GAP:g} K apart", name, dtype, seen=seen, checks=(off,))


_SLOPE_SOLVERS = {
    "ForwardEuler": jt.ForwardEuler(dt=0.1),
    "BackwardEuler": jt.BackwardEuler(dt=0.1),
}


def _in_air(*terms, temperature=HOT) -> jt.Scene:
    return single(block(4, 4, 6, 0.01), STEEL, temperature, *terms)


@case(
    "S17",
    "h = 0, wind of 0 m/s and 1000 m/s",
    "Churchill and Bernstein, J. Heat Transfer 99 (1977) 300",
    "Nu(0) = 0.3 with finite slopes; bounds hold; the receipt notes a Re out of range",
)
def _winds() -> Iterator[Row]:
    yield _at_rest()
    for what, term in {
        "h = 0": jt.Convection(0.0, COLD),
        "V = 0": jt.Wind((0.0, 0.0, 0.0), COLD),
    }.items():
        ran = run_nodes(_in_air(term), Method("", jt.ForwardEuler(), 10.0))
        left_out = [o.why for o in ran.solution.receipt.left_out]
        check = Bound("moved", ran.moved(HOT), 0.0)
        yield Row(what, "ForwardEuler", "float64", seen=str(left_out), checks=(check,))
    wind = lambda v: _in_air(jt.Wind((1.0, 0.0, 0.0), COLD, speed=v))
    for speed in (1e-6, 1e3):
        for method in damping(wind(speed), ratio=100.0):
            yield judged(f"V = {speed:g} m/s", wind(speed), method, (COLD, HOT))
    notes = jt.compile_scene(wind(1e3)).receipt.notes
    noted = Bound("notes", len(notes), np.inf, 1)
    yield Row("V = 1000 m/s: the receipt", seen="; ".join(notes), checks=(noted,))
    for name, solver in _SLOPE_SOLVERS.items():
        yield _slope("d(mean)/dV at V = 0", wind, 0.0, name, solver)


def _at_rest() -> Row:
    """The correlation and its slope at Re = 0."""
    with precision("float64"):
        at = jnp.zeros((), jnp.float64)
        average = lambda re: churchill_bernstein(re, jnp.asarray(0.707, jnp.float64))
        value, slope = jax.value_and_grad(average)(at)
    checks = (
        Bound("Nu(0) - 0.3", abs(float(value) - 0.3), 1e-12),
        # The slope of sqrt(Re) is infinite there.
        Bound("dNu/dRe", float(slope), 1e3, 0.0),
    )
    return Row("Nu at Re = 0", dtype="float64", checks=checks)


def _slope(what: str, scene_of, at: float, name: str, solver) -> Row:
    """A derivative of the mean after a second, that must be finite."""

    def mean(value):
        run = jt.simulate(scene_of(value), 1.0, solver=solver, throw=False)
        return run.mean_temperature[-1, 0]

    def measure() -> Row:
        with precision("float64"):
            found = jax.jit(jax.value_and_grad(mean))(jnp.asarray(at, jnp.float64))
            value, slope = (float(v) for v in found)
        finite = Bound("slope", slope, 1e3, -1e3)
        checks = (Bound("mean", value, HOT + 1e-9, COLD), finite)
        return Row(what, name, "float64", seen=f"{slope:.4g}", checks=checks)

    return attempt(what, measure, name, "float64")


@case(
    "S18",
    "a body at the temperature of air and surroundings",
    "no difference, no heat; Ra^(1/4) has an infinite slope at 0",
    "nothing moves, bit by bit; slopes are finite",
)
def _nothing_to_exchange() -> Iterator[Row]:
    still = lambda t: _in_air(
        jt.Convection(10.0, t, on=jt.Side((0.0, 0.0, 1.0))),
        jt.FreeConvection(t),
        jt.Surroundings(t),
        temperature=COLD,
    )
    scene = still(COLD)
    same = lambda ran: ("", (Bound("moved", ran.moved(COLD), 0.0),))
    for method in damping(scene, ratio=100.0):
        yield judged("all at 300 K", scene, method, (COLD, COLD), same)
    for name, solver in _SLOPE_SOLVERS.items():
        yield _slope("d(mean)/dT_air", still, COLD, name, solver)


_PLACES = {
    "grazing, in the plane of the top": (1.0, 0.0, 0.03),
    "behind the top": (0.0, 0.0, -1.0),
    "on the surface": (0.005, 0.005, 0.03),
    "1 nm above it": (0.005, 0.005, 0.03 + 1e-9),
}
# Distance from on which a source is a point [m].
_LEAST = 0.01


@case(
    "S19",
    "a point source that grazes, stands behind or touches a surface",
    "I max(0, L . n) / max(R, R_0)^2",
    "max(0, L . n) is 0 there; 1 / R^2 stops at the least distance",
)
def _grazing_sources() -> Iterator[Row]:
    grid = block(6, 6, 6, 0.01)
    for what in _PLACES:
        yield attempt(what, lambda what=what: _exposed(what, grid))
    lamp = jt.PointSource((1.0, 0.0, 0.03), 100.0, min_distance=_LEAST)
    scene = single(grid, STEEL, COLD, lamp)
    for method in damping(scene, ratio=100.0)[:3]:
        graze = lambda method=method: _grazed(scene, method)
        yield attempt("a lamp that grazes", graze, method.name, scene.dtype)


def _exposed(what: str, grid: jt.VoxelGrid) -> Row:
    """The brightness of a block by a source, on its top and anywhere."""
    source = jt.PointSource(_PLACES[what], 1.0, min_distance=_LEAST)
    where, normal = grid.fragment_position, grid.fragment_normal
    found = source.exposure(grid.mesh.triangles, where, normal, grid.pitch)
    brightest = float(found[normal[:, 2] > 0.9].max())
    dark = 0.0 if "above" not in what else 1 / _LEAST**2
    checks = (
        Bound("exposure of the top", brightest, dark, 0.0),
        Bound("anywhere", float(found.max()), 1 / _LEAST**2, 0.0),
    )
    return Row(what, seen=f"top at most {brightest:.4g} 1/m^2", checks=checks)


def _grazed(scene: jt.Scene, method: Method) -> Row:
    """A lamp in the plane of the top: energy closes, and nothing cools."""
    ran = run_nodes(scene, method)
    checks = (
        Bound("energy", ran.residual, 1e-12),
        Bound("cooled", COLD - float(ran.nodes[0].min()), 1e-8),
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
    *(_from_the_sun, _from_near_zero, _at_zero, _close_temperatures, _winds),
    *(_nothing_to_exchange, _grazing_sources),
)
