"""`solution.npz`: what is written is what is read, and damage is one line."""

import numpy as np
import pytest
from bodies import bar

import jaxthermo as jt
from jaxthermo.image.view import compute_view
from jaxthermo.integrate.run.solution_file import (
    FORMAT_VERSION,
    load_solution,
    save_solution,
)


COPPER = jt.Material(
    conductivity=401.0,
    density=8960.0,
    specific_heat=385.0,
    emissivity=0.05,
    absorptivity=0.3,
)
BRICK = jt.Material(
    conductivity=0.7, density=1900.0, specific_heat=800.0, emissivity=0.93
)
QUARTER_TURN = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))


@pytest.fixture(
    scope="module", params=["float32", pytest.param("float64", marks=pytest.mark.slow)]
)
def solution(request):
    """Of two bodies, one of two materials, one turned and moved."""
    half = jt.Region(lower=(0.0, -1.0, -1.0), upper=(1.0, 1.0, 1.0))
    bodies = (
        jt.Body(jt.FullVolume(bar(4, 0.01)), COPPER, temperature=300.0),
        jt.Body(
            jt.FullVolume(bar(6, 0.01)),
            jt.MaterialMap(COPPER, ((half, BRICK),)),
            temperature=350.0,
            pose=jt.Pose(translation=(0.0, 0.0, 0.1), rotation=QUARTER_TURN),
        ),
    )
    terms = (jt.Convection(20.0, 290.0), jt.Surroundings(temperature=280.0))
    scene = jt.Scene(bodies, terms, dtype=request.param)
    return jt.simulate(scene, 3.0, [1.0, 3.0])


def test_what_is_written_is_read(solution, tmp_path):
    path = tmp_path / "solution.npz"
    save_solution(path, solution)
    assert [p.name for p in tmp_path.iterdir()] == ["solution.npz"]
    stored = load_solution(path)
    np.testing.assert_array_equal(stored.times, solution.times)
    kept = stored.surface_temperature
    assert kept.dtype == solution.surface_temperature.dtype
    np.testing.assert_array_equal(kept, solution.surface_temperature)
    assert len(stored.surfaces) == 2
    for one, other in zip(stored.surfaces, solution.surfaces, strict=True):
        np.testing.assert_array_equal(one.emissivity, other.emissivity)
        np.testing.assert_array_equal(one.absorptivity, other.absorptivity)
        a, b = one.geometry, other.geometry
        assert (a.pose, a.pitch) == (b.pose, b.pitch)
        for field in ("vertices", "faces", "fragment_position", "fragment_area"):
            np.testing.assert_array_equal(getattr(a, field), getattr(b, field))


def test_a_camera_sees_the_same(solution, tmp_path):
    save_solution(tmp_path / "solution.npz", solution)
    stored = load_solution(tmp_path / "solution.npz")
    camera = jt.Camera((0.3, -0.4, 0.2), (0.0, 0.0, 0.05), width=40, height=30)
    one = compute_view(stored.surfaces, solution.terms, camera)
    other = compute_view(solution.surfaces, solution.terms, camera)
    assert set(one.body) == {0, 1}
    np.testing.assert_array_equal(one.pixel, other.pixel)
    np.testing.assert_array_equal(one.weights.weight, other.weights.weight)


def test_the_energies_are_kept_by_name(solution, tmp_path):
    save_solution(tmp_path / "solution.npz", solution)
    with np.load(tmp_path / "solution.npz") as kept:
        for name, heat in solution.energy.mechanisms.items():
            np.testing.assert_array_equal(kept[f"energy_{name}_J"], heat)
        np.testing.assert_array_equal(kept["stored_J"], solution.energy.stored_J)
        np.testing.assert_array_equal(
            kept["mean_temperature"], solution.mean_temperature
        )


def test_a_missing_file_says_what_makes_it(tmp_path):
    with pytest.raises(jt.InputError, match="no such file; `jaxthermo simulate`"):
        load_solution(tmp_path / "solution.npz")


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.99])
def test_a_file_cut_short(solution, tmp_path, share):
    path = tmp_path / "solution.npz"
    save_solution(path, solution)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(jt.InputError, match="run the simulation again") as caught:
        load_solution(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("version", [None, 1, 99])
def test_a_file_of_another_version_is_refused_in_one_line(solution, tmp_path, version):
    path = tmp_path / "solution.npz"
    save_solution(path, solution)
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    del arrays["format_version"]
    if version is not None:
        arrays["format_version"] = np.array(version)
    np.savez(path, **arrays)
    words = rf"version {version or 1}, .* reads .* {FORMAT_VERSION}; run the simulation"
    with pytest.raises(jt.InputError, match=words) as caught:
        load_solution(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_of_something_else(tmp_path):
    path = tmp_path / "solution.npz"
    np.savez(path, times=np.zeros(2))
    with pytest.raises(jt.InputError, match="not a solution of jaxthermo"):
        load_solution(path)
    path.write_bytes(b"PK\3\4 hello")
    with pytest.raises(jt.InputError, match="not a solution of jaxthermo"):
        load_solution(path)
    with pytest.raises(jt.InputError, match="not a solution of jaxthermo"):
        load_solution(tmp_path)
