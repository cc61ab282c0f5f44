"""Sheets in fits, references, plans and sweeps."""

import math

import numpy as np
import pytest

import jaxthermo as jt
from calibrate.plan.candidate import Candidate
from calibrate.plan.predict import Size, expected_nodes, scene_size
from calibrate.problem.parameters import (
    Parameter,
    ParameterSet,
    find_paths,
    value_at,
)
from calibrate.problem.reference import full_volume_run
from calibrate.problem.sheet_cells import resized_sheet, through_count
from jaxthermo.config.loader import load_config
from jaxthermo.scene.dimensionless_groups import scene_numbers
from tests.sheet_scenes import BOX, PLATE


STEEL = jt.Layer("steel", 1e-3)
GLASS = jt.Layer("car_glass", 4e-3)
WOOL = jt.Layer("mineral_wool", 0.01)


@pytest.fixture
def config_of(tmp_path):
    def load(text, *overrides):
        path = tmp_path / "scene.yaml"
        path.write_text(text)
        return load_config(path, overrides)

    return load


def scene_of_parts():
    plate = jt.shapes.rectangle(1.0, 1.0)
    parts = {
        "roof": plate,
        "glass_left": plate.moved((1.0, 0.0, 0.0)),
        "glass_right": plate.moved((2.0, 0.0, 0.0)),
    }
    layers = {"glass_*": (GLASS,), "*": (STEEL, WOOL)}
    sheet = jt.Sheet(parts, layers, 0.5, cells=1)
    return jt.Scene((jt.Body(sheet, temperature=300.0),), (jt.Convection(5.0, 290.0),))


@pytest.mark.parametrize(
    ("name", "parts", "value"),
    [
        ("sheet.layers.0.thickness", (0, 1, 2), 1e-3),
        ("sheet.layers.glass_*.0.thickness", (1, 2), 4e-3),
        ("bodies.0.sheet.layers.roof.1.thickness", (0,), 0.01),
    ],
)
def test_a_layer_is_that_of_the_parts_that_are_named(name, parts, value):
    scene = scene_of_parts()
    paths = find_paths(scene, name)
    assert [path[4] for path in paths] == list(parts)
    assert value_at(scene, paths[0]) == value
    parameters = ParameterSet((Parameter(name, (value,), 0.0),))
    parameters.check(scene)
    changed = parameters.insert(scene, np.array([math.log(2.0)]))
    for path in paths:
        assert float(value_at(changed, path)) == pytest.approx(2 * value)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sheet.layers.door.0.thickness", "there is no part 'door'; there are roof"),
        ("sheet.layers.roof.2.thickness", r"stacks.0.0 has no '2'|stacks.0 has no '2'"),
        ("bodies.1.sheet.layers.0.thickness", "there is no sheet of body 1"),
        ("bodies.0.structure.weights.within", "has no 'weights'"),
    ],
)
def test_a_layer_that_there_is_not_is_refused(name, message):
    with pytest.raises(jt.InputError, match=message):
        find_paths(scene_of_parts(), name)


def test_one_number_has_one_name():
    names = ("sheet.layers.0.thickness", "bodies.0.structure.stacks.1.0.thickness")
    parameters = ParameterSet(tuple(Parameter(name, (1e-3,), 0.0) for name in names))
    with pytest.raises(jt.InputError, match="leave one of them out"):
        parameters.check(scene_of_parts())


def test_numbers_of_a_wall_are_those_through_its_thickness():
    wall = jt.Sheet(jt.shapes.rectangle(1.0, 1.0), (STEEL, WOOL), 0.5, cells=1)
    body = jt.Body(wall, temperature=300.0)
    scene = jt.Scene((body,), (jt.Convection(5.0, 290.0),))
    numbers = scene_numbers(scene, 100.0)
    resistance = STEEL.resistance + WOOL.resistance
    capacity = STEEL.capacity + WOOL.capacity
    # Both faces: half of the thickness is the volume over the area.
    assert numbers["biot"] == pytest.approx(5.0 * resistance / 2)
    assert numbers["fourier"] == pytest.approx(4 * 100.0 / (resistance * capacity))


