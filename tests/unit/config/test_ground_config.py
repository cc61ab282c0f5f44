"""The ground in files, and what reaches the back of a sheet."""

import pytest

import jaxthermo as jt
from jaxthermo.config.loader import load_config, to_yaml
from jaxthermo.errors import InputError


SCENE = """
bodies:
  - shape: {shape}
    temperature: 20 degC
    {lines}
{more}
time: {{end: 60, save_at: [60]}}
"""
PANEL = "{kind: rectangle, width: 1 m, length: 50 cm}"
SOIL = "{kind: ground, size: [20 m, 10 m], layers: soil}"
GROUND = "{kind: ground, size: [20 m, 10 m]}"


@pytest.fixture
def scene(tmp_path):
    """A function from a shape, lines of its body, and more of the file, to a config."""

    def load(shape: str, lines: str = "", more: str = ""):
        path = tmp_path / "scene.yaml"
        path.write_text(SCENE.format(shape=shape, lines=lines, more=more))
        config = load_config(path)
        path.write_text(to_yaml(config))
        assert load_config(path) == config
        return config

    return load


@pytest.fixture
def refused(scene):
    """A function from the same to the lines of refusal, without the file's name."""

    def load(*arguments: str) -> list[str]:
        with pytest.raises(InputError) as caught:
            scene(*arguments)
        return [line.split(": ", 1)[-1] for line in str(caught.value).splitlines()]

    return load


def test_ground_is_a_stack_that_is_held_below_at_its_first_temperature(scene):
    built = scene(SOIL).build()
    (held,) = built.terms
    assert held == jt.FixedTemperature(293.15, on=jt.Face("back"))
    sheet = built.bodies[0].structure
    assert sheet.stacks == (jt.stacks["soil"],)
    assert sheet.grid.pitch == pytest.approx(0.2)
    lower, upper = sheet.grid.mesh.bounds
    assert (lower.tolist(), upper.tolist()) == ([-10, -5, 0], [10, 5, 0])
    assert (sheet.grid.mesh.area_vectors[:, 2] > 0).all()
    # Narrow at the front alone.
    (division,) = sheet.divisions
    assert division[0][0] < 0.01 < 0.1 < division[-1][0]


@pytest.mark.parametrize(
    ("back", "temperature"),
    [("12 degC", 285.15), ("adiabatic", None), ("open", None), (None, 293.15)],
)
def test_the_back_of_ground_is_a_choice(scene, back, temperature):
    option = f"back: {back}, " if back else ""
    lines = f"sheet: {{{option}layers: soil, pitch: 5 m, cells: 2}}"
    built = scene(GROUND, lines).build()
    temperatures = [term.temperature for term in built.terms]
    assert temperatures == ([] if temperature is None else [temperature])
    assert (built.bodies[0].structure.grid.adiabatic is None) == (back == "open")


def test_a_back_that_is_held_is_that_of_its_body(scene):
    sheet = "sheet: {layers: soil, pitch: 1 m, cells: 1, back: 0 degC}"
    second = f"  - {{shape: {PANEL}, {sheet}, temperature: 280}}"
    flux = "terms: [{kind: heat_flux, heat_flux: 1, on: {face: front}}]"
    plain = "sheet: {layers: soil, pitch: 1 m, cells: 1}"
    terms = scene(PANEL, plain, f"{second}\n{flux}").build().terms
    assert terms[0].on == jt.Face("front")
    assert terms[1:] == (jt.FixedTemperature(273.15, on=jt.Face("back", body=1)),)


@pytest.mark.parametrize(
    ("shape", "lines", "words"),
    [
        (GROUND, "", "missing `pitch` or `voxels_high` or `sheet` or `shape.layers`"),
        (GROUND, "pitch: 1 m\n    material: copper", "shape: has no inside: give its"),
        (SOIL, "pitch: 1 m", "give `pitch` or `voxels_high` or `sheet` or `shape.lay"),
        (SOIL, "sheet: {layers: soil}", "bodies.0.shape.layers: give `pitch` or"),
        (SOIL, "material: copper", "material: the layers of the `sheet`"),
        (SOIL.replace("soil", "soyl"), "", "unknown stack 'soyl'; did you mean"),
        (SOIL.replace("20 m", "0 m"), "", "shape.size.0: must be more than 0"),
        (PANEL, "sheet: {layers: soil, back: dry}", "sheet.back: expected a temperat"),
        (PANEL, "sheet: {layers: soil, back: -300 degC}", "is below absolute zero"),
        (
            f"{{kind: parts, parts: {{yard: {{shape: {SOIL}}}}}}}",
            "sheet: {layers: soil}",
            "a part has no layers: give them in the `sheet` of the body",
        ),
    ],
)
def test_each_mistake_is_one_line(refused, shape, lines, words):
    (line,) = refused(shape, lines)
    assert words in line
