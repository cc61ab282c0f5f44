"""`solution.npz`: what is written is what is read, and damage is one line."""

import os
from typing import Any

import jax
import numpy as np
import pytest
from bodies import bar

import jaxthermo as jt
from jaxthermo.archive import write_archive
from jaxthermo.image.surface.view import compute_view
from jaxthermo.integrate.run.solution_arrays import FORMAT_VERSION
from jaxthermo.integrate.run.solution_file import load_solution
from jaxthermo.scene.surface_outputs import SURFACE_OUTPUTS


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
    asked = {"probes": {"core": (0.0, 0.0, 0.0)}, "surface_outputs": SURFACE_OUTPUTS}
    scene = jt.Scene(bodies, terms, dtype=request.param, **asked)
    # Heat goes less than a voxel deep into the brick.
    with pytest.warns(UserWarning, match="heat has gone"):
        return jt.simulate(scene, 3.0, [1.0, 3.0])


def test_what_is_written_is_read(solution, tmp_path):
    path = tmp_path / "solution.npz"
    solution.save(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["solution.npz"]
    stored = load_solution(path)
    np.testing.assert_array_equal(stored.times, solution.times)
    stored_temperature = stored.surface_temperature
    assert stored_temperature.dtype == solution.surface_temperature.dtype
    np.testing.assert_array_equal(stored_temperature, solution.surface_temperature)
    for k in range(2):
        pairs = zip(stored.irradiance(k), solution.irradiance(k), strict=True)
        for stored_row, row in pairs:
            np.testing.assert_array_equal(stored_row, row)
    assert len(stored.surfaces) == 2
    for stored_surface, surface in zip(stored.surfaces, solution.surfaces, strict=True):
        np.testing.assert_array_equal(stored_surface.emissivity, surface.emissivity)
        np.testing.assert_array_equal(stored_surface.absorptivity, surface.absorptivity)
        a = stored_surface.geometry
        b = surface.geometry
        assert (a.pose, a.pitch) == (b.pose, b.pitch)
        for field in ("vertices", "faces", "fragment_position", "fragment_area"):
            np.testing.assert_array_equal(getattr(a, field), getattr(b, field))


def test_a_camera_sees_the_same(solution, tmp_path):
    solution.save(tmp_path)
    stored = load_solution(tmp_path / "solution.npz")
    camera = jt.Camera((0.3, -0.4, 0.2), (0.0, 0.0, 0.05), width=40, height=30)
    stored_view = compute_view(stored.surfaces, solution.terms, camera)
    view = compute_view(solution.surfaces, solution.terms, camera)
    assert set(stored_view.body) == {0, 1}
    np.testing.assert_array_equal(stored_view.pixel, view.pixel)
    weights: list[Any] = [one_view.weights for one_view in (stored_view, view)]
    np.testing.assert_array_equal(weights[0].data, weights[1].data)


def test_energies_and_probes_are_read_by_name(solution, tmp_path):
    solution.save(tmp_path)
    stored = jt.load_run(tmp_path)
    assert jax.tree.structure(stored.energy) == jax.tree.structure(solution.energy)
    jax.tree.map(np.testing.assert_array_equal, stored.energy, solution.energy)
    assert stored.energy is not None
    assert set(stored.energy.mechanisms) == {"convection", "emission"}
    assert stored.probes == solution.probes
    np.testing.assert_array_equal(stored.probe_temperature, solution.probe_temperature)
    np.testing.assert_array_equal(stored.mean_temperature, solution.mean_temperature)


def test_receipt_and_steps_are_those_of_the_run(solution, tmp_path):
    solution.save(tmp_path)
    stored = jt.load_run(tmp_path)
    assert stored.heat_rates is None
    assert stored.receipt is not None
    # What this process has searched for, another one may remember.
    lasting = solution.receipt.as_dict() | {"searches": ()}
    assert stored.receipt.as_dict() == lasting
    assert stored.run == solution.run
    # A second file has the same: nothing is lost on the way.
    (tmp_path / "again").mkdir()
    stored.save(tmp_path / "again")
    again = jt.load_run(tmp_path / "again")
    assert again.receipt is not None and again.run == solution.run
    assert again.receipt.as_dict() == lasting


def test_a_steady_state_is_read_with_its_heat_rates(tmp_path):
    bodies = tuple(
        jt.Body(
            jt.FullVolume(bar(4, 0.01)),
            COPPER,
            temperature=300.0,
            pose=jt.Pose(translation=(0.0, 0.0, height)),
        )
        for height in (0.0, 0.01)
    )
    terms = (
        jt.Convection(20.0, 290.0),
        jt.HeatSource(5e4, within=jt.Everything(body=0)),
        jt.Contact(500.0),
    )
    solution = jt.steady(jt.Scene(bodies, terms), at=7.0)
    solution.save(tmp_path)
    stored = jt.load_run(tmp_path)
    assert stored.energy is None
    assert jax.tree.structure(stored.heat_rates) == jax.tree.structure(
        solution.heat_rates
    )
    jax.tree.map(np.testing.assert_array_equal, stored.heat_rates, solution.heat_rates)
    assert stored.heat_rates is not None and len(stored.heat_rates.contacts) == 1
    assert float(np.asarray(stored.load_time(0))) == 7.0
    assert stored.run is not None and stored.run.statistics is not None
    assert solution.run.statistics is not None
    assert stored.run.statistics.newton_iterations == int(
        solution.run.statistics.newton_iterations
    )


def test_a_missing_file_says_what_makes_it(tmp_path):
    with pytest.raises(jt.InputError, match="no such file; `jaxthermo simulate`"):
        load_solution(tmp_path / "solution.npz")


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.99])
def test_a_file_cut_short(solution, tmp_path, share):
    path = tmp_path / "solution.npz"
    solution.save(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(jt.InputError, match="run the simulation again") as caught:
        load_solution(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.fixture
def stored(solution, tmp_path):
    """A path, and what is stored there, with its format and checksum."""
    path = tmp_path / "solution.npz"
    solution.save(tmp_path)
    with np.load(path) as file:
        return path, dict(file)


def refused(path, words):
    with pytest.raises(jt.InputError, match=words) as caught:
        load_solution(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("version", [1, 3, 99])
def test_a_file_of_another_version_is_refused_in_one_line(stored, version):
    path, arrays = stored
    np.savez(path, **arrays | {"format_version": np.array(version)})
    refused(path, rf"version {version}, .* reads .* {FORMAT_VERSION}; run the simulat")


def test_a_file_that_was_changed_does_not_match_its_checksum(stored):
    path, arrays = stored
    warmer = arrays["surface_temperature"] + 1
    np.savez(path, **arrays | {"surface_temperature": warmer})
    refused(path, "damaged or changed, its checksum")
    del arrays["checksum"]
    np.savez(path, **arrays)
    refused(path, "damaged or changed, its checksum")


BAD_ARRAYS = {
    "surface_temperature": lambda a: a[:, 1:],
    "mean_temperature": lambda a: a[1:],
    "irradiance": lambda a: a[:, 1:],
    "irradiance_sources": lambda a: a[0],
    "source_spectrum": lambda a: a[1:],
    "energy": lambda a: a[:, 1:],
    "balance_columns": lambda a: a[:-1],
    "receipt": lambda a: a[:-1],
    "run": lambda a: np.frombuffer(b"[]", np.uint8),
    "terms": lambda a: a[1:],
    "probe_names": lambda a: a[:0],
    "heat_flux": lambda a: a[:, 1:],
    "heat_transfer_coefficient": lambda a: a * np.nan,
    "probe_temperature": lambda a: a[:, :0],
    "probe_position": lambda a: a[:, :2],
    "times": lambda a: a[::-1],
    "body0_vertices": lambda a: a * np.nan,
    "body0_faces": lambda a: a + len(a),
    "body1_faces": lambda a: a.astype(float),
    "body1_fragment_area": lambda a: a[1:],
    "body0_emissivity": lambda a: np.array(["black"]),
    "body1_translation": lambda a: a[:, :2],
    "body1_rotation": lambda a: np.zeros((3, 3, 3)),
    "body0_pitch": lambda a: None,
    "body1_pitch": lambda a: -a,
    "body0_absorptivity": lambda a: a + 2,
    "body1_fragment_normal": lambda a: a[None],
}


@pytest.mark.parametrize("name", BAD_ARRAYS)
def test_arrays_that_do_not_fit_the_schema(stored, name):
    """With a checksum that is right: another program wrote them."""
    path, arrays = stored
    changed_arrays = {
        k: v for k, v in arrays.items() if not k.startswith(("format", "check"))
    }
    changed = BAD_ARRAYS[name](changed_arrays.pop(name))
    changed_arrays |= {} if changed is None else {name: changed}
    write_archive(
        path, format_name="solution", version=FORMAT_VERSION, arrays=changed_arrays
    )
    refused(path, "run the simulation again")


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "solution.npz")
    refused(tmp_path / "solution.npz", "a pipe or a device")


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
