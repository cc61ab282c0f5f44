"""Exchange among many bodies: one sparse matrix, from lines that all bodies share."""

from dataclasses import replace

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse import csr_array, diags_array

import jaxthermo as jt
from jaxthermo import host_memory
from jaxthermo.arrays import rows_of, rows_remembered
from jaxthermo.errors import LongComputation
from jaxthermo.physics.radiation import sampling_cost, transfer, view_factors
from jaxthermo.physics.radiation.global_lines import bundles_of, sample_all_directions
from jaxthermo.physics.radiation.line_hits import LineScene
from jaxthermo.physics.radiation.patches import shares_of_patches
from jaxthermo.physics.radiation.sampling_cost import SamplingCost
from jaxthermo.physics.radiation.view_factors import ViewFactors, refined_view_factors
from jaxthermo.reference.view_factor import parallel_rectangles
from jaxthermo.scene.compile.bodies import prepare
from jaxthermo.scene.compile.groups import body_groups
from jaxthermo.scene.compile.snapshots import take_snapshots
from tests.radiating import in_patches, moved, room
from tests.slopes import check_gradient


CUBE = jt.voxelize(jt.shapes.box((1.0, 1.0, 1.0)), 0.1)


def random_views(count: int, open_part: float) -> ViewFactors:
    """A sparse enclosure of patches of unlike areas, of which a part is open."""
    random = np.random.default_rng(4)
    dense = random.uniform(size=(count, count))
    dense = dense * (random.uniform(size=(count, count)) < 0.3)
    between = dense + dense.T + 0.1 * np.eye(count)
    outside = open_part * random.uniform(size=count)
    return ViewFactors(
        area=between.sum(1) + outside, between=csr_array(between), outside=outside
    )


def irradiation(views, emissivity, emitted):
    """Irradiation of patches for their emission, and for a unit from around."""
    exchanged = transfer.transfer(
        views,
        emissivity=emissivity,
        around=views.to_surroundings[:, None],
        dtype=np.dtype(float),
    )
    return exchanged.between.irradiation(emitted), exchanged.around[:, 0]


def _sums_of_references(count: int) -> int:
    """Additions and subtractions in an exchange of cubes of traced temperatures."""
    material = jt.Material(15.0, density=2000.0, specific_heat=500.0, emissivity=0.8)
    cube = jt.FullVolume(jt.voxelize(jt.shapes.box((0.2, 0.2, 0.2)), 0.1))
    term = jt.RadiativeExchange(280.0, directions=8, max_patches=6)
    scene = jt.Scene(
        tuple(
            jt.Body(cube, material, temperature=290.0, pose=jt.Pose((n, 0.0, 0.0)))
            for n in range(count)
        ),
        (term,),
        dtype="float64",
    )
    prepared = tuple(
        prepare(n, group, np.dtype(float)) for n, group in enumerate(body_groups(scene))
    )
    (snapshot,) = take_snapshots(
        scene, prepared, starts=(0.0,), end=1.0, temperatures=None, prune=True
    )

    def bind(kelvin):
        surface = replace(snapshot.surface, references=tuple(rows_of(kelvin)))
        enclosure, _ = term.enclosure(surface)
        assert_array_equal(enclosure.above.shape, sum(surface.counts))
        return enclosure.base, enclosure.above

    with rows_remembered():
        closed = jax.make_jaxpr(bind)(jnp.linspace(280.0, 300.0, count))
    known = jax.core.eval_jaxpr(closed.jaxpr, closed.consts, jnp.linspace(2, 4, count))
    assert float(known[0]) == pytest.approx(3.0)
    assert_allclose(np.asarray(known[1])[[0, -1]], [-1.0, 1.0], rtol=1e-12)
    names = [equation.primitive.name for equation in closed.jaxpr.eqns]
    return names.count("add") + names.count("sub")


def test_operations_on_references_are_as_many_for_more_bodies():
    assert _sums_of_references(3) == _sums_of_references(6)


@pytest.mark.parametrize("emissivity", [1.0, 0.7, 0.02])
@pytest.mark.parametrize("open_part", [0.0, 3.0])
def test_iterated_reflections_are_those_of_the_dense_solution(
    monkeypatch, emissivity, open_part
):
    views = random_views(50, open_part)
    grey = emissivity * np.linspace(0.5, 1.0, 50)
    emitted = jnp.asarray(np.random.default_rng(1).normal(size=50))
    solved, around = irradiation(views, grey, emitted)
    monkeypatch.setattr(transfer, "_MAX_SOLVED", 0)
    iterated, iterated_around = irradiation(views, grey, emitted)
    scale = float(jnp.abs(solved).max())
    assert_allclose(iterated, solved, atol=1e-10 * scale)
    assert_allclose(iterated_around, around, atol=1e-10)
    # What leaves the patches reaches patches or the surroundings.
    everything, _ = irradiation(views, grey, jnp.ones(50))
    assert_allclose(everything + iterated_around, 1.0, atol=1e-10)


