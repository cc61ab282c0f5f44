"""Emission at any temperature (S06 to S09), air (S17), rest (S18), sources (S19)."""

import functools
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.choices import Dtype
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.physics.convection.nusselt import churchill_bernstein

from ..harness.case import Check, Row, attempt, case
from ..harness.scenes import single, stable_step
from .bodies import COLD, HOT, STEEL, block
from .solved import (
    LONG,
    Limits,
    Method,
    Observation,
    Ran,
    adaptive,
    damping,
    explicit,
    implicit,
    judged,
    run_nodes,
    steppers,
    too_long,
)


_AROUND = 300.0
_METAL = jt.Material(200.0, density=2700.0, specific_heat=900.0, emissivity=1.0)
# Edge of a voxel [m]; the cube's time constant is far below 1 s.
_EDGE = 1e-3
# Undamped steps from the hot side take 14 to 16.
_MAX_NEWTON = 20
_LIMITS = Limits(
    # Two roundings of 5800 K in float32.
    overshoot={"float64": 1e-9, "float32": 5e-3},
    energy={"float64": 1e-11, "float32": 1e-4},
)


def cube(start, dtype: Dtype = "float64") -> jt.Scene:
    """A metal cube in an enclosure."""
    grid = block(2, 2, 2, pitch=_EDGE)
    return single(grid, _METAL, start, jt.Surroundings(_AROUND), dtype=dtype)


def _from(start: float) -> Iterator[Row]:
    bounds = (min(start, _AROUND), max(start, _AROUND))
    for dtype in ("float64", "float32"):
        scene = cube(start, dtype)
        stable = stable_step(scene)
        label = f"{start:g} K in {_AROUND:g} K"
        steps = (1.0, 1e4, 1e8, 1e12)
        methods = [
            *explicit(stable),
            *(m for dt in steps for m in implicit(dt, f"{dt:g} s", steps=1)),
            adaptive(1e3, error=0.1),
        ]
        yield from judged(
            label=label,
            scene=scene,
            methods=methods,
            bounds=bounds,
            limits=_LIMITS,
            max_newton=_MAX_NEWTON,
        )
        yield too_long(label, scene, ratio=LONG)


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


@case(
    "S08",
    "a body at 0 K: emission has slope 0 there",
    f"d(T^4)/dT = 0 at 0 K; a cube of {_METAL.volumetric_heat_capacity:.3g} J/m^3K",
    "finite value, forward and reverse derivative, which agree to 1e-9",
)
def _at_zero() -> Iterator[Row]:
    for name, solver in steppers(_END / 4, stages=5).items():
        yield attempt(
            "from 0 K",
            functools.partial(_derivatives, solver),
            solver=name,
            dtype="float64",
        )


def _derivatives(solver) -> Row:
    """The mean at the end and its slope by the start, forward and reverse, at 0 K."""

    def mean(start):
        run = jt.simulate(cube(start), _END, solver=solver, throw=False)
        return run.mean_temperature[-1, 0]

    def forward_slope(start):
        _, slope = jax.jvp(mean, (start,), (jnp.ones_like(start),))
        return slope

    with precision("float64"):
        start = jnp.asarray(0.0, jnp.float64)
        value, reverse = map(float, jax.jit(jax.value_and_grad(mean))(start))
        forward = float(jax.jit(forward_slope)(start))
    # Nothing emits at 0 K: the end moves as much as the start.
    return Row(
        seen=f"ends at {value:.4g} K, slope {forward:.6g}",
        checks=(
            Check("end", value, highest=300.0, lowest=0.0),
            Check("reverse", reverse, highest=1 + 1e-6, lowest=1 - 1e-2),
            Check("forward - reverse", abs(forward - reverse), highest=1e-9),
        ),
    )


_GAP = 1e-3


@case(
    "S09",
    "emission between 300.001 K and 300 K",
    "T1^4 - T2^4 = (T1 - T2)(T1 + T2)(T1^2 + T2^2)",
    "as exact as the temperatures: 1.5 roundings of 300 K over the gap",
)
def _close_temperatures() -> Iterator[Row]:
    step = 1e-6
    methods = [Method(name, solver, step) for name, solver in steppers(step).items()]
    yield _close("float64", methods[0])
    for method in methods:
        yield _close("float32", method)


