"""Scene files and folders of runs in Python: what a command has, Python has."""

from dataclasses import replace
from typing import Any

import jax
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.config.loader import load_config
from jaxthermo.geometry.vectors import unit_vector
from jaxthermo.image.files.exr import read_exr
from jaxthermo.physics.radiation.source import AbstractSource
from jaxthermo.physics.time_varying import value_at
from jaxthermo.voxels.selection import AbstractSelection
from tests.cli.cli_runs import SCENE, scene_file, succeed


OVERRIDES = ["bodies.0.voxels_high=6", "probes={core: [0, 0, 0]}"]
LAST = "t000020.00s.exr"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    moved = SCENE.replace(
        "    temperature: 300", "    name: block\n    temperature: 300"
    )
    path = scene_file(tmp_path_factory.mktemp("scene"), moved)
    return jt.load_scene(path, OVERRIDES)


@pytest.fixture(scope="module")
def solution(file):
    return file.simulate()


@pytest.fixture(scope="module")
def folder(file, tmp_path_factory):
    """Folder of the command, from the file that Python wrote."""
    folder = tmp_path_factory.mktemp("command")
    file.save(folder / "block.yaml")
    succeed("simulate", folder / "block.yaml", "--out", folder / "run")
    return folder / "run"


def test_a_scene_file_has_what_its_run_needs(file):
    assert (file.t1, file.save_at) == (20.0, (5.0, 12.0, 20.0))
    assert [term.name for term in file.scene.terms] == [
        "sun",
        "convection",
        "emission",
    ]
    assert file.scene.probes[0].name == "core"
    assert file.scene.bodies[0].structure.grid.solid.shape[2] == 6


def test_a_saved_scene_loads_to_an_equal_one(file, folder):
    saved = load_config(folder.parent / "block.yaml")
    assert saved == file.config
    assert (folder / "config.yaml").read_text() == (
        folder.parent / "block.yaml"
    ).read_text()


