"""The note of a receipt that names the faster loops of large full volumes."""

import pytest

import jaxthermo as jt
from jaxthermo.scene.compile import receipt
from jaxthermo.structures.structure import AbstractStructure


GRID = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
COPPER = jt.materials["copper"]
ALONG = jt.Material((1.0, 2.0, 3.0), 1000.0, specific_heat=1000.0)


def scene_of(structure: AbstractStructure, material: jt.Material = COPPER) -> jt.Scene:
    return jt.Scene((jt.Body(structure, material, temperature=300.0),))


def test_above_a_number_of_voxels_the_note_names_them_and_what_to_install(monkeypatch):
    assert receipt._faster_loops(scene_of(jt.FullVolume(GRID))) == ()
    monkeypatch.setattr(receipt, "_LARGE", 63)
    (note,) = receipt._faster_loops(scene_of(jt.FullVolume(GRID)))
    assert note.startswith("body 0: explicit steps of 64 voxels are some three times")
    assert "`kernels: numba`" in note and "make env EXTRAS=native" in note
    assert "\n" not in note


@pytest.mark.parametrize(
    ("structure", "material"),
    [
        (jt.FullVolume(GRID, kernels="numba"), COPPER),
        (jt.FullVolume(GRID), ALONG),
        (jt.Octree(GRID), COPPER),
    ],
)
def test_no_note_where_they_do_not_help(monkeypatch, structure, material):
    monkeypatch.setattr(receipt, "_LARGE", 0)
    assert receipt._faster_loops(scene_of(structure, material)) == ()