def _close(dtype: Dtype, method: Method) -> Row:
    """The flux between close temperatures, of a step too short to change them."""
    # The surface lies half a voxel of metal away from its node.
    k = float(np.asarray(_METAL.conductivity))
    between = 4 * STEFAN_BOLTZMANN * 300.0**3 * _EDGE / 2 / k
    exact = STEFAN_BOLTZMANN * ((300 + _GAP) ** 4 - 300.0**4) / (1 + between)
    # Half a rounding of 300 K over the gap: the error of the inputs themselves.
    rounding = 0.5 * float(np.spacing(np.asarray(300.0, dtype))) / _GAP
    ran = run_nodes(cube(300.0 + _GAP, dtype), method=method)
    lost = -float(ran.solution.energy.mechanisms["emission"][-1])
    flux = lost / (method.end * 6 * (2 * _EDGE) ** 2)
    relative_error = abs(flux / exact - 1)
    # The difference of fourth powers, which cancels in this precision.
    hot = np.asarray(300.0 + _GAP, dtype)
    cold = np.asarray(300.0, dtype)
    naive = STEFAN_BOLTZMANN * float(hot * hot * hot * hot - cold * cold * cold * cold)
    return Row(
        f"{_GAP:g} K apart",
        solver=method.name,
        dtype=dtype,
        seen=f"{flux:.7f} W/m^2; exact {exact:.7f}, T1^4 - T2^4 {naive:.7f}",
        checks=(Check("relative error", relative_error, max(1.5 * rounding, 1e-8)),),
    )


def _in_air(*terms, temperature=HOT) -> jt.Scene:
    return single(block(4, 4, 6, pitch=0.01), STEEL, temperature, *terms)


def _in_wind(speed) -> jt.Scene:
    return _in_air(jt.Wind((1.0, 0.0, 0.0), COLD, speed=speed))


@case(
    "S17",
    "h = 0, wind of 0 m/s and 1000 m/s",
    "Churchill and Bernstein, J. Heat Transfer 99 (1977) 300",
    "Nu(0) = 0.3 with finite slopes; bounds hold; the receipt notes a Re out of range",
)
def _winds() -> Iterator[Row]:
    yield _at_rest()
    for label, term in {
        "h = 0": jt.Convection(0.0, COLD),
        "V = 0": jt.Wind((0.0, 0.0, 0.0), COLD),
    }.items():
        method = Method("", jt.ForwardEuler(), end=10.0)
        ran = run_nodes(_in_air(term), method=method)
        reasons = [omission.why for omission in ran.solution.receipt.left_out]
        yield Row(
            label,
            solver="ForwardEuler",
            dtype="float64",
            seen=str(reasons),
            checks=(Check("moved", ran.moved(HOT), 0.0),),
        )
    for speed in (1e-6, 1e3):
        scene = _in_wind(speed)
        methods = damping(scene, ratio=100.0)
        yield from judged(
            label=f"V = {speed:g} m/s", scene=scene, methods=methods, bounds=(COLD, HOT)
        )
    notes = jt.compile_scene(_in_wind(1e3)).receipt.notes
    yield Row(
        "V = 1000 m/s: the receipt",
        seen="; ".join(notes),
        checks=(Check("notes", len(notes), highest=np.inf, lowest=1),),
    )
    yield from _slopes("d(mean)/dV at V = 0", _in_wind, value=0.0)


def _at_rest() -> Row:
    """The correlation and its slope at Re = 0."""
    with precision("float64"):
        prandtl = jnp.asarray(0.707, jnp.float64)
        value, slope = jax.value_and_grad(churchill_bernstein)(
            jnp.zeros((), jnp.float64), prandtl
        )
    checks = (
        Check("Nu(0) - 0.3", abs(float(value) - 0.3), 1e-12),
        # The slope of sqrt(Re) is infinite at Re = 0.
        Check("dNu/dRe", float(slope), highest=1e3, lowest=0.0),
    )
    return Row("Nu at Re = 0", dtype="float64", checks=checks)


