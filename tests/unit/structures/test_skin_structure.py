"""Skin: volumes, lengths and numbers of a structure whose surface is divided."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.structures.partition.assignment import volume_within
from tests.bodies import bar, blocks, slanted


END = jt.Side((-1.0, 0.0, 0.0))
PITCH = 0.1


def _cube():
    return blocks(np.ones((3, 3, 3), bool), PITCH)


@pytest.mark.parametrize(
    "structure",
    [
        jt.FullVolume(_cube()),
        jt.Aggregate(_cube(), factor=2),
        jt.Octree(_cube()),
        jt.SingleShell(_cube()),
        jt.MultiLevel(_cube()),
        jt.FullVolume(slanted(0.1)),
        jt.FullVolume(blocks(np.ones((1, 1, 1), bool), PITCH)),
    ],
    ids=lambda structure: type(structure).__name__,
)
@pytest.mark.parametrize("cells", [1, 6])
def test_volume_is_that_of_the_structure_and_every_node_has_some(structure, cells):
    skin = jt.Skin(structure, cells=cells)
    volume = skin.nodes().volume
    assert volume.sum() == pytest.approx(structure.nodes().volume.sum(), rel=1e-12)
    assert volume.min() > 0
    columns = cells * len(structure.grid.fragment_area)
    assert (volume[columns:] >= 0.49999 * structure.nodes().volume).all()
    links = skin.links()
    assert (np.diff(links.src) >= 0).all()
    assert min(links.distance_src.min(), links.distance_dst.min()) > 0
    assert len(links.src) == skin.link_count
    assert len(volume) == skin.node_count


def test_a_voxel_below_one_fragment_is_divided_to_its_middle():
    grid = bar(4, PITCH)
    skin = jt.Skin(jt.FullVolume(grid), cells=3, on=END)
    volume = skin.nodes().volume / PITCH**3
    # 1 : 1.5 : 2.25 of half a voxel.
    assert_allclose(volume[:3], np.array([1, 1.5, 2.25]) / 9.5, rtol=1e-12)
    assert_allclose(volume[3:], [0.5, 1, 1, 1], rtol=1e-12)
    links = skin.links()
    length = (links.distance_src + links.distance_dst) / PITCH
    middles = [-0.75, 0.5 - (1 + 1.5 + 2.25 / 2) / 9.5]
    assert length[2] == pytest.approx(middles[1] - middles[0] - 0.5, rel=1e-12)
    # From the surface to the next voxel's node, as without a skin.
    end = skin.fragment_node() == 0
    outermost = skin.fragment_distance[end][0] / PITCH
    assert outermost == pytest.approx(0.5 / 9.5, rel=1e-12)
    assert outermost + length[:4].sum() == pytest.approx(1.5, rel=1e-12)


def test_fragments_without_a_skin_reach_the_node_that_has_moved():
    plate = blocks(np.ones((1, 2, 2), bool), PITCH)
    skin = jt.Skin(jt.FullVolume(plate), cells=2, on=END)
    normal = plate.fragment_normal
    on_end = normal @ np.array(END.normal) > 0.5
    opposite = normal @ np.array(END.normal) < -0.5
    assert (skin.fragment_node()[on_end] < 4).all()
    assert_allclose(skin.fragment_distance[opposite], PITCH / 4, rtol=1e-12)
    links = skin.links()
    through = (links.distance_src + links.distance_dst)[[0, 4]].sum()
    total = skin.fragment_distance[on_end][0] + through + PITCH / 4
    assert total == pytest.approx(PITCH, rel=1e-12)


def test_heated_volume_is_shared_by_the_cells():
    grid = _cube()
    structure = jt.FullVolume(grid)
    skin = jt.Skin(structure, cells=4)
    assert_allclose(
        volume_within(skin, np.ones(grid.solid_count)), skin.nodes().volume, rtol=1e-12
    )
    fraction = np.zeros(grid.solid_count)
    fraction[0] = 0.5
    heated = volume_within(skin, fraction)
    assert heated.sum() == pytest.approx(PITCH**3 / 2, rel=1e-12)
    assert np.count_nonzero(heated) == 3 * 4 + 1


def test_cells_have_the_material_of_their_voxel():
    grid = bar(4, PITCH)
    materials = [jt.materials["copper"], jt.materials["brick"]]
    skin = jt.Skin(jt.FullVolume(grid), cells=2)
    node = skin.fragment_node()
    voxel = grid.fragment_voxel[:, 0]
    labels = np.array([0, 1, 0, 1])
    by_label = jt.MaterialLabels(labels[:, None, None], given=tuple(materials))
    assert (by_label.of_nodes(skin)[node] == labels[voxel]).all()
    half = jt.Region((-1.0, -1.0, -1.0), (0.0, 1.0, 1.0))
    painted = jt.MaterialMap(materials[0], ((half, materials[1]),))
    assert (painted.of_nodes(skin)[node] == painted.of_fragments(grid)).all()


def test_number_of_cells_for_a_time():
    for time in (1e-3, 1.0, 60.0, 3600.0):
        cells = jt.Skin.cells_for(pitch=0.02, diffusivity=5e-7, time=time)
        depth = np.sqrt(5e-7 * time)
        outermost = [0.01 * 0.5 / (1.5**n - 1) for n in (cells - 1, cells) if n]
        assert outermost[-1] <= depth / 6 * (1 + 1e-9)
        assert cells == 1 or outermost[0] > depth / 6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cells": 0}, r"Skin\(cells=0\): give a whole number of at least 1"),
        ({"cells": 40}, r"Skin\(cells=40\): give 32 or fewer"),
        (
            {"on": jt.Side((1.0, 1.0, 1.0), half_angle=0.1)},
            "selects no surface of its body",
        ),
    ],
)
def test_mistakes_say_what_to_give(arguments, message):
    with pytest.raises(InputError, match=message):
        jt.Skin(jt.FullVolume(_cube()), **arguments)


def test_structures_that_cannot_have_a_skin():
    structure = jt.FullVolume(_cube())
    with pytest.raises(InputError, match="it has a skin already"):
        jt.Skin(jt.Skin(structure))
    with pytest.raises(InputError, match="weights are fitted without"):
        jt.Skin(jt.FullVolume(_cube(), weights=jt.ConductionWeights(within=0.9)))
    with pytest.raises(InputError, match="takes \\d+ cells, more than 32"):
        jt.Skin.cells_for(pitch=1.0, diffusivity=5e-7, time=1e-7)
