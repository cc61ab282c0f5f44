"""Damaged meshes (S16) and an optimizer that proposes negative values (S21)."""

import functools
from collections.abc import Callable, Iterator
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

from ..harness.case import Check, Row, attempt, case, exactly, refusal
from ..harness.scenes import single
from .bodies import COLD, HOT, STEEL, block, two_halves


# Radius of the sphere and edge of a voxel [m]: 20 voxels across.
_RADIUS = 0.1
_PITCH = 0.01


def _with_slivers(mesh: Mesh) -> Mesh:
    """Zero-area triangles: two corners the same, and three in a line."""
    a, b, _ = mesh.faces[0]
    middle = mesh.vertices[[a, b]].mean(0)
    middle_number = len(mesh.vertices)
    added = np.array([[a, a, b], [a, middle_number, b]])
    return replace(
        mesh,
        vertices=np.concatenate([mesh.vertices, middle[None]]),
        faces=np.concatenate([mesh.faces, added]),
    )


def _with_faces(choose) -> Callable[[Mesh], Mesh]:
    return lambda mesh: replace(mesh, faces=choose(mesh.faces))


# The vote of three axes must not depend on which way a triangle faces.
def _partly_turned(faces: np.ndarray) -> np.ndarray:
    faces = faces.copy()
    faces[::2] = faces[::2, ::-1]
    return faces


def _open(mesh: Mesh) -> Mesh:
    """Remove the faces above four fifths of the radius."""
    high = mesh.triangles[:, :, 2].mean(1) > 0.8 * _RADIUS
    return replace(mesh, faces=mesh.faces[~high])


# Fraction of the sphere in the cap, which the vote may close flat.
_CAP = 0.2**2 * (3 - 0.2) / 4

_DAMAGES = {
    "triangles of no area": _with_slivers,
    "a third of the faces twice": _with_faces(lambda f: np.concatenate([f, f[::3]])),
    "all normals inward": _with_faces(lambda f: f[:, ::-1]),
    "half of the normals inward": _with_faces(_partly_turned),
    "one face missing": _with_faces(lambda f: f[1:]),
    "open: a cap missing": _open,
}


@case(
    "S16",
    "damaged meshes of a sphere, 20 voxels across",
    "divergence theorem; filling by the vote of three axes",
    "the sphere's volume to 2 %, less the cap where that is missing; the "
    "damage is reported",
)
def _damaged_meshes() -> Iterator[Row]:
    for label, damage in _DAMAGES.items():
        yield attempt(label, functools.partial(_damaged, damage))
    yield _sheet()


def _sheet() -> Row:
    """A sheet of a tenth of a voxel, whose excess of volume must be reported."""
    sheet = jt.shapes.box((0.1, 0.1, 0.1 * _PITCH))
    grid = jt.voxelize(sheet, _PITCH)
    volume_ratio = grid.body_volume / 1e-5
    checks = [
        Check(
            "reported as thin",
            computed=grid.thin.thin_fragments,
            highest=np.inf,
            lowest=1,
        )
    ]
    if abs(volume_ratio - 1) > 0.01:
        represented = grid.represented
        is_off = represented is not None and represented.is_off
        is_reported = bool(grid.unscaled_because) or is_off
        checks.append(exactly("said", is_reported, 1))
    scaling = grid.unscaled_because or "scaled to the mesh's own"
    return Row(
        "a sheet of a tenth of a voxel",
        seen=f"{grid.solid_count} voxels, {volume_ratio:.3g} times the volume: "
        f"{scaling}",
        checks=tuple(checks),
    )


