"""Sheets in files: layers, stacks, parts and faces, and what is refused."""

import json

import numpy as np
import pytest
import trimesh

import jaxthermo as jt
from jaxthermo.__main__ import main
from jaxthermo.config.loader import load_config, to_yaml
from jaxthermo.errors import InputError


SCENE = """
bodies:
  - {geometry}
    temperature: 20 degC
    {lines}
time: {{end: 60, save_at: [60]}}
"""
PANEL = "shape: {kind: rectangle, width: 1 m, length: 50 cm}"
STEEL = "{material: steel, thickness: 0.8 mm}"
DOOR = (
    "shape: {kind: parts, parts: {panel: {shape: {kind: rectangle, width: 1, "
    "length: 1}}, pane: {shape: {kind: rectangle, width: 1, length: 1}, pose: "
    "{translation: [1, 0, 0]}}}}"
)


@pytest.fixture
def scene(tmp_path):
    """A function from a geometry and lines of a body, and overrides, to the config."""

    def load(geometry: str, *lines: str, overrides: tuple[str, ...] = ()):
        path = tmp_path / "scene.yaml"
        path.write_text(SCENE.format(geometry=geometry, lines="\n    ".join(lines)))
        config = load_config(path, overrides)
        path.write_text(to_yaml(config))
        assert load_config(path) == config
        return config

    return load


def test_layers_are_those_of_the_sheet(scene):
    config = scene(
        PANEL,
        f"sheet: {{layers: [{STEEL}, {{material: {{name: mineral_wool, density: 80}}, "
        "thickness: 4 cm}], pitch: 25 cm, cells: 3, nodes: vertices, weld: 1 mm}",
    )
    body = config.bodies[0].build()
    (layers,) = body.structure.stacks
    assert layers[0] == jt.Layer("steel", 0.8e-3)
    assert (layers[1].material.density, layers[1].thickness) == (80.0, 0.04)
    assert body.structure.cells_through == 3
    assert body.material is None
    assert body.structure.surface_cells == 4
    assert config.bodies[0].build_grid().pitch == 0.25


def test_the_pitch_is_a_hundredth_of_the_size(scene):
    body = scene(PANEL, f"sheet: {{layers: [{STEEL}]}}").bodies[0]
    assert body.build_grid().pitch == pytest.approx(0.01)


def test_a_stack_of_the_ground_has_a_name(scene, refused):
    body = scene(PANEL, "sheet: {layers: asphalt, pitch: 50 cm}").bodies[0].build()
    assert body.structure.stacks == (jt.stacks["asphalt"],)
    assert body.structure.cells_through > 4
    (line,) = refused(PANEL, "sheet: {layers: asfalt}")
    assert line == (
        "bodies.0.sheet.layers: unknown stack 'asfalt'; did you mean 'asphalt'?"
    )


def test_layers_by_part_of_a_shape(scene):
    layers = f"{{pane: [{{material: car_glass, thickness: 4 mm}}], '*': [{STEEL}]}}"
    body = scene(DOOR, f"sheet: {{layers: {layers}, pitch: 25 cm}}").bodies[0].build()
    panel, pane = body.structure.stacks
    assert panel == (jt.Layer("steel", 0.8e-3),)
    assert pane == (jt.Layer("car_glass", 4e-3),)
    area = body.structure.grid.cells.area.sum(axis=0)
    np.testing.assert_allclose(area, [1.0, 1.0])
    missing = scene(DOOR, f"sheet: {{layers: {{pane: [{STEEL}]}}, pitch: 25 cm}}")
    with pytest.raises(InputError, match="the part 'panel' has none"):
        missing.bodies[0].build()