def test_gradients_pass_through_iterated_reflections(monkeypatch):
    monkeypatch.setattr(transfer, "_MAX_SOLVED", 0)
    views = random_views(20, 1.0)
    way = jnp.asarray(np.random.default_rng(2).normal(size=20))

    def heat(numbers):
        received, around = irradiation(views, jax.nn.sigmoid(numbers), 1 + numbers)
        return way @ (received + around)

    at = np.linspace(-1.0, 1.0, 20)
    check_gradient(heat, at, step=1e-4, rtol=1e-6)(at)


def test_bodies_share_patches_by_their_area():
    assert_array_equal(shares_of_patches(np.ones(10), 128), 128)
    assert_array_equal(shares_of_patches(np.ones(40), 128), 32)
    assert_array_equal(shares_of_patches(np.ones(1000), 128), 6)
    unlike = shares_of_patches(np.array([1.0, 2.0, 37.0]), 100)
    assert_array_equal(unlike, [25, 50, 100])


def test_many_bodies_share_lines():
    """Twelve cubes: more pairs than have lines of their own."""
    bodies = tuple(
        in_patches(CUBE, 24, moved(1.5 * (n % 4), 1.5 * (n // 4), 0.0))
        for n in range(12)
    )
    views, sampling = refined_view_factors(bodies, 0.05)
    assert sampling.error <= 0.05
    assert abs(views.between - views.between.T).max() == 0
    closure = views.factor.sum(1) + views.to_surroundings
    assert_allclose(closure, 1.0, atol=1e-12)
    assert views.sampled is not None
    assert sampling.row_error == pytest.approx(
        np.sqrt(np.average((views.sampled - 1) ** 2, weights=views.area))
    )
    assert sampling.row_error < 0.02
    assert (
        f"of {len(views.area)} patches, whose sampled rows add up to" in sampling.note
    )
    # Neighbours are parallel squares half an edge apart, behind which nothing is seen.
    count = bodies[0].patches.count
    exact = parallel_rectangles(1.0, 1.0, 0.5)
    first = slice(0, count)
    assert views.between[first, count : 2 * count].sum() == pytest.approx(
        exact, rel=0.05
    )
    assert views.between[first, 2 * count : 3 * count].sum() < 1e-3


def test_rows_of_patches_that_touch_do_not_count_as_sampled():
    """Two cubes on each other: lines between the faces that touch are no exchange."""
    bodies = []
    for side, height in ((1.0, 0.0), (-1.0, 1.0)):
        touches = side * CUBE.fragment_normal[:, 2] > 0.5
        area = np.where(touches, 1e-6, 1.0) * CUBE.fragment_area
        bodies.append(in_patches(CUBE, 24, moved(0.0, 0.0, height), area))
    views, sampling = refined_view_factors(tuple(bodies), 0.05)
    assert views.sampled is not None
    assert_array_equal(np.isnan(views.sampled), views.area < 1e-3)
    assert sampling.row_error < 0.1
    # The free sides see nothing but the surroundings.
    free = views.area > 1e-3
    assert_allclose(views.to_surroundings[free], 1.0, atol=1e-5)


def test_a_cavity_that_several_bodies_enclose_is_closed():
    """Six slabs around a cube of 1 m: two walls see each other as parallel squares."""
    slabs = {
        (1.2, 1.2, 0.1): [(0, 0, 0.55), (0, 0, -0.55)],
        (0.1, 1.2, 1.0): [(0.55, 0, 0), (-0.55, 0, 0)],
        (1.0, 0.1, 1.0): [(0, 0.55, 0), (0, -0.55, 0)],
    }
    bodies = [
        in_patches(jt.voxelize(jt.shapes.box(size), 0.1), 24, moved(*place))
        for size, places in slabs.items()
        for place in places
    ]
    views, sampling = refined_view_factors(tuple(bodies), 0.01)
    assert sampling.error <= 0.01
    first = np.cumsum([0, *(body.patches.count for body in bodies)])
    # Sides that face along y: inward on the one wall, and on the other.
    inner = [
        first[n] + np.flatnonzero(bodies[n].patches.code % 6 == side)
        for n, side in ((4, 2), (5, 3))
    ]
    assert_array_equal(views.outside[np.concatenate(inner)], 0.0)
    between = views.between[np.ix_(*inner)].sum()
    exact = parallel_rectangles(1.0, 1.0, 1.0)
    assert between == pytest.approx(exact, rel=0.015)


def test_a_small_body_in_a_large_room_has_lines_of_its_own():
    """All that a ball of 2 cm emits reaches the walls of 2 m."""
    ball = in_patches(jt.voxelize(jt.shapes.sphere(0.02, 2), 0.005), 24)
    walls = in_patches(jt.voxelize(room(2.0, 2.4), 0.2), 60)
    views, _ = refined_view_factors((ball, walls), 0.05)
    count = ball.patches.count
    assert_array_equal(views.outside[:count], 0.0)
    assert views.between[:count, count:].sum() == pytest.approx(
        views.area[:count].sum()
    )
    # By lines, not only by what the scaling makes of them.
    assert views.sampled is not None
    assert_allclose(views.sampled[:count], 1.0, atol=0.15)


def test_too_many_patches_are_refused_before_the_first_line(monkeypatch):
    monkeypatch.setattr(host_memory, "available_bytes", lambda: 2**16)
    body = in_patches(CUBE, 96)
    with pytest.raises(jt.InputError, match="view factors of 96 patches needs about"):
        view_factors.view_factors((body,), directions=64)


def test_view_factors_are_kept_by_content(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path))

    def traced_views():
        grid = jt.voxelize(room(1.0, 1.4), 0.1)
        return refined_view_factors((in_patches(grid, 60),), 0.01)

    views, sampling = traced_views()
    monkeypatch.setattr(view_factors, "sample_around_motion", None)
    again, sampling_again = traced_views()
    assert sampling_again == sampling
    assert_array_equal(again.between.toarray(), views.between.toarray())


def test_rows_in_chunks_are_the_matrix():
    views = random_views(70, 1.0)
    rows = transfer._rows(views, np.dtype(float))
    vector = np.arange(70.0)
    assert_allclose(rows.product(jnp.asarray(vector)), views.between @ vector)
    empty = views._replace(between=csr_array(diags_array(np.zeros(70))))
    rows = transfer._rows(empty, np.dtype(float))
    assert_array_equal(rows.product(jnp.asarray(vector)), 0.0)


def test_faces_in_one_patch_need_no_look_up():
    """Patches by face are those of the points on it, wherever a table has one."""
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    ball = jt.voxelize(jt.shapes.sphere(0.5, 3), 0.1)
    bodies = (in_patches(ball, 60), in_patches(CUBE, 6, moved(2.0, 0.0, 0.0, turn)))
    scene = LineScene.of_bodies(bodies)
    known = np.flatnonzero(scene.of_face >= 0)
    assert len(known) > len(scene.faces) / 4
    # All faces of the cube: each side is one patch.
    assert (scene.of_face[scene.body == 1] >= 0).all()
    weights = np.random.default_rng(1).dirichlet(np.ones(3), len(known))
    points = np.einsum("kc,kci->ki", weights, scene.vertices[scene.faces[known]])
    looked_up = scene.solids.at(points, face=known, space=np.zeros(len(known), int))
    assert_array_equal(looked_up, scene.of_face[known])


def test_lines_are_told_before_they_are_sampled():
    """The forecast of surfaces that lines meet is the number that they meet."""
    body = in_patches(CUBE, 600)
    scene = LineScene.of_bodies((body,))
    cost = SamplingCost.of_scene(scene, None)
    (bundle,) = bundles_of(scene, None).bundles
    for directions in (32, 512):
        sums = sample_all_directions(scene, directions, None)
        # Each line of a convex body meets it twice, once in its sky and once below it.
        pixel = bundle.spacing(directions)
        each_way = 2 / (directions // 2) * pixel**2
        met = (sums.sky.sum() + sums.ground.sum()) / each_way
        assert cost.hits(directions) == pytest.approx(met, rel=0.03)
    # Lines are never fewer than those that all bodies need.
    assert bundle.spacing(2**16) == pytest.approx(np.sqrt(6.0 / 4 / 4096))
    assert cost.lines(16, 64) == sum(map(cost.hits, (16, 32, 64))) / 2


def test_long_samples_are_told_at_once(monkeypatch):
    monkeypatch.setattr(sampling_cost, "_MANY_LINES", 1e3)
    body = in_patches(CUBE, 24)
    with pytest.warns(LongComputation, match="24 patches: .* lines in 128"):
        refined_view_factors((body,), 0.05)


def test_sampling_ends_where_memory_does(monkeypatch):
    """More directions than fit are not sampled; the note tells why."""
    bodies = tuple(in_patches(CUBE, 600, moved(1.5 * n, 0.0, 0.0)) for n in range(2))
    cost = SamplingCost.of_scene(LineScene.of_bodies(bodies), None)
    free = int(cost.bytes_for(128) / 0.8) + 1
    monkeypatch.setattr(host_memory, "available_bytes", lambda: free)
    _, sampling = refined_view_factors(bodies, 1e-6, max_directions=256)
    assert sampling.directions == 128
    assert sampling.note.endswith(
        "more directions do not fit into memory: give fewer `max_patches`"
    )