def _slopes(label: str, scene_of, value: float) -> Iterator[Row]:
    """Derivatives of the mean after a second at a value, which must be finite."""
    for solver in (jt.ForwardEuler(dt=0.1), jt.BackwardEuler(dt=0.1)):
        yield attempt(
            label,
            functools.partial(_slope, scene_of, value, solver),
            solver=type(solver).__name__,
            dtype="float64",
        )


def _slope(scene_of, value: float, solver) -> Row:
    def mean_at(value):
        run = jt.simulate(scene_of(value), 1.0, solver=solver, throw=False)
        return run.mean_temperature[-1, 0]

    with precision("float64"):
        mean, slope = jax.jit(jax.value_and_grad(mean_at))(
            jnp.asarray(value, jnp.float64)
        )
    return Row(
        seen=f"{float(slope):.4g}",
        checks=(
            Check("mean", float(mean), highest=HOT + 1e-9, lowest=COLD),
            Check("slope", float(slope), highest=1e3, lowest=-1e3),
        ),
    )


def _at_equilibrium(temperature) -> jt.Scene:
    """A body at 300 K, with air and surroundings of one temperature [K]."""
    return _in_air(
        jt.Convection(10.0, temperature, on=jt.Side((0.0, 0.0, 1.0))),
        jt.FreeConvection(temperature),
        jt.Surroundings(temperature),
        temperature=COLD,
    )


@case(
    "S18",
    "a body at the temperature of air and surroundings",
    "no difference, no heat; Ra^(1/4) has an infinite slope at 0",
    "nothing moves, bit by bit; slopes are finite",
)
def _nothing_to_exchange() -> Iterator[Row]:
    scene = _at_equilibrium(COLD)

    def change_from_start(ran: Ran) -> Observation:
        return Observation(checks=(Check("moved", ran.moved(COLD), 0.0),))

    yield from judged(
        label="all at 300 K",
        scene=scene,
        methods=damping(scene, ratio=100.0),
        bounds=(COLD, COLD),
        observe=change_from_start,
    )
    yield from _slopes("d(mean)/dT_air", _at_equilibrium, value=COLD)


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
    grid = block(6, 6, 6, pitch=0.01)
    for label in _PLACES:
        yield attempt(label, lambda label=label: _exposed(label, grid))
    lamp = jt.PointSource((1.0, 0.0, 0.03), 100.0, min_distance=_LEAST)
    scene = single(grid, STEEL, COLD, lamp)
    for method in damping(scene, ratio=100.0)[:3]:
        yield attempt(
            "a lamp that grazes",
            lambda method=method: _grazed(scene, method),
            solver=method.name,
            dtype=scene.dtype,
        )


def _exposed(label: str, grid: jt.VoxelGrid) -> Row:
    """The brightness of a block by a source, on its top and anywhere."""
    source = jt.PointSource(_PLACES[label], 1.0, min_distance=_LEAST)
    normal = grid.fragment_normal
    exposure = source.exposure(
        grid.mesh.triangles, grid.fragment_position, normal, grid.pitch
    )
    brightest = float(exposure[normal[:, 2] > 0.9].max())
    dark = 0.0 if "above" not in label else 1 / _LEAST**2
    checks = (
        Check("exposure of the top", brightest, highest=dark, lowest=0.0),
        Check("anywhere", float(exposure.max()), highest=1 / _LEAST**2, lowest=0.0),
    )
    return Row(seen=f"top at most {brightest:.4g} 1/m^2", checks=checks)


def _grazed(scene: jt.Scene, method: Method) -> Row:
    """A lamp in the plane of the top: energy closes, and nothing cools."""
    ran = run_nodes(scene, method=method)
    (nodes,) = ran.nodes
    checks = (
        Check("energy", ran.residual, 1e-12),
        Check("cooled", COLD - float(nodes.min()), 1e-8),
        Check("not finite", float(not np.isfinite(nodes).all()), 0),
    )
    return Row(
        energy_residual=ran.residual,
        compile_s=ran.compile_s,
        run_s=ran.run_s,
        result=ran.result,
        checks=checks,
    )


CASES = (
    _from_the_sun,
    _from_near_zero,
    _at_zero,
    _close_temperatures,
    _winds,
    _nothing_to_exchange,
    _grazing_sources,
)
