"""Damaged meshes (S16): a defined result, told, and the volume of the whole one."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import jaxthermo as jt
from jaxthermo.geometry.mesh import Mesh, verdict_line
from jaxthermo.geometry.repair import repair_mesh

from .bodies import STEEL
from .case import Case, Check, Row, broken


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
"""Its share of the sphere, which the vote may close flat."""

DAMAGES = {
    "triangles of no area": _with_slivers,
    "a third of the faces twice": _with_copies,
    "all normals inward": _turned,
    "half of the normals inward": _partly_turned,
    "one face missing": _with_hole,
    "open: a cap missing": _open,
}


def damaged_meshes() -> Iterator[Row]:
    """S16."""
    whole = jt.shapes.sphere(RADIUS, subdivisions=3)
    exact = 4 / 3 * np.pi * RADIUS**3
    for what, damage in DAMAGES.items():
        least = 0.98 - (_CAP if damage is _open else 0)
        try:
            yield _damaged(what, damage(whole), exact, least)
        except Exception as error:
            yield broken(what, error)
    sheet = jt.shapes.box((0.1, 0.1, 0.1 * PITCH))
    grid = jt.voxelize(sheet, PITCH)
    volume = grid.solid_count * grid.voxel_volume
    told = Check("told thin", grid.thin.thin_fragments, np.inf, 1)
    # A sheet of a tenth of a voxel cannot be one voxel thick without it being said.
    said = Check("said", float(bool(grid.unscaled_because)), 1, 1)
    seen = f"{grid.solid_count} voxels, {volume / 1e-5:.3g} times the volume: "
    yield Row(
        "a sheet of a tenth of a voxel",
        seen=seen + (grid.unscaled_because or "scaled to the mesh's own"),
        checks=(told, said) if abs(volume / 1e-5 - 1) > 0.01 else (told,),
    )


def _damaged(what: str, mesh: Mesh, exact: float, least: float) -> Row:
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
        Check("volume", volume / exact, 1.02, least),
        Check("out of bounds", out, 1e-3),
        Check("told", float(bool(mended.repairs) or not mended.is_watertight), 1, 1),
    )
    seen = verdict_line(mended).split(", area")[0] + f"; repaired: {mended.repairs}"
    return Row(what, seen=seen, checks=checks)


CASES = (
    Case(
        "S16",
        "damaged meshes of a sphere, 20 voxels across",
        "the sphere's volume to 2 %, less the cap where that is missing; it is told",
        "divergence theorem; filling by the vote of three axes",
        damaged_meshes,
    ),
)