def test_an_open_mesh_of_a_file_stays_open(scene, tmp_path):
    tray = jt.shapes.tray((1.0, 1.0, 1.0))
    model = trimesh.Scene()
    model.add_geometry(
        trimesh.Trimesh(tray.vertices, tray.faces, process=False), node_name="bin"
    )
    (tmp_path / "bin.glb").write_bytes(model.export(file_type="glb"))
    mesh = "mesh: {path: bin.glb, unit: m}"
    config = scene(mesh, f"sheet: {{layers: {{bin: [{STEEL}]}}, pitch: 20 cm}}")
    sheet = config.bodies[0].build().structure
    assert sheet.grid.cells.area.sum() == pytest.approx(5.0)
    assert sheet.grid.cells.border == pytest.approx(4.0)


def test_terms_and_coatings_are_on_one_face(scene, refused):
    term = "terms=[{kind: heat_flux, heat_flux: 10, on: {face: back}}]"
    coating = "coatings: [{finish: 'car paint, white', on: {face: front}}]"
    sheet = f"sheet: {{layers: [{STEEL}], pitch: 25 cm}}"
    config = scene(PANEL, sheet, coating, overrides=(term,))
    built = config.build()
    assert built.terms[0].on == jt.Face("back")
    assert built.bodies[0].coatings[0].on == jt.Face("front")
    both = "terms=[{kind: heat_flux, heat_flux: 10, on: {face: {name: back, body: 1}}}]"
    with pytest.raises(InputError, match="there is no body 1"):
        scene(PANEL, sheet, overrides=(both,))
    (line,) = refused(PANEL, sheet, "coatings: [{emissivity: 1, on: {face: top}}]")
    assert "bodies.0.coatings.0.on.face" in line


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("sheet: {layers: []}",), "sheet.layers: must not be empty"),
        (("sheet: {layers: [{material: steel}]}",),
         "sheet.layers.0.thickness: missing"),
        (("sheet: {layers: [{thickness: 1 mm}]}",),
         "sheet.layers.0.material: missing"),
        (("sheet: {layers: [{material: steel, thickness: 0}]}",),
         "sheet.layers.0.thickness: must be more than 0"),
        (("sheet: {layers: [{material: steel, thickness: -1 mm}]}",),
         "sheet.layers.0.thickness: must be more than 0"),
        ((f"sheet: {{layers: [{STEEL}], cells: 0}}",), "sheet.cells: must be at least"),
        ((f"sheet: {{layers: [{STEEL}]}}", "material: steel"),
         "material: the layers of the `sheet` have their materials"),
        ((f"sheet: {{layers: [{STEEL}]}}", "structure: octree"),
         "structure: a `sheet` has its own structure"),
        ((f"sheet: {{layers: [{STEEL}]}}", "pitch: 1 cm"), "pitch"),
        (("pitch: 1 cm",), "material: missing, and it has no default"),
    ],
)  # fmt: skip
def test_each_mistake_is_one_line_with_its_path(refused, lines, message):
    (line,) = refused(PANEL, *lines)
    assert line.startswith("bodies.0") and message in line


def test_a_sheet_is_simulated_and_reported(scene, tmp_path, capsys):
    path = tmp_path / "run.yaml"
    sheet = f"sheet: {{layers: [{STEEL}], pitch: 25 cm}}"
    term = "terms=[{kind: heat_flux, heat_flux: 1 kW/m^2, on: {face: front}}]"
    camera = "camera={width: 16, height: 12}"
    path.write_text(to_yaml(scene(PANEL, sheet, overrides=(term, camera))))
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as stopped:
        main(["simulate", str(path), "--out", str(out)])
    assert stopped.value.code == 0
    assert "cells of 250 mm on a surface" in capsys.readouterr().out
    summary = json.loads((out / "summary.json").read_text())
    (structure,) = summary["structures"]
    assert structure["surface_cells"] == structure["nodes"]
    rise = 1000.0 * 60.0 / (7800.0 * 450.0 * 0.8e-3)
    mean = summary["bodies"][0]["mean_temperature_K"][-1]
    assert mean == pytest.approx(293.15 + rise, abs=1e-3)
