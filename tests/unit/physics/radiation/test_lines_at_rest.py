"""Lines of bodies at rest, which all places of moving bodies share."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.physics.radiation import global_lines, lines_at_rest
from jaxthermo.physics.radiation.global_lines import bundles_of, sample_all_directions
from jaxthermo.physics.radiation.line_hits import LineScene
from jaxthermo.physics.radiation.lines_at_rest import sample_around_motion
from tests.radiating import in_patches, moved


SLAB = jt.voxelize(jt.shapes.box((1.0, 1.0, 0.1)), 0.1)
CUBE = jt.voxelize(jt.shapes.box((0.2, 0.2, 0.2)), 0.1)
TINY = jt.voxelize(jt.shapes.box((0.03, 0.03, 0.03)), 0.01)
INSIDE = (0.1, 0.2, 0.5)
OUTSIDE = (0.9, 0.3, 0.4)


@pytest.fixture(autouse=True)
def large_scenes(monkeypatch):
    """Views are drawn one by one, as those of large scenes."""
    monkeypatch.setattr(global_lines, "_MAX_TRIANGLES", 1)


def scene_at(place, mover=CUBE):
    """A body that moves between two slabs, and past them."""
    walls = [in_patches(SLAB, 24, moved(0.0, 0.0, z)) for z in (0.0, 1.0)]
    return LineScene.of_bodies(
        (walls[0], in_patches(mover, 24, moved(*place)), walls[1])
    )


@pytest.mark.parametrize("mover", [CUBE, TINY], ids=["as coarse", "finer"])
def test_lines_around_a_moving_body_are_those_of_the_whole_scene(mover):
    """Within the slabs' hull, all lines are the same."""
    scene = scene_at(INSIDE, mover)
    around = sample_around_motion(scene, (0, 2), directions=32, lines=None)
    whole = sample_all_directions(scene, 32, None)
    assert_allclose(around.pairs.toarray(), whole.pairs.toarray(), atol=1e-12)
    assert_allclose(around.sky, whole.sky, atol=1e-12)
    assert_allclose(around.ground, whole.ground, atol=1e-12)
    assert whole.pairs.sum() > 0.2


def test_a_coarse_body_moves_past_a_finer_one():
    """The finer body at rest has lines of its own, which stay around it."""
    placed = ((SLAB, (0.0, 0.0, 0.0)), (CUBE, INSIDE), (TINY, (0.3, 0.2, 0.5)))
    bodies = [in_patches(grid, 24, moved(*place)) for grid, place in placed]
    bodies.append(in_patches(SLAB, 24, moved(0.0, 0.0, 1.0)))
    scene = LineScene.of_bodies(tuple(bodies))
    assert len(bundles_of(scene, None).bundles) == 2
    around = sample_around_motion(scene, (0, 2, 3), directions=32, lines=None)
    whole = sample_all_directions(scene, 32, None)
    assert_allclose(around.pairs.toarray(), whole.pairs.toarray(), atol=1e-12)
    assert_allclose(around.sky, whole.sky, atol=1e-12)


def test_a_body_beside_those_at_rest_has_all_of_its_lines():
    scene = scene_at(OUTSIDE)
    sums = sample_around_motion(scene, (0, 2), directions=256, lines=None)
    area = np.concatenate([body.patches.area for body in scene.bodies])
    rows = sums.pairs + sums.pairs.T
    sampled = (rows.sum(1) + sums.sky + sums.ground) / area
    assert np.sqrt(np.average((sampled - 1) ** 2, weights=area)) < 0.02
    count = scene.bodies[0].patches.count
    of_mover = slice(count, count + scene.bodies[1].patches.count)
    assert sampled[of_mover] == pytest.approx(1.0, abs=0.1)
    assert rows[of_mover, :count].sum() > 0


def test_lines_of_bodies_at_rest_are_sampled_once(monkeypatch):
    whole_views = []
    sample = lines_at_rest.sample_bundles

    def counted(scene, bundles, directions):
        whole_views.append(directions)
        return sample(scene, bundles, directions)

    monkeypatch.setattr(lines_at_rest, "sample_bundles", counted)
    sums = [
        sample_around_motion(scene_at(place), (0, 2), directions=48, lines=None)
        for place in (INSIDE, OUTSIDE)
    ]
    assert whole_views == [48]
    assert abs(sums[0].pairs - sums[1].pairs).max() > 0


def test_small_scenes_are_sampled_whole(monkeypatch):
    monkeypatch.undo()
    scene = scene_at(OUTSIDE)
    sums = sample_around_motion(scene, (0, 2), directions=32, lines=None)
    whole = sample_all_directions(scene, 32, None)
    assert abs(sums.pairs - whole.pairs).max() == 0


def test_a_scene_in_which_all_or_none_move_is_sampled_whole():
    scene = scene_at(INSIDE)
    whole = jax.tree.leaves(sample_all_directions(scene, 32, None).sky)
    for at_rest in ((), (0, 1, 2)):
        sums = sample_around_motion(scene, at_rest, directions=32, lines=None)
        assert_allclose(jax.tree.leaves(sums.sky), whole, atol=0)
