"""Damaged meshes (S16) and an optimizer that proposes negative values (S21)."""

from collections.abc import Iterator
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.geometry.mesh import Mesh, mesh_summary
from jaxthermo.geometry.repair import repair_mesh
from jaxthermo.integrate.run.solution import result_name

from ..harness.case import Bound, Case, Row, broken, refusal
from .bodies import COLD, HOT, STEEL, block, two_halves


RADIUS, PITCH = 0.1, 0.01


def _with_slivers(mesh: Mesh) -> Mesh:
    """Zero-area triangles: two corners the same, and three in a line."""
    first = mesh.faces[0]
    middle = mesh.vertices[first[:2]].mean(0)
    added = np.array(
        [[first[0], first[0], first[1]], [first[0], len(mesh.vertices), first[1]]]
    )
    return replace(
        mesh,
        vertices=np.concatenate([mesh.vertices, middle[None]]),
        faces=np.concatenate([mesh.faces, added]),
    )


def _with_copies(mesh: Mesh) -> Mesh:
    return replace(mesh, faces=np.concatenate([mesh.faces, mesh.faces[::3]]))


def _turned(mesh: Mesh) -> Mesh:
    return replace(mesh, faces=mesh.faces[:, ::-1])


def _partly_turned(mesh: Mesh) -> Mesh:
    faces = mesh.faces.copy()
    faces[::2] = faces[::2, ::-1]
    return replace(mesh, faces=faces)


def _with_hole(mesh: Mesh) -> Mesh:
    return replace(mesh, faces=mesh.faces[1:])


def _open(mesh: Mesh) -> Mesh:
    """Without what lies above four fifths of the radius."""
    high = mesh.triangles[:, :, 2].mean(1) > 0.8 * RADIUS
    return replace(mesh, faces=mesh.faces[~high])


_CAP = 0.2**2 * (3 - 0.2) / 4
"""Fraction of the sphere in the cap, which the vote may close flat."""

DAMAGES = {
    "triangles of no area": _with_slivers,
    "a third of the faces twice": _with_copies,
    "all normals inward": _turned,
    "half of the normals inward": _partly_turned,
    "one face missing": _with_hole,
    "open: a cap missing": _open,
}


def _damaged_meshes() -> Iterator[Row]:
    """S16."""
    whole = jt.shapes.sphere(RADIUS, subdivisions=3)
    exact = 4 / 3 * np.pi * RADIUS**3
    for what, damage in DAMAGES.items():
        lowest = 0.98 - (_CAP if damage is _open else 0)
        try:
            yield _damaged(what, damage(whole), exact, lowest)
        except Exception as error:
            yield broken(what, error)
    sheet = jt.shapes.box((0.1, 0.1, 0.1 * PITCH))
    grid = jt.voxelize(sheet, PITCH)
    volume = grid.solid_count * grid.voxel_volume
    thin = Bound("reported as thin", grid.thin.thin_fragments, np.inf, 1)
    # A sheet of a tenth of a voxel cannot be one voxel thick without it being said.
    unscaled = Bound("said", float(bool(grid.unscaled_because)), 1, 1)
    seen = f"{grid.solid_count} voxels, {volume / 1e-5:.3g} times the volume: "
    yield Row(
        "a sheet of a tenth of a voxel",
        seen=seen + (grid.unscaled_because or "scaled to the mesh's own"),
        checks=(thin, unscaled) if abs(volume / 1e-5 - 1) > 0.01 else (thin,),
    )


def _damaged(what: str, mesh: Mesh, exact: float, lowest: float) -> Row:
    """Repaired as a file would be, voxelized, and run for a step."""
    mended = repair_mesh(mesh)
    grid = jt.voxelize(mended, PITCH)
    volume = grid.solid_count * grid.voxel_volume
    body = jt.Body(jt.FullVolume(grid), STEEL, temperature=300.0)
    scene = jt.Scene((body,), (jt.Convection(10.0, 290.0),))
    run = jt.simulate(scene, 10.0, solver=jt.ForwardEuler(dt=1.0))
    surface = np.asarray(run.surface_temperature)
    out = max(float(surface.max()) - 300, 290 - float(surface.min()))
    checks = (
        Bound("volume", volume / exact, 1.02, lowest),
        Bound("out of bounds", out, 1e-3),
        Bound(
            "reported", float(bool(mended.repairs) or not mended.is_watertight), 1, 1
        ),
    )
    seen = mesh_summary(mended).split(", area")[0] + f"; repaired: {mended.repairs}"
    return Row(what, seen=seen, checks=checks)


SOLVERS = {
    "ForwardEuler": jt.ForwardEuler(dt=1.0),
    "BackwardEuler": jt.BackwardEuler(dt=1.0),
}


def _scene(conductivity) -> jt.Scene:
    material = jt.Material(conductivity, 8000.0, 500.0)
    grid = block(8, 3, 3, 0.01)
    body = jt.Body(jt.FullVolume(grid), material, temperature=two_halves)
    return jt.Scene((body,), (), dtype="float64")


def _proposals() -> Iterator[Row]:
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
    """A traced k = -1, which no check can see: shown for comparison."""

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
    worst, lowest = 0.0, np.inf
    with precision("float64"):
        at = jnp.asarray(np.log(16.0), jnp.float64)
        for _ in range(20):
            value, slope = step(at)
            worst = max(worst, abs(float(slope)), abs(float(value)))
            # Held to what a fit would allow: a factor of 1e3 about the start.
            at = jnp.clip(at - 1e3 * slope, np.log(1.6e-2), np.log(1.6e4))
            lowest = min(lowest, float(jnp.exp(at)))
    checks = (Bound("k", lowest, np.inf, 1e-3), Bound("loss, slope", worst, 1e3, 0.0))
    return Row("log k, steps too long", name, "float64", checks=checks)


CASES = (
    Case(
        "S16",
        "damaged meshes of a sphere, 20 voxels across",
        "divergence theorem; filling by the vote of three axes",
        "the sphere's volume to 2 %, less the cap where that is missing; the "
        "damage is reported",
        "",
        _damaged_meshes,
    ),
    Case(
        "S21",
        "an optimizer proposes k < 0",
        "k = exp(p) is positive for any p",
        "a number is refused; a fit of log k stays positive and finite",
        "",
        _proposals,
    ),
)