def _damaged(damage: Callable[[Mesh], Mesh]) -> Row:
    """Repaired as a file would be, voxelized, and run for a step."""
    mended = repair_mesh(damage(jt.shapes.sphere(_RADIUS, subdivisions=3)))
    grid = jt.voxelize(mended, _PITCH)
    volume = grid.body_volume / (4 / 3 * np.pi * _RADIUS**3)
    body = jt.Body(jt.FullVolume(grid), STEEL, temperature=300.0)
    # In float32, as a user's scene is unless told otherwise.
    scene = jt.Scene((body,), (jt.Convection(10.0, 290.0),))
    run = jt.simulate(scene, 10.0, solver=jt.ForwardEuler(dt=1.0))
    surface = np.asarray(run.surface_temperature)
    highest = float(surface.max())
    lowest = float(surface.min())
    excess = max(highest - 300, 290 - lowest)
    is_reported = bool(mended.repairs) or not mended.is_watertight
    missing = _CAP if damage is _open else 0
    checks = (
        Check("volume", volume, highest=1.02, lowest=0.98 - missing),
        Check("out of bounds", excess, highest=1e-3),
        exactly("reported", is_reported, 1),
    )
    seen = mesh_summary(mended).split(", area")[0] + f"; repaired: {mended.repairs}"
    return Row(seen=seen, checks=checks)


def _scene(conductivity) -> jt.Scene:
    material = jt.Material(conductivity, 8000.0, 500.0)
    return single(block(8, 3, 3, 0.01), material, two_halves)


@case(
    "S21",
    "an optimizer proposes k < 0",
    "k = exp(p) is positive for any p",
    "a number is refused; a fit of log k stays positive and finite",
)
def _proposals() -> Iterator[Row]:
    for label, conductivity in (("k = -1", -1.0), ("k is NaN", np.nan)):
        yield refusal(
            label,
            lambda k=conductivity: jt.Material(k, 1.0, 1.0),
            reason="positive, finite",
        )
    for solver in (jt.ForwardEuler(dt=1.0), jt.BackwardEuler(dt=1.0)):
        for label, measure in (
            ("k = -1, traced", _traced),
            ("log k, steps too long", _by_logarithm),
        ):
            yield attempt(
                label,
                functools.partial(measure, solver),
                solver=type(solver).__name__,
                dtype="float64",
            )


def _traced(solver) -> Row:
    """A traced k = -1, which no check can see: shown for comparison."""

    @eqx.filter_jit
    def run(k):
        solution = jt.simulate(_scene(k), 50.0, solver=solver, throw=False)
        return solution.surface_temperature, solution.result

    with precision("float64"):
        surface, result = run(jnp.asarray(-1.0, jnp.float64))
    highest = float(np.asarray(surface).max())
    lowest = float(np.asarray(surface).min())
    return Row(
        overshoot_K=max(highest - HOT, COLD - lowest),
        result=result_name(result),
        seen="a traced k is not checked: fit its logarithm",
    )


def _by_logarithm(solver) -> Row:
    """Steps of gradient descent on log k, 1000 times too long: k stays positive."""

    def loss(logarithm):
        scene = _scene(jnp.exp(logarithm))
        run = jt.simulate(scene, 50.0, solver=solver, throw=False)
        # A lower loss keeps more of the contrast: the best k is 0.
        return -jnp.abs(run.surface_temperature[-1] - 350.0).mean()

    step = jax.jit(jax.value_and_grad(loss))
    largest = 0.0
    lowest_k = np.inf
    with precision("float64"):
        log_k = jnp.asarray(np.log(16.0), jnp.float64)
        for _ in range(20):
            value, slope = step(log_k)
            largest = max(largest, abs(float(slope)), abs(float(value)))
            # Clipped to the bounds of a fit: a factor of 1e3 about the start.
            lowest = np.log(1.6e-2)
            highest = np.log(1.6e4)
            log_k = jnp.clip(log_k - 1e3 * slope, lowest, highest)
            lowest_k = min(lowest_k, float(jnp.exp(log_k)))
    return Row(
        checks=(
            Check("k", lowest_k, highest=np.inf, lowest=1e-3),
            Check("loss, slope", largest, highest=1e3, lowest=0.0),
        ),
    )


CASES = (_damaged_meshes, _proposals)
