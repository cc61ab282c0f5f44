"""Little changes (S10, S20), contact (S11), islands (S12), nothing (S13 to S15)."""

from collections.abc import Iterator
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.choices import Dtype
from jaxthermo.geometry.mesh import joined
from jaxthermo.network.network import precise_sum
from jaxthermo.physics.conduction import series

from ..harness.case import REPORTED, Check, Row, attempt, case, exactly, refusal
from ..harness.scenes import full, single
from .bodies import (
    COLD,
    COPPER,
    HOT,
    STEEL,
    block,
    insulated,
    rod,
    two_halves,
)
from .contrasts import through_all
from .solved import (
    Method,
    Observation,
    Ran,
    damping,
    judged,
    run_nodes,
    steppers,
    too_long,
)


# Heat flux of the thesis' table 5.1 [W/m^2].
_FLUX = 31.15


def _heated(metal: jt.Material, pitch: float, dtype: Dtype) -> jt.Scene:
    """One voxel of an edge [m], heated from one side."""
    side = jt.HeatFlux(_FLUX, on=jt.Side((1.0, 0.0, 0.0)))
    grid = block(1, 1, 1, pitch=pitch)
    return single(grid, metal, 300.0, side, dtype=dtype)


# In steps of 1 s.
_STEPS = 1000
# With the rates of the thesis' table 5.1 [K/s].
_METALS = {
    "copper": (jt.Material(401.0, 8960.0, 385.0), 9.01e-6),
    "lead": (jt.Material(35.0, 11340.0, 128.0), 2.15e-5),
}
_METHODS = [
    Method(name, solver, end=float(_STEPS))
    for name, solver in (
        *steppers(1.0, stages=3).items(),
        ("TRBDF2, adaptive", jt.TRBDF2()),
    )
]


@case(
    "S10",
    "changes below one rounding of 300 K a step: table 5.1 of the thesis",
    "q A / (rho c V); one float32 rounding of 300 K is 3.05e-5 K",
    "the rise after 1000 steps of 1 s, to 1e-3, and the table's three digits",
)
def _slow_changes() -> Iterator[Row]:
    for name in _METALS:
        yield from _rises(name, "float64", _METHODS[:1])
        yield from _rises(name, "float32", _METHODS)
    yield _stored_as_kelvin()


def _rises(name: str, dtype: Dtype, methods: list[Method]) -> Iterator[Row]:
    """Temperature rise of a cubic metre after all steps."""
    metal, stated_rate = _METALS[name]
    exact = _FLUX * _STEPS / float(metal.volumetric_heat_capacity)

    def temperature_rise(ran: Ran) -> Observation:
        rise = float(ran.nodes[0][0]) - 300.0
        return Observation(
            seen=f"+{rise:.6f} K, exact {exact:.6f} K",
            checks=(
                Check("relative error", abs(rise / exact - 1), 1e-3),
                # Half a unit of the table's third digit.
                Check("off the table", abs(rise / _STEPS / stated_rate - 1), 5e-3),
            ),
        )

    # The heated surface is warmer than its node, half a metre below it.
    surface_excess = _FLUX * 0.5 / float(np.asarray(metal.conductivity))
    return judged(
        label=f"{name}, 1 m^3",
        scene=_heated(metal, pitch=1.0, dtype=dtype),
        methods=methods,
        bounds=(300.0, 300.0 + exact + surface_excess),
        observe=temperature_rise,
    )


def _stored_as_kelvin() -> Row:
    """The same if 300 K were part of what is stored."""
    copper, _ = _METALS["copper"]
    exact = _FLUX * _STEPS / float(copper.volumetric_heat_capacity)
    temperature = np.float32(300.0)
    rise_per_step = np.float32(exact / _STEPS)
    # One by one: each sum is rounded.
    for _ in range(_STEPS):
        temperature = temperature + rise_per_step
    rise = float(temperature) - 300
    return Row(
        "copper, for comparison",
        solver="ForwardEuler",
        dtype="float32",
        seen=f"+{rise:.6f} K if temperatures were stored themselves",
    )


