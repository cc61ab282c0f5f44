"""Open and hollow meshes that become solids say how large and heavy they are."""

import re
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.geometry.mesh import joined
from jaxthermo.scene.compile.compile import compile_scene


STEEL = jt.Material(16.0, 8000.0, 500.0)
OUTER = jt.shapes.box(0.04)
INNER = jt.shapes.box(0.02)
INNER = INNER.moved(OUTER.bounds.mean(0) - INNER.bounds.mean(0))
SIZES = re.compile(r"it is filled: a solid of (\S+) m\^3 and (\S+) kg")


def together(first, second):
    vertices, faces = joined([(mesh.vertices, mesh.faces) for mesh in (first, second)])
    return jt.Mesh(vertices, faces)


def inside_out(mesh):
    return jt.Mesh(mesh.vertices, mesh.faces[:, ::-1])


def without_lid(mesh):
    upward = mesh.area_vectors[:, 2] > 0.0
    return jt.Mesh(mesh.vertices, mesh.faces[~upward])


def warnings(mesh, structure: Any = jt.FullVolume, material=STEEL):
    body = jt.Body(structure(jt.voxelize(mesh, 0.01)), material, temperature=300.0)
    scene = jt.Scene((body,), (jt.HeatFlux(100.0),))
    lines = compile_scene(scene).receipt.warnings
    return [line for line in lines if "it is filled" in line]


@pytest.mark.parametrize(
    ("mesh", "reason"),
    [
        (without_lid(OUTER), r"body 0 has an open mesh \(4 open edges\)"),
        (together(OUTER, INNER), "body 0 has a closed surface inside another, facing"),
    ],
    ids=["open", "hollow"],
)
def test_filled_meshes_state_their_volume_and_mass(mesh, reason):
    """A cube of 4 cm, 64 cm3, of steel: 0.512 kg."""
    (line,) = warnings(mesh)
    assert re.match(reason, line)
    match = SIZES.search(line)
    assert match is not None
    assert float(match[1]) == pytest.approx(64e-6, rel=0.02)
    assert float(match[2]) == pytest.approx(0.512, rel=0.02)


def test_what_is_not_filled_is_not_told():
    assert warnings(OUTER) == []
    assert warnings(together(OUTER, inside_out(INNER))) == []

    def hollow(grid):
        return jt.SingleShell(grid, capacity="own")

    assert warnings(without_lid(OUTER), structure=hollow) == []


def test_parts_of_several_materials_lie_in_each_other_on_purpose():
    mesh = together(OUTER, INNER)
    grid = jt.voxelize(mesh, 0.01)
    material = jt.materials_by_part(
        grid, {"case": OUTER, "core": INNER}, {"case": STEEL, "core": STEEL}
    )
    body = jt.Body(jt.FullVolume(grid), material, temperature=300.0)
    lines = compile_scene(jt.Scene((body,), (jt.HeatFlux(100.0),))).receipt.warnings
    assert not any("it is filled" in line for line in lines)


def test_a_density_without_a_value_has_no_mass():
    """Within a transformation the volume is told alone."""
    structure = jt.FullVolume(jt.voxelize(without_lid(OUTER), 0.01))
    told = []

    @jax.jit
    def capacity(density):
        body = jt.Body(structure, jt.Material(16.0, density, 500.0), temperature=300.0)
        compiled = compile_scene(jt.Scene((body,), (jt.HeatFlux(100.0),)))
        told.extend(compiled.receipt.warnings)
        return density

    capacity(jnp.asarray(8000.0))
    (line,) = [line for line in told if "it is filled" in line]
    assert "kg" not in line
    assert np.isclose(float(line.split("a solid of ")[1].split()[0]), 64e-6, rtol=0.02)
