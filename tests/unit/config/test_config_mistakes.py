"""Each mistake in a config: one clear line with its path, all of them at once."""

import re

import pytest

from jaxthermo.config.loader import load_config
from jaxthermo.config.strict_yaml import write_yaml
from jaxthermo.errors import InputError


def good() -> dict:
    return {
        "bodies": [
            {
                "shape": {"kind": "box", "size": [0.1, 0.1, 0.1]},
                "pitch": "5 mm",
                "material": "copper",
                "temperature": "20 degC",
            }
        ],
        "terms": [{"kind": "sun", "direction": [0, 0, -1], "irradiance": 800}],
        "time": {"end": "3 min", "save_at": [60, 180]},
    }


@pytest.fixture
def lines(tmp_path):
    """A function from config data to the lines of its message."""

    def load(data: dict, *overrides: str) -> list[str]:
        path = tmp_path / "scene.yaml"
        path.write_text(write_yaml(data))
        with pytest.raises(InputError) as caught:
            load_config(path, overrides)
        return str(caught.value).replace(str(path), "F").split("\n")

    return load


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("bodies.0.pich=1", "bodies.0.pich: unknown key; did you mean 'pitch'?"),
        ("bodies.0.pitch=5 s", "bodies.0.pitch: expected a length such as '2 mm'"),
        ("bodies.0.pitch=true", "bodies.0.pitch: expected a length"),
        ("bodies.0.pitch=0", "bodies.0.pitch: must be more than 0"),
        ("bodies.0.pitch=.nan", "bodies.0.pitch: must be finite"),
        ("bodies.0.voxels_high=2.5", "voxels_high: expected a whole number, got 2.5"),
        ("bodies.0.temperature=20", "20 K is below 150 K .*write '20 degC'"),
        ("bodies.0.temperature=1e7", "1e\\+07 K is above 6000 K; if it is meant, set"),
        ("bodies.0.temperature=", "bodies.0.temperature: expected a temperature"),
        ("bodies.0.material=coper", "material.name: unknown material 'coper'; did .*"),
        (
            "bodies.0.material={density: 1, specific_heat: 1}",
            "material.conductivity: missing",
        ),
        (
            "bodies.0.material={name: gold, emissivity: 2}",
            "emissivity: must be at most",
        ),
        ("bodies.0.shape.size=[1, 2]", "shape.size: expected three numbers"),
        ("bodies.0.shape.size=[1, 2, -1]", "shape.size.2: must be more than 0"),
        (
            "bodies.0.shape.kind=bax",
            "bodies.0.shape.kind: unknown kind 'bax'; did .* 'box'",
        ),
        (
            "bodies.0.shape={radius: 1}",
            "bodies.0.shape: expected a mapping with a `kind",
        ),
        ("bodies.0.mesh={path: scene.yaml}", "mesh: missing `unit` or `height`"),
        (
            "bodies.0.mesh={path: a.obj, unit: mm}",
            "path: there is no file 'a.obj'; look",
        ),
        (
            "bodies.0.mesh={path: scene.yaml, unit: kg}",
            "mesh.unit: expected a length unit",
        ),
        (
            "bodies.0.structure.kind=octre",
            "structure.kind: unknown kind 'octre'; did you mean 'octree'?",
        ),
        (
            "bodies.0.pose.rotation={axis: [0, 0, 0], angle: 1}",
            "rotation.axis: must not",
        ),
        ("bodies=[]", "bodies: must not be empty"),
        ("bodies=3", "bodies: expected a list, got 3"),
        ("terms=[{kind: sum}]", "terms.0.kind: unknown kind 'sum'; did .* 'sun'?"),
        ("terms=[sun]", "terms.0: expected a mapping with a `kind`, got 'sun'"),
        ("terms.0.direction=[0, 0, 0]", "terms.0.direction: must not be"),
        ("terms.0.irradiance=-3", "terms.0.irradiance: must be at least 0"),
        ("terms.0.irradiance=8 kg", "terms.0.irradiance: expected an irradiance"),
        (
            "terms.0.irradiance={times: [0, 0], values: [1, 2]}",
            "terms.0.irradiance.times.1: 0 s is not after 0 s",
        ),
        (
            "terms.0.irradiance={times: [0, 1], values: [1]}",
            "terms.0.irradiance.values: there are 1 values for 2 times",
        ),
        (
            "terms=[{kind: heat_flux, heat_flux: 1, on: {side: {normal: [1, 0, 0], "
            "body: 1}}}]",
            "terms.0.on.side.body: there is no body 1",
        ),
        (
            "terms=[{kind: heat_flux, heat_flux: 1, on: {region: {lower: [0, 0, 0], "
            "upper: [1, 0, 1]}}}]",
            "terms.0.on.region.upper.1: 0 m is not above",
        ),
        ("time.end=100", "time.save_at.1: 180 s is after the end, 100 s"),
        ("time.save_at=[60, 60]", "time.save_at.1: 60 s is not after 60 s"),
        ("time.save_at=[0]", "time.save_at.0: must be more than 0"),
        ("time.save_every=1 us", "time.save_every: would save more than"),
        ("time={end: 3}", "time: missing `save_at` or `save_every`"),
        (
            "time={end: 3, save_at: [1], save_every: 1}",
            "time.save_every: give .*not both",
        ),
        ("solver.dt=-1", "solver.dt: must be more than 0"),
        ("camera.width=0", "camera.width: must be at least 1"),
        ("camera.field_of_view=35", "camera.field_of_view: must be less than 3.14"),
        (
            "camera={position: [1, 0, 0], look_at: [1, 0, 0]}",
            "camera.look_at: is where",
        ),
        ("camera={position: [0, 0, 2], look_at: [0, 0, 0]}", "camera.up: is along"),
        (
            "terms=[{kind: surroundings, temperature: 290},"
            " {kind: surroundings, temperature: 280}]",
            "terms.1: surroundings would count the emission twice, after surroundings",
        ),
        (
            "image.palette=irn",
            "image.palette: unknown palette 'irn'; did you mean 'iron'",
        ),
        ("image.smooth=yes", "image.smooth: expected true or false, got 'yes'"),
        ("image={low: 300, high: 290}", "image.high: 290 K is not above"),
        ("image.frames=[60, 61]", "image.frames.1: 61 s is not a saved time"),
        ("dtype=float16", "dtype: 'float16' is not known; did you mean 'float"),
        ("name=3", "name: expected a word or a text, got 3"),
        ("allow_extreme_temperatures=1", "allow_extreme.*: expected true or false"),
    ],
)
def test_each_mistake_is_one_line_with_its_path(lines, override, line):
    (only,) = lines(good(), override)
    assert re.search(line.replace("?", r"\?"), only), only
    assert len(only) < 400