# Voxels along each edge: 1.008e7.
_SIDE = 216


@case(
    "S20",
    "energy of 1e7 voxels in float32",
    "pairwise summation: error of order eps log n",
    "sums and the ledger's drift to 1e-6",
)
def _many_voxels() -> Iterator[Row]:
    random = np.random.default_rng(0)
    values = random.uniform(0, 100, 10**7).astype(np.float32)
    exact = float(values.sum(dtype=np.float64))

    def relative_error(total) -> float:
        return abs(float(total) / exact - 1)

    blockwise_error = relative_error(jax.jit(precise_sum)(jnp.asarray(values)))
    yield Row(
        "1e7 values, blocks of 64",
        dtype="float32",
        seen=f"off by {blockwise_error:.2g}",
        checks=(Check("relative error", blockwise_error, 1e-6),),
    )
    # `cumsum` adds the values one after the other, which `sum` does not.
    sequential_error = relative_error(np.cumsum(values, dtype=np.float32)[-1])
    yield Row(
        "1e7 values, one after the other",
        dtype="float32",
        seen=f"off by {sequential_error:.2g}",
        if_met=REPORTED,
    )
    grid = block(_SIDE, _SIDE, _SIDE, 1e-3)
    scene = single(grid, STEEL, two_halves, dtype="float32")
    method = Method("ForwardEuler, at its limit", jt.ForwardEuler(), 0.5)

    def energy_drift(ran: Ran) -> Observation:
        return Observation(checks=(Check("energy drift", ran.residual, 1e-6),))

    label = f"{_SIDE**3:.3g} voxels"
    yield from judged(
        label=label,
        scene=scene,
        methods=[method],
        bounds=(COLD, HOT),
        observe=energy_drift,
    )


_PITCH = 0.01
_CELLS = 4


def _pair(conductance: float) -> jt.Scene:
    """A hot and a cold block end to end, with a contact of h_c [W/(m^2 K)]."""
    grid = block(_CELLS, 3, 3, pitch=_PITCH)
    half_length = _CELLS * _PITCH / 2
    hot = full(grid=grid, material=STEEL, temperature=HOT, x=-half_length)
    cold = full(grid=grid, material=STEEL, temperature=COLD, x=half_length)
    contact = jt.Contact(conductance)
    return jt.Scene((hot, cold), (contact,), dtype="float64")


@case(
    "S11",
    "contact conductances of 0, 1 to 1e6 and infinity",
    "resistances in series, 1 / (R1 + 1 / h_c A + R2)",
    "infinity is one body, to 1e-10 of the difference; 0 leaves both as they are, "
    "bit by bit; bounds and energy in between",
)
def _contacts() -> Iterator[Row]:
    grid = block(2 * _CELLS, 3, 3, pitch=_PITCH)
    bonded_body = single(grid, STEEL, two_halves)

    def difference_from_one_body(ran: Ran) -> Observation:
        # A bonded pair against one body of the same voxels, by one solver.
        one_body = run_nodes(bonded_body, method=ran.method)
        difference = ran.moved(np.concatenate(one_body.nodes))
        check = Check("off one body", difference / (HOT - COLD), 1e-10)
        # Their solves differ, and so do the steps that follow an error.
        is_adaptive = ran.method.name == "TRBDF2, adaptive"
        return Observation(
            seen=f"off one body by {difference:.2g} K",
            checks=() if is_adaptive else (check,),
        )

    for conductance in (1.0, 1e3, 1e6, np.inf):
        scene = _pair(conductance)
        label = f"h_c = {conductance:g}"
        yield from judged(
            label=label,
            scene=scene,
            methods=damping(scene, ratio=50.0),
            bounds=(COLD, HOT),
            observe=difference_from_one_body if np.isinf(conductance) else None,
        )
        yield too_long(label, scene)
    apart = _pair(0.0)

    def change_from_start(ran: Ran) -> Observation:
        change = ran.moved(np.repeat([HOT, COLD], 36))
        return Observation(checks=(Check("moved", change, 0),))

    yield from judged(
        label="h_c = 0",
        scene=apart,
        methods=damping(apart, ratio=50.0)[:3],
        bounds=(COLD, HOT),
        observe=change_from_start,
    )
    # A conductance of 1e15 against no resistance at all.
    euler = Method("ForwardEuler", jt.ForwardEuler(), end=100.0)
    nearly_bonded = run_nodes(_pair(1e15), method=euler)
    bonded = run_nodes(_pair(np.inf), method=euler)
    difference = nearly_bonded.moved(np.concatenate(bonded.nodes)) / (HOT - COLD)
    yield Row(
        "h_c = 1e15",
        solver="ForwardEuler",
        dtype="float64",
        checks=(Check("off bonded", difference, 1e-10),),
    )