def equal_runs(first, second):
    """Bit for bit, with the places and properties of all surfaces."""
    for name in ("terms", "energy", "irradiances", "probes"):
        one, other = getattr(first, name), getattr(second, name)
        assert jax.tree.structure(one) == jax.tree.structure(other), name
        jax.tree.map(np.testing.assert_array_equal, one, other)
    for name in ("times", "surface_temperature", "mean_temperature"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    np.testing.assert_array_equal(first.probe_temperature, second.probe_temperature)
    for one, other in zip(first.surfaces, second.surfaces, strict=True):
        assert one.geometry.name == other.geometry.name == "block"
        np.testing.assert_array_equal(one.geometry.vertices, other.geometry.vertices)
        np.testing.assert_array_equal(one.emissivity, other.emissivity)


def test_folders_of_the_command_and_of_python_are_one(solution, folder, tmp_path):
    solution.save(tmp_path / "new" / "run")
    by_command, by_python = jt.load_run(folder), jt.load_run(tmp_path / "new" / "run")
    assert type(by_command) is type(by_python) is jt.StoredSolution
    equal_runs(by_command, by_python)
    equal_runs(by_python, solution.stored())
    # What was read can be written again.
    by_command.save(tmp_path / "again")
    equal_runs(jt.load_run(tmp_path / "again"), by_command)


def test_a_loaded_run_is_drawn_as_the_solution_and_as_the_command(
    file, solution, folder
):
    run = jt.load_run(folder)
    images = [file.render(one) for one in (solution, run)]
    np.testing.assert_array_equal(images[0].radiance, images[1].radiance)
    assert set(np.unique(images[0].object_id)) == {-1, 0}
    frame, _ = read_exr(folder / "frames" / LAST)
    seen = images[0].object_id >= 0
    np.testing.assert_allclose(
        np.asarray(images[0].temperature)[seen], frame["temperature_K"][seen], rtol=1e-6
    )
    np.testing.assert_array_equal(
        list(file.frames(run))[-1].radiance, images[1].radiance
    )
    assert jt.probe(run)[-1] == jt.probe(solution)[-1]


def test_a_folder_of_results_is_not_written_over(solution, folder):
    with pytest.raises(jt.InputError, match="has the results of `jaxthermo simulate`"):
        solution.save(folder)


def test_a_folder_that_is_a_file_is_one_line(solution, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(jt.InputError, match="cannot be created: file exists"):
        solution.save(tmp_path / "file")


def test_a_missing_run_and_a_text_of_overrides_are_one_line(tmp_path, file):
    with pytest.raises(jt.InputError, match="no such file; `jaxthermo simulate`"):
        jt.load_run(tmp_path)
    with pytest.raises(jt.InputError, match="give a list of texts"):
        jt.load_scene(tmp_path / "block.yaml", "time.end=3")
    with pytest.raises(jt.InputError, match="terms.0.colour: unknown key"):
        jt.load_scene(scene_file(tmp_path), ["terms.0.colour=3"])


def test_functions_of_time_are_stored_by_their_values(solution, tmp_path):
    """A camera needs sky and sources at the saved times alone."""

    terms = (
        jt.Sun(lambda time: (-1.0, 0.1 * time, -1.0), lambda time: 900.0 + time),
        jt.Surroundings(lambda time: 280.0 + time, ground=jt.Until(290.0, 12.0)),
        jt.Wind((3.0, 0.0, 0.0), 285.0),
        jt.Convection(5.0, 280.0, on=jt.Side((0.0, 0.0, 1.0))),
    )
    changed = replace(solution, terms=terms)
    changed.save(tmp_path)
    stored: Any = jt.load_run(tmp_path)
    sun, surroundings, air = stored.terms
    assert sun.direction(5.0) == pytest.approx(unit_vector((-1.0, 0.5, -1.0)))
    for time in (5.0, 12.0, 20.0):
        earlier = np.float64(time * (1 - 1e-9))
        assert float(value_at(sun.irradiance, earlier)) == pytest.approx(900 + time)
        sky = float(value_at(surroundings.temperature, earlier))
        assert sky == pytest.approx(280 + time)
    assert surroundings.ground == jt.Until(290.0, 12.0)
    assert (air.heat_transfer_coefficient, air.temperature) == (0.0, 285.0)


def test_a_source_that_no_file_has_is_told(solution, tmp_path):
    class Lamp(AbstractSource):
        name = "lamp"
        location_field = "place"
        place: tuple[float, float, float] = (0.0, 0.0, 1.0)
        on: AbstractSelection | None = None

        @property
        def strength(self):
            return 1.0

        def unshaded(self, position, normal):
            return np.zeros((1, len(position)))

        def lit_samples(self, triangles, position, normal, pitch):
            return np.zeros((1, len(position)), np.uint8)

    with pytest.warns(UserWarning, match="a file has no Lamp: images .* without it"):
        replace(solution, terms=(Lamp(),)).save(tmp_path)
    assert jt.load_run(tmp_path).terms == ()


def test_a_steady_state_is_stored_too(tmp_path):
    grid = jt.grid_from_voxels(np.ones((2, 2, 2), bool), pitch=0.01)
    body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=300.0)
    steady = jt.steady(jt.Scene((body,), (jt.Convection(10.0, 290.0),)))
    steady.save(tmp_path)
    run = jt.load_run(tmp_path)
    assert run.energy is None
    np.testing.assert_array_equal(run.surface_temperature, steady.surface_temperature)
    assert float(run.load_time(0)) == float(steady.load_time(0)) == 0.0


def test_progress_is_told_and_changes_nothing(file, solution):
    told = []

    class Told:
        def __enter__(self):
            return self

        def __exit__(self, *reason):
            told.append("end")

        def stage(self, name, total=None, done=0):
            told.append(name)

        def reach(self, done, note=""):
            told.append(note)

        def advance(self, count=1):
            raise AssertionError

        def line(self, text):
            raise AssertionError

    shown = file.simulate(progress=Told)
    assert told[0] == "simulating" and told[-2:] == ["20 s of 20 s", "end"]
    np.testing.assert_array_equal(
        shown.surface_temperature, solution.surface_temperature
    )
    jax.tree.map(np.testing.assert_array_equal, shown.energy, solution.energy)