def test_finer_cells_are_finer_through_the_thickness_too(config_of):
    body = config_of(BOX, "bodies.0.sheet.cells=4").bodies[0]
    assert resized_sheet(body, 0.05, size=1.0) == body
    counts = []
    for size in (2.0, 1.0, 0.5, 0.25):
        finer = resized_sheet(body, 0.05 * size, size)
        assert finer.wall is not None
        counts.append(through_count(finer.wall))
        built = finer.build().structure
        assert built.cells_through == counts[-1]
        assert built.grid.pitch == pytest.approx(0.05 * size)
    assert counts[1] == 4
    assert counts == sorted(set(counts))


def test_the_ground_keeps_its_back_in_other_cells(config_of):
    ground = """
bodies:
  - shape: {kind: ground, size: [2 m, 2 m], layers: soil}
    temperature: 285
terms: []
time: {end: 60, save_at: [60]}
"""
    body = config_of(ground).bodies[0]
    coarse = resized_sheet(body, 1.0, size=4.0)
    assert coarse.wall is not None
    assert body.wall is not None
    assert coarse.wall.held == 285.0
    assert through_count(coarse.wall) < through_count(body.wall)
    assert coarse.build().structure.grid.pitch == 1.0


def test_a_candidate_of_sheets_is_a_scene_in_other_cells(config_of):
    config = config_of(PLATE)
    candidate = Candidate(2.0, "sheet", steps=12)
    body = candidate.applied(config, (0.04,)).bodies[0]
    assert body.sheet is not None
    assert (body.pitch, body.sheet.pitch) == (None, 0.02)
    assert candidate.words((0.04,)) == "sheets in cells of 20 mm, RKL2, 12 steps"
    size = scene_size(config, (0.04,))
    assert size.is_of_sheets
    nodes = body.build().structure.node_count
    assert expected_nodes(candidate, size) == pytest.approx(nodes, rel=0.3)


def test_cells_of_sheets_are_as_large_as_blocks_beside_them(config_of):
    solid = """
  - shape: {kind: box, size: [20 cm, 20 cm, 20 cm]}
    pitch: 2 cm
    material: steel
    temperature: 20 degC
    pose: {translation: [1, 0, 0]}
terms:"""
    config = config_of(PLATE.replace("\nterms:", solid, 1))
    candidate = Candidate(2.0, "aggregate", 3)
    plate, box = candidate.applied(config, (0.04, 0.02)).bodies
    assert plate.sheet is not None
    assert plate.sheet.pitch == pytest.approx(0.06)
    assert box.pitch == 0.01
    size = scene_size(config, (0.04, 0.02))
    assert size.volume == pytest.approx(1000.0)
    edge = size.edge_of(500)
    assert 1000.0 / edge**3 + 50.0 / edge**2 == pytest.approx(500.0)
    assert Size(1000.0, 600.0).edge_of(125) == pytest.approx(2.0)


def test_the_reference_of_a_wall_has_a_small_error_in_time(config_of):
    """A plate of one temperature that air warms: exponential in time."""
    text = PLATE.replace("20, temperature: 20 degC", "20, temperature: 60 degC")
    config = config_of(text, "terms.0.heat_flux=0", "dtype=float64")
    run = full_volume_run(config, 0.25, lambda text: None)
    (layer,) = config.bodies[0].build().structure.stacks[0]
    decay = np.exp(-2 * 20.0 * np.asarray(run.times[-2:]) / layer.capacity)
    kelvin = np.asarray(run.surface_temperature)[-2:]
    exact = 333.15 - 40.0 * decay[:, None]
    # Compared with the change that the run shows.
    assert np.abs(kelvin - exact).max() < 1e-3 * 40.0