def _island_body() -> jt.Body:
    """Two blocks with a gap between them, as one body; warmer along x."""
    left = jt.shapes.box((0.03, 0.02, 0.02))
    right = left.moved((0.05, 0.0, 0.0))
    blocks = [(block.vertices, block.faces) for block in (left, right)]
    mesh = jt.Mesh(*joined(blocks))

    def start_temperature(points: np.ndarray) -> np.ndarray:
        return 320.0 + 10.0 * (points[:, 0] > 0.02)

    full_volume = jt.FullVolume(jt.voxelize(mesh, _PITCH))
    return jt.Body(full_volume, STEEL, temperature=start_temperature)


@case(
    "S12",
    "an island: a part of a body without any exchange of heat",
    "C / dt is on the diagonal: no step is singular",
    "its temperature stays bit by bit; the steady state finds it",
)
def _islands() -> Iterator[Row]:
    body = _island_body()
    region = jt.Region((-1.0, -1.0, -1.0), (0.02, 1.0, 1.0))
    air = jt.Convection(50.0, 300.0, on=region)
    scene = jt.Scene((body,), (air,), dtype="float64")
    far = body.structure.nodes().centre[:, 0] > 0.02
    # What nodes hold is not 330 K to the last bit: they start from a reference.
    no_steps = Method("", jt.ForwardEuler(), end=1e-9)
    start_temperature = run_nodes(scene, method=no_steps).nodes[0]

    def change_from_start(ran: Ran) -> Observation:
        change = np.abs(ran.nodes[0] - start_temperature)
        return Observation(
            seen=f"its neighbour by {float(change[~far].max()):.2g} K",
            checks=(Check("island moved", float(change[far].max()), 0.0),),
        )

    yield from judged(
        label="an island",
        scene=scene,
        methods=damping(scene),
        bounds=(300.0, 330.0),
        observe=change_from_start,
    )
    yield attempt(
        "steady state",
        lambda: _at_rest(scene),
        solver="steady",
        dtype=scene.dtype,
    )


def _at_rest(scene: jt.Scene) -> Row:
    """The steady state, in which the island is found and keeps its mean."""
    steady_state = jt.steady(scene)
    surface = np.asarray(steady_state.surface_temperature)[0]
    far = scene.bodies[0].structure.grid.fragment_position[:, 0] > 0.02
    exact = np.where(far, 330.0, 300.0)
    error = np.abs(surface - exact).max()
    island_count = exactly("islands", steady_state.isolated_components, 1)
    return Row(checks=(island_count, Check("off [K]", float(error), 1e-6)))


