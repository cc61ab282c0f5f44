"""Islands (S12), no conductivity (S13), no capacity (S14), few voxels (S15)."""

from collections.abc import Iterator
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.physics.conduction import series

from ..harness.case import Bound, Case, Row, broken, refusal
from .bodies import COLD, COPPER, HOT, STEEL, block
from .contrasts import insulated, through_all
from .digits import SOLVERS, heated
from .methods import damping
from .scales import rod
from .solved import Bounds, Method, row_of, run_nodes, stable_step


PITCH = 0.01


def island_body() -> jt.Body:
    """Two blocks with a gap between them, as one body; warmer along x."""
    left, right = (jt.shapes.box((0.03, 0.02, 0.02)) for _ in range(2))
    meshes = [left, right.moved((0.05, 0.0, 0.0))]
    mesh = Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([meshes[0].faces, meshes[1].faces + len(left.vertices)]),
    )
    grid = jt.voxelize(mesh, PITCH)
    return jt.Body(
        jt.FullVolume(grid),
        STEEL,
        temperature=lambda points: 320.0 + 10.0 * (points[:, 0] > 0.02),
    )


def islands() -> Iterator[Row]:
    """S12."""
    body = island_body()
    region = jt.Region((-1.0, -1.0, -1.0), (0.02, 1.0, 1.0))
    air = jt.Convection(50.0, 300.0, on=region)
    scene = jt.Scene((body,), (air,), dtype="float64")
    far = body.structure.nodes().centre[:, 0] > 0.02
    before = run_nodes(scene, jt.ForwardEuler(), 1e-9).nodes[0]
    for method in damping(stable_step(scene)):
        ran = run_nodes(scene, method.solver, method.end)
        check = Bound("island moved", _moved(ran, before, far), 0.0)
        row = row_of(
            "an island", scene.dtype, method, ran, (300.0, 330.0), more=(check,)
        )
        yield row._replace(seen=f"its neighbour by {_moved(ran, before, ~far):.2g} K")
    yield _at_rest(scene)


def _moved(ran, before, there) -> float:
    return float(np.abs(ran.nodes[0] - before)[there].max())


def _at_rest(scene: jt.Scene) -> Row:
    """The steady state, in which the island is found and keeps its mean."""
    try:
        rest = jt.steady(scene)
    except Exception as error:
        return broken("steady state", error, "steady", scene.dtype)
    surface = np.asarray(rest.surface_temperature)[0]
    far = scene.bodies[0].structure.grid.fragment_position[:, 0] > 0.02
    off = max(abs(surface[far] - 330.0).max(), abs(surface[~far] - 300.0).max())
    checks = (
        Bound("islands", rest.isolated_components, 1, 1),
        Bound("off [K]", float(off), 1e-6),
    )
    return Row("steady state", "steady", scene.dtype, checks=checks)


def _no_conductivity() -> Iterator[Row]:
    """S13."""
    yield refusal("k = 0", lambda: jt.Material(0.0, 1.0, 1.0), "positive, finite")
    with precision("float64"):
        one = jnp.ones((), jnp.float64)
        conductance = lambda k: series(one, one, k, one, one)
        value, slope = jax.value_and_grad(conductance)(0 * one)
        both, slopes = jax.value_and_grad(lambda k: series(one, one, k, one, k))(
            0 * one
        )
    finite = Bound("slope", float(slope), 1.0, 1.0)
    zero = Bound("conductance", float(value), 0.0, 0.0)
    yield Row("a half of k = 0, traced", dtype="float64", checks=(zero, finite))
    # 0 / 0 is met by a slope of 0, which is a choice.
    checks = (
        Bound("conductance", float(both), 0, 0),
        Bound("slope", float(slopes), 1, 0),
    )
    yield Row("both halves of k = 0, traced", dtype="float64", checks=checks)
    nearly = jt.Material(1e-30, density=1000.0, specific_heat=1000.0)
    for dtype in ("float64", "float32"):
        scene = insulated("checkerboard", (nearly, COPPER), dtype)
        yield from through_all("every other voxel of k = 1e-30", scene)


def _no_capacity() -> Iterator[Row]:
    """S14."""
    yield refusal("density 0", lambda: jt.Material(1.0, 0.0, 1.0), "positive, finite")
    yield refusal("c_p 0", lambda: jt.Material(1.0, 1.0, 0.0), "positive, finite")
    yield refusal(
        "c_p that falls to 0",
        lambda: jt.Material(1.0, 1.0, jt.Property([300.0, 400.0], [100.0, 0.0])),
        "give positive, finite values",
    )
    light = jt.Material(1.0, density=1e-6, specific_heat=1.0)
    scene = insulated("checkerboard", (light, COPPER), "float64")
    yield from through_all("every other voxel of 1e-6 J/(m^3 K)", scene)


def _few_voxels() -> Iterator[Row]:
    """S15."""
    line = rod(8, STEEL, 100.0)
    for method in damping(stable_step(line)):
        yield _all_there("8x1x1", line, method, (COLD, HOT))
    one = heated(STEEL, PITCH, "float32")
    for name, solver in SOLVERS.items():
        yield _all_there("1x1x1", one, Method(name, solver, 1000.0), (COLD, HOT))
    none = Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    yield refusal("a mesh of nothing", lambda: jt.voxelize(none, PITCH), "no triangles")
    small = jt.shapes.box(0.1 * PITCH)
    yield refusal(
        "a body below a voxel", lambda: jt.voxelize(small, PITCH), "finer pitch"
    )
    yield refusal("a grid of air alone", _in_air, "no solid voxel")


def _all_there(what: str, scene: jt.Scene, method: Method, bounds: Bounds) -> Row:
    """A run with a temperature for every fragment."""
    ran = run_nodes(scene, method.solver, method.end)
    fragments = len(scene.bodies[0].structure.grid.fragment_area)
    shape = ran.solution.surface_temperature.shape
    fits = Bound("fragments", shape[1], fragments, fragments)
    return row_of(what, scene.dtype, method, ran, bounds, more=(fits,))


def _in_air() -> None:
    """Simulate on a grid without a solid voxel."""
    full = block(3, 3, 3, PITCH)
    fields = ("position", "normal", "area", "voxel", "axis", "layer")
    none = {f"fragment_{f}": getattr(full, f"fragment_{f}")[:0] for f in fields}
    grid = replace(full, solid=np.zeros_like(full.solid), **none)
    body = jt.Body(jt.FullVolume(grid), STEEL, temperature=HOT)
    jt.simulate(jt.Scene((body,), ()), 1.0, solver=jt.ForwardEuler(dt=0.1))


CASES = (
    Case(
        "S12",
        "an island: a part of a body without any exchange of heat",
        "C / dt is on the diagonal: no step is singular",
        "its temperature stays bit by bit; the steady state finds it",
        "",
        islands,
    ),
    Case(
        "S13",
        "no conductivity",
        "harmonic mean, 0 if either half insulates",
        "refused as a material; conductance 0 with a finite slope where it is traced",
        "",
        _no_conductivity,
    ),
    Case(
        "S14",
        "no heat capacity",
        "maximum principle",
        "refused; and 1e-6 beside 3.4e6 J/(m^3 K) keeps the bounds",
        "",
        _no_capacity,
    ),
    Case(
        "S15",
        "one voxel, one line of voxels, none",
        "an InputError says what, where and what to do",
        "a value for every fragment; what has no voxel is refused in one line",
        "",
        _few_voxels,
    ),
)