def test_seven_mistakes_are_seven_lines(lines):
    data = good()
    body = data["bodies"][0]
    del body["temperature"]
    body |= {"pitch": "5 s", "voxels_high": 3, "shap": 1}
    data["terms"].append(
        {"kind": "heat_flux", "heat_flux": 1, "on": {"side": {"normal": [1, 0, 0]}}}
    )
    data["terms"][1]["on"]["side"]["body"] = 4
    data["time"]["save_at"] = [60, 200]
    data["image"] = {"frames": "none"}
    mistakes = lines(data)
    assert len(mistakes) == 7, mistakes
    assert all(line.startswith("F: ") for line in mistakes)


def test_one_mistake_in_many_bodies_is_one_line(lines):
    data = good()
    body = {**data["bodies"][0], "pich": "5 mm"}
    data["bodies"] = [body] * 200
    told = lines(data)
    assert told == [
        "F: bodies.0.pich: unknown key; did you mean 'pitch'? - and 199 more like it"
    ]


def test_frames_are_checked_while_other_parts_are_wrong(lines):
    data = good() | {"image": {"frames": [1], "palette": "none"}}
    assert len(lines(data)) == 2


def test_a_missing_mesh_says_where_it_was_looked_for(lines, tmp_path, monkeypatch):
    monkeypatch.setenv("JAXTHERMO_MESHES", str(tmp_path / "meshes"))
    (line,) = lines(good(), "bodies.0.mesh={path: a.obj, unit: mm}")
    assert f"looked in {tmp_path}, {tmp_path / 'meshes'}" in line


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("pitch", "expected a path and a value"),
        ("a..b=1", "expected a path and a value"),
        ("camra.width=3", "camra: unknown key; did you mean 'camera'?"),
        ("bodies.3.pitch=1", "`bodies` has 1 entries"),
        ("bodies.pitch=1", "`bodies` is a list: give an index"),
        ("time.0=1", "`time` is not a list"),
        ("boddies.0.pitch=1", "did you mean 'bodies'"),
        ("bodies.0.shape.kind=bax", "bodies.0.shape.kind: unknown kind 'bax'"),
        ("bodies.0.structure.kind=octre", "structure.kind: unknown kind 'octre'"),
        ("bodies.0.temperature.of=1", "is '20 degC' in the config"),
        ("camera.width=[1", "line 1"),
    ],
)
def test_a_bad_override_names_itself(lines, override, message):
    (line,) = lines(good(), override)
    assert line.startswith("--set "), line
    assert message in line


def test_a_config_that_contains_itself(tmp_path):
    path = tmp_path / "loop.yaml"
    path.write_text("bodies: &a [*a]\ntime: {end: 1, save_at: [1]}\n")
    with pytest.raises(InputError):
        load_config(path)