@case(
    "S13",
    "no conductivity",
    "harmonic mean, 0 if either half insulates",
    "refused as a material; conductance 0 with a finite slope where it is traced",
)
def _no_conductivity() -> Iterator[Row]:
    yield refusal("k = 0", lambda: jt.Material(0.0, 1.0, 1.0), "positive, finite")
    # 0 / 0 of both halves is met by a slope of 0, which is a choice.
    for label, both_insulate, expected_slope in (
        ("a half", False, 1),
        ("both halves", True, 0),
    ):
        with precision("float64"):
            unit = jnp.ones((), jnp.float64)

            def conductance(k, second_insulates=both_insulate, unit=unit):
                second_k = k if second_insulates else unit
                return series(unit, unit, k, unit, second_k)

            value, slope = map(float, jax.value_and_grad(conductance)(0 * unit))
        yield Row(
            f"{label} of k = 0, traced",
            dtype="float64",
            checks=(
                exactly("conductance", value, 0),
                exactly("slope", slope, expected_slope),
            ),
        )
    nearly = jt.Material(1e-30, density=1000.0, specific_heat=1000.0)
    for dtype in ("float64", "float32"):
        scene = insulated("checkerboard", (nearly, COPPER), dtype)
        yield from through_all("every other voxel of k = 1e-30", scene)


@case(
    "S14",
    "no heat capacity",
    "maximum principle",
    "refused; and 1e-6 next to 3.4e6 J/(m^3 K) keeps the bounds",
)
def _no_capacity() -> Iterator[Row]:
    yield refusal("density 0", lambda: jt.Material(1.0, 0.0, 1.0), "positive, finite")
    yield refusal("c_p 0", lambda: jt.Material(1.0, 1.0, 0.0), "positive, finite")

    def falling() -> jt.Material:
        return jt.Material(1.0, 1.0, jt.Property([300.0, 400.0], [100.0, 0.0]))

    yield refusal("c_p that falls to 0", falling, "give positive, finite values")
    light = jt.Material(1.0, density=1e-6, specific_heat=1.0)
    scene = insulated("checkerboard", (light, COPPER), "float64")
    yield from through_all("every other voxel of 1e-6 J/(m^3 K)", scene)


@case(
    "S15",
    "one voxel, one line of voxels, none",
    "an InputError says what, where and what to do",
    "a value for every fragment; what has no voxel is refused in one line",
)
def _few_voxels() -> Iterator[Row]:
    line = rod(8, STEEL, 100.0)
    yield from _all_there("8x1x1", line, damping(line))
    yield from _all_there("1x1x1", _heated(STEEL, _PITCH, "float32"), _METHODS)
    no_faces = np.zeros((0, 3), int)
    empty_mesh = jt.Mesh(np.zeros((0, 3)), no_faces)
    yield refusal(
        "a mesh of nothing", lambda: jt.voxelize(empty_mesh, _PITCH), "no triangles"
    )
    small_box = jt.shapes.box(0.1 * _PITCH)
    yield refusal(
        "a body below a voxel", lambda: jt.voxelize(small_box, _PITCH), "finer pitch"
    )
    yield refusal("a grid of air alone", _in_air, "no solid voxel")


def _all_there(label: str, scene: jt.Scene, methods: list[Method]) -> Iterator[Row]:
    """Runs with a temperature for every fragment."""
    fragments = len(scene.bodies[0].structure.grid.fragment_area)

    def fragment_count(ran: Ran) -> Observation:
        count = ran.solution.surface_temperature.shape[1]
        return Observation(checks=(exactly("fragments", count, fragments),))

    return judged(
        label=label,
        scene=scene,
        methods=methods,
        bounds=(COLD, HOT),
        observe=fragment_count,
    )


def _in_air() -> None:
    """Simulate on a grid without a solid voxel."""
    full = block(3, 3, 3, _PITCH)
    fields = ("position", "normal", "area", "voxel", "axis", "layer")
    none = {f"fragment_{f}": getattr(full, f"fragment_{f}")[:0] for f in fields}
    grid = replace(full, solid=np.zeros_like(full.solid), **none)
    scene = single(grid, STEEL, HOT)
    jt.simulate(scene, 1.0, solver=jt.ForwardEuler(dt=0.1))


CASES = (
    _slow_changes,
    _contacts,
    _islands,
    _no_conductivity,
    _no_capacity,
    _few_voxels,
    _many_voxels,
)
