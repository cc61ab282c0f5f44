"""The comparison's configs: the shipped ones load; mistakes are told with a path."""

from pathlib import Path

import numpy as np
import pytest

from experiments.structures.config import body_identity, load_comparison
from experiments.structures.study import all_cases, rays
from jaxthermo.errors import InputError
from jaxthermo.geometry.load import _axes_for_up, _axes_rotation


CONFIGS = Path(__file__).resolve().parents[3] / "configs" / "experiments"

SMALL = """
bodies: [{shape: {kind: sphere, radius: 5 cm}}]
voxels_high: 12
material: stainless_steel
temperature: 300
sun: {irradiance: 5 kW/m^2, until: 5}
loads: [+x]
time: {end: 20, save_at: [5, 20]}
structures: [{label: octree, structure: octree}]
picture: {load: +x, time: 5}
"""


def load(folder: Path, text: str, **how):
    path = folder / "small.yaml"
    path.write_text(text)
    return load_comparison(path, **how)


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda p: p.name)
def test_shipped_configs_load(path):
    config = load_comparison(path, find_meshes=False)
    labels = [case.label for case in all_cases(config)]
    assert labels[0] == "full volume" and len(labels) == len(set(labels)) > 5


def test_the_height_takes_the_place_of_the_configs(tmp_path):
    assert load(tmp_path, SMALL, height=30).voxels_high == 30


def test_a_mesh_counts_with_its_content_not_with_its_place(tmp_path):
    text = SMALL.replace(
        "shape: {kind: sphere, radius: 5 cm}", "mesh: {path: ball.obj, unit: m}"
    )
    found = []
    for folder, content in (("a", "v 0 0 0"), ("b", "v 0 0 0"), ("c", "v 0 0 1")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "ball.obj").write_text(content)
        found.append(body_identity(load(tmp_path / folder, text).bodies[0]))
    assert found[0] == found[1] != found[2]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("loads: [+x]", "loads: [x]", "loads.0: 'x' is not known"),
        ("loads: [+x]", "loads: []", "loads: must not be empty"),
        ("loads: [+x]", "loads: [+x, +x]", "loads.1: '+x' is there twice"),
        ("load: +x", "load: +y", "picture.load: is not one of the `loads`"),
        ("time: 5}", "time: 6}", "picture.time: is not a saved time"),
        ("structure: octree", "structure: octre", "unknown kind 'octre'"),
        ("label: octree", "label: full volume", "structures.0: 'full volume' is there"),
        ("voxels_high: 12", "voxels_high: 12\nspeed: 1", "speed: unknown key"),
        ("time: 5}", "time: 5}\ncamera: {width: 9}", "camera: frames are compared"),
        ("until: 5", "until: 5 K", "sun.until: expected a time"),
        (
            "structure: octree}",
            "structure: octree, expect: {body: ball}}",
            "structures.0.expect.body: there is no 'ball'",
        ),
        (
            "picture:",
            "claims: {equilibrium: {body: spere}}\npicture:",
            "claims.equilibrium.body: there is no 'spere'; did you mean 'sphere'?",
        ),
        (
            "shape: {kind: sphere, radius: 5 cm}",
            "mesh: {path: no.obj, unit: m}",
            "JAXTHERMO_MESHES",
        ),
    ],
)
def test_a_mistake_is_told_with_its_path(tmp_path, old, new, message):
    assert old in SMALL
    with pytest.raises(InputError) as told:
        load(tmp_path, SMALL.replace(old, new))
    assert message in str(told.value) and "\n" not in str(told.value)
    assert str(told.value).startswith(str(tmp_path))


def test_a_mistake_in_the_height_names_the_flag(tmp_path):
    with pytest.raises(InputError, match="^--height: must be at least 8, got 2$"):
        load(tmp_path, SMALL, height=2)


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
@pytest.mark.parametrize("load_name", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_rays_come_from_the_side_named_in_the_files_axes(up, load_name):
    side = np.zeros(3)
    side["xyz".index(load_name[1])] = 1.0 if load_name[0] == "+" else -1.0
    axes = _axes_for_up(up)
    np.testing.assert_array_equal(rays(axes, load_name), -_axes_rotation(axes) @ side)
