"""Reading between fragments and the error against a finer run, by closed forms."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.integrate.run.surface_reading import surface_reading
from jaxthermo.scene.scene import BodyGeometry, SolvedSurface


def geometry(grid, translation=(0.0, 0.0, 0.0)) -> BodyGeometry:
    return BodyGeometry(
        vertices=grid.mesh.vertices,
        faces=grid.mesh.faces,
        fragment_position=grid.fragment_foot,
        fragment_normal=grid.fragment_normal,
        fragment_area=grid.fragment_area,
        pitch=grid.pitch,
        pose=jt.Pose(translation),
    )


def run(field, *geometries, times=(0.0, 10.0)) -> StoredSolution:
    """A solution whose fragments have a field of positions and time [K]."""
    unity = jnp.asarray(1.0)
    rows = [[field(g.fragment_position, t) for g in geometries] for t in times]
    temperature = np.array([np.concatenate(row) for row in rows])
    surfaces = tuple(SolvedSurface(g, unity, unity) for g in geometries)
    return StoredSolution(np.array(times), temperature, surfaces)


def linear(x, t=0.0):
    return 300.0 + (x @ np.array([30.0, -20.0, 10.0])) * (1 + t)


def wavy(x, t=0.0):
    """Mean 300 K; no plane fits it."""
    return 300.0 + 10.0 * np.sin(3 * x[:, 0] + 0.3) * np.cos(2 * x[:, 1]) + t


@pytest.fixture(scope="module")
def spheres():
    """Of radius 1, at two pitches."""
    mesh = jt.shapes.sphere(1.0, subdivisions=4)
    return [geometry(jt.voxelize(mesh, pitch)) for pitch in (0.25, 0.125)]


@pytest.fixture(scope="module")
def box():
    """A slanted box, whose fragments lie on no lattice along its sides."""
    turn = ((0.8, -0.6, 0.0), (0.48, 0.64, -0.6), (0.36, 0.48, 0.8))
    mesh = jt.shapes.box((1.0, 0.8, 0.6)).placed(jt.Pose(rotation=turn))
    return geometry(jt.voxelize(mesh, 0.1))


def test_a_linear_field_is_exact_on_plane_sides_up_to_their_edges(box):
    sample = jt.mesh_sample(jt.Mesh(box.vertices, box.faces), 2000)
    reading = surface_reading(box, sample.position, sample.normal)
    assert not reading.is_lost.any()
    read = reading.read(linear(box.fragment_position)[None])[0]
    off = np.abs(read - linear(sample.position))
    # In K, of 3.7 K a pitch: rays meet triangles to a few 1e-5 of a pitch. Where few
    # fragments lie, nearly in a row, their mean is read.
    assert np.quantile(off, 0.99) < 4e-3 and off.max() < 4.0
    np.testing.assert_allclose(reading.weight.sum(1), 1, rtol=1e-9)


@pytest.mark.parametrize("field", [linear, wavy])
def test_reading_on_a_sphere_is_of_second_order(spheres, field):
    sample = jt.mesh_sample(jt.shapes.sphere(1.0, subdivisions=4), 2000)
    errors = []
    for sphere in spheres:
        reading = surface_reading(sphere, sample.position, sample.normal)
        assert not reading.is_lost.any()
        off = reading.read(field(sphere.fragment_position)[None])[0] - field(
            sample.position
        )
        errors.append(np.sqrt((off**2).mean()))
    assert errors[1] < 0.3 * errors[0] < 1.0


def test_sides_of_a_sheet_are_told_apart_by_normals():
    """One voxel thick: 400 K above, 300 K below."""
    grid = jt.voxelize(jt.shapes.box((1.0, 1.0, 0.1)), 0.1)
    sheet = geometry(grid)

    def two_sides(x, t=0.0):
        return 350.0 + 1000.0 * x[:, 2]

    sample = jt.mesh_sample(grid.mesh, 300)
    reading = surface_reading(sheet, sample.position, sample.normal)
    read = reading.read(two_sides(sheet.fragment_position)[None])[0]
    upright = np.abs(sample.normal[:, 2]) > 0.5
    expected = two_sides(sample.position)[upright]
    np.testing.assert_allclose(read[upright], expected, atol=1e-9)
    assert set(np.round(expected)) == {300, 400}


def test_equal_solutions_have_no_error(spheres, box):
    for bodies in ((spheres[0],), (box, spheres[0])):
        solution = run(wavy, *bodies)
        error = jt.truth_error(solution, solution, count=500)
        for name in ("rms_kelvin", "rms_percent", "p99_kelvin", "bias_kelvin"):
            np.testing.assert_array_equal(getattr(error, name), 0)
        assert error.worst_lost_fraction == error.reference_lost_fraction == 0
        np.testing.assert_array_equal(error.times, [10.0])


def test_by_hand_on_plane_sides():
    """Linear fields are read exactly: errors and quantiles are those of the points."""
    body = geometry(jt.voxelize(jt.shapes.box((0.6, 0.6, 0.6)), 0.1))
    reference = run(linear, body, times=(0.0, 1.0, 9.0))
    slope = np.array([0.0, 3.0, 1.0])

    def extra(x, t=0.0):
        return linear(x, t) + (2.0 + x @ slope if t < 5 else 0.0)

    error = jt.truth_error(run(extra, body, times=(0.0, 1.0, 9.0)), reference, 800, 5)
    points = jt.mesh_sample(jt.Mesh(body.vertices, body.faces), 800, 5).position
    off = 2.0 + points @ slope
    rms = np.sqrt((off**2).mean())
    np.testing.assert_allclose(error.rms_kelvin, [rms, 0], atol=1e-9)
    np.testing.assert_allclose(error.bias_kelvin, [off.mean(), 0], atol=1e-9)
    p99 = np.quantile(np.abs(off), 0.99)
    np.testing.assert_allclose(error.p99_kelvin, [p99, 0], atol=1e-9)
    low, high = np.quantile(linear(points, 1.0), [0.005, 0.995])
    np.testing.assert_allclose(
        error.rms_percent, [100 * rms / (high - low), 0], atol=1e-9
    )
    assert float(error.worst_rms_kelvin) == pytest.approx(rms)
    assert float(error.worst_bias_kelvin) == pytest.approx(off.mean())
    assert float(error.worst_p99_kelvin) == pytest.approx(p99)


def test_a_time_that_is_even_again_counts_with_5_percent_of_the_largest_range(box):
    def field(x, t=0.0):
        return 300.0 + (linear(x) - 300.0) * (t < 5)

    reference = run(field, box, times=(1.0, 9.0))
    off = run(lambda x, t=0.0: field(x, t) + 0.5, box, times=(1.0, 9.0))
    percent = jt.truth_error(off, reference, 400).rms_percent
    assert float(percent[1]) == pytest.approx(20 * float(percent[0]))


def test_a_reference_of_one_temperature_gives_kelvin_and_no_percentage(box):
    def even(x, t=0.0):
        return np.full(len(x), 300.0)

    error = jt.truth_error(run(lambda x, t: even(x) - 0.5, box), run(even, box), 100)
    assert float(error.worst_rms_kelvin) == pytest.approx(0.5)
    assert np.isinf(error.worst_rms_percent)
    assert (
        float(jt.truth_error(run(even, box), run(even, box), 100).worst_rms_percent)
        == 0
    )


def test_the_error_falls_with_the_pitch_against_an_analytic_field(spheres):
    """Exact fragments: what is left is reading between them, of second order."""
    fine = geometry(jt.voxelize(jt.shapes.sphere(1.0, subdivisions=4), 0.04))
    exact = run(wavy, fine)
    errors = [jt.truth_error(run(wavy, sphere), exact, 2000) for sphere in spheres]
    coarse, finer = (float(error.worst_rms_kelvin) for error in errors)
    assert finer < 0.32 * coarse < 0.2
    # A run that is 1 K too warm everywhere is that, whatever its voxels.
    warm = jt.truth_error(run(lambda x, t: wavy(x, t) + 1.0, spheres[1]), exact, 2000)
    assert float(warm.worst_bias_kelvin) == pytest.approx(1.0, abs=0.01)
    assert float(warm.worst_rms_kelvin) == pytest.approx(1.0, abs=0.01)


def without(body: BodyGeometry, keep) -> BodyGeometry:
    """A body without some fragments, as if its voxels had not that part."""
    names = ("fragment_position", "fragment_normal", "fragment_area")
    return replace(body, **{name: getattr(body, name)[keep] for name in names})


def test_a_missing_part_is_counted_and_left_out():
    """A plate beside a block, of 2.4 of the area of 8.4, which a run does not have."""
    block = jt.shapes.box((1.0, 1.0, 1.0))
    plate = jt.shapes.box((0.1, 1.0, 1.0))
    vertices = [block.vertices, plate.vertices + np.array([1.0, 0.0, 0.0])]
    faces = np.concatenate([block.faces, plate.faces + len(block.vertices)])
    joined = geometry(jt.voxelize(jt.Mesh(np.concatenate(vertices), faces), 0.1))
    is_plate = joined.fragment_position[:, 0] > 0.7

    def hot(x, t=0.0):
        return linear(x) + 1e3 * (x[:, 0] > 0.7)

    reference = run(hot, joined)
    solution = run(hot, without(joined, ~is_plate))
    error = jt.truth_error(solution, reference)
    share = 2.4 / 8.4
    spread = 4 * np.sqrt(share * (1 - share) / 10_000)
    lost = float(error.worst_lost_fraction)
    assert lost == pytest.approx(share, abs=spread)
    # The plate is 1000 K off where it is missing: nothing of that is in the error.
    assert float(error.worst_rms_kelvin) < 1e-3
    assert float(error.reference_lost_fraction) == 0
    # What the reference has lost counts for no one.
    swapped = jt.truth_error(reference, solution)
    assert float(swapped.reference_lost_fraction) == lost
    assert float(swapped.worst_lost_fraction) == 0


def test_several_bodies_count_by_area(box):
    """The one that is 3 K off has a part of the area, and of the mean square."""
    small = geometry(jt.voxelize(jt.shapes.box(0.4), 0.1), (5.0, 0.0, 0.0))

    def off(x, t=0.0):
        return linear(x) + 3.0

    def still(x, t=0.0):
        return linear(x)

    reference = run(still, box, small)
    rows = np.concatenate([linear(box.fragment_position), off(small.fragment_position)])
    solution = replace(reference, surface_temperature=np.tile(rows, (2, 1)))
    error = jt.truth_error(solution, reference)
    area = [jt.Mesh(body.vertices, body.faces).area for body in (box, small)]
    share = area[1] / sum(area)
    assert float(error.worst_bias_kelvin) == pytest.approx(3 * share, rel=0.05)
    assert float(error.worst_rms_kelvin) == pytest.approx(3 * share**0.5, rel=0.03)


def test_remarks_name_a_reference_that_is_not_independent(spheres):
    coarse, fine = (run(wavy, sphere) for sphere in spheres)
    assert jt.truth_error(coarse, fine, 200).remarks == ()
    (same,) = jt.truth_error(fine, fine, 200).remarks
    assert "body 0 has the voxels of the reference" in same
    (not_finer,) = jt.truth_error(fine, coarse, 200).remarks
    assert "250 mm, are not twice as fine as the run's, 125 mm" in not_finer


def test_plain_numbers_for_json(spheres, box):
    error = jt.truth_error(run(wavy, spheres[0]), run(wavy, spheres[1]), 200)
    plain = json.loads(json.dumps(error.as_dict(), allow_nan=False))
    assert plain["times_s"] == [10.0]
    for name in ("rms_kelvin", "rms_percent", "p99_kelvin", "bias_kelvin"):
        assert (
            plain[name] == [float(getattr(error, name)[0])] == [plain[f"worst_{name}"]]
        )

    def even(x, t=0.0):
        return np.full(len(x), 300.0 + t)

    off = jt.truth_error(run(lambda x, t: even(x) - t, box), run(even, box), 100)
    assert json.loads(json.dumps(off.as_dict()))["worst_rms_percent"] is None


@pytest.mark.slow
def test_derivatives_reach_both_temperatures(spheres):
    reference = run(wavy, spheres[1])
    solution = run(linear, spheres[0])

    def rms(shift):
        return jt.truth_error(
            replace(solution, surface_temperature=solution.surface_temperature + shift),
            reference,
            200,
        ).worst_rms_kelvin

    slope = float(jax.grad(rms)(jnp.asarray(0.0)))
    step = 1e-4
    assert slope == pytest.approx(float(rms(step) - rms(-step)) / (2 * step), rel=1e-6)
    same = reference.surface_temperature

    def zero(t):
        return jt.truth_error(
            replace(reference, surface_temperature=t), reference, 50
        ).worst_rms_kelvin

    np.testing.assert_array_equal(jax.grad(zero)(jnp.asarray(same)), 0)


def test_runs_that_cannot_be_compared(spheres, box):
    reference = run(wavy, spheres[0])
    with pytest.raises(InputError, match="2 bodies and the reference has 1"):
        jt.truth_error(run(wavy, spheres[0], box), reference)
    with pytest.raises(InputError, match="truth_error: saved at .*same save_at"):
        jt.truth_error(run(wavy, spheres[0], times=(0.0, 5.0)), reference)
    with pytest.raises(InputError, match="truth_error: nothing is saved after time 0"):
        jt.truth_error(
            run(wavy, spheres[0], times=(0.0,)), run(wavy, spheres[0], times=(0.0,))
        )
    far = replace(spheres[0], fragment_position=spheres[0].fragment_position + 9.0)
    with pytest.raises(InputError, match="no surface in common"):
        jt.truth_error(run(wavy, far), reference)
    # Within a voxel the meshes may differ, where they are made of voxels.
    for factor in (1.1, 1.5):
        scaled = replace(spheres[0], vertices=factor * spheres[0].vertices)
        if factor == 1.1:
            assert (
                jt.truth_error(run(wavy, scaled), reference, 50).worst_rms_kelvin < 0.1
            )
        else:
            with pytest.raises(InputError, match=r"body 0 ends up to 0\.5 m away"):
                jt.truth_error(run(wavy, scaled), reference, 50)


@pytest.mark.slow
@pytest.mark.parametrize(
    "structure", [jt.FullVolume, jt.Octree, jt.Aggregate, jt.SingleShell]
)
def test_a_body_that_moves_has_the_error_of_one_that_does_not(structure):
    """Turned and on its way, with the heat fixed to the body: the same differences."""
    quarter = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    path = jt.PoseTable([0.0, 60.0], [jt.Pose(), jt.Pose((5.0, 0.0, 0.0), quarter)])
    steel = jt.Material(16.0, 8000.0, 500.0)
    flux = jt.HeatFlux(2e4, on=jt.Side((1.0, 0.0, 0.0)))

    def solve(structure_kind, pitch, pose):
        grid = jt.voxelize(jt.shapes.sphere(0.05), pitch)
        body = jt.Body(structure_kind(grid), steel, temperature=300.0, pose=pose)
        return jt.simulate(
            jt.Scene((body,), (flux,), dtype="float64"), 60.0, [30.0, 60.0]
        )

    errors = []
    for pose in (jt.Pose(), jt.Motion(path)):
        solution = solve(structure, 0.01, pose)
        reference = solve(jt.FullVolume, 0.005, pose)
        errors.append(jt.truth_error(solution, reference, 2000))
        assert 0 < float(errors[-1].worst_rms_kelvin) < 5
        assert float(errors[-1].worst_lost_fraction) == 0
    for name in ("rms_kelvin", "rms_percent", "p99_kelvin", "bias_kelvin"):
        still, moved = (getattr(error, name) for error in errors)
        np.testing.assert_allclose(moved, still, rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_a_steady_state_is_compared_whenever_it_is():
    """A wall between two temperatures: linear, read exactly at any pitch."""
    steel = jt.Material(16.0, 8000.0, 500.0)
    cold = jt.FixedTemperature(300.0, on=jt.Side((-1.0, 0.0, 0.0)))
    hot = jt.FixedTemperature(400.0, on=jt.Side((1.0, 0.0, 0.0)))

    def solve(pitch):
        grid = jt.voxelize(jt.shapes.box((0.08, 0.02, 0.02)), pitch)
        body = jt.Body(jt.FullVolume(grid), steel, temperature=350.0)
        return jt.steady(jt.Scene((body,), (cold, hot), dtype="float64"))

    error = jt.truth_error(solve(0.01), solve(0.005))
    assert float(error.worst_rms_kelvin) < 1e-5
    np.testing.assert_array_equal(error.times, [0.0])
