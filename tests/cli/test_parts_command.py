"""`jaxthermo parts`: names and sizes of the parts of a mesh file, as table and JSON."""

import json

import pytest

from jaxthermo.__main__ import main
from jaxthermo.cli.scene_start import scene_start
from jaxthermo.config.strict_yaml import parse_yaml
from jaxthermo.geometry.shapes import box
from tests.mesh_files import GIVEN, box_gltf


@pytest.fixture
def printed(capsys):
    """A function from arguments to what they print, with the exit status."""

    def run(*arguments: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as stopped:
            main(["parts", *map(str, arguments)])
        out, err = capsys.readouterr()
        return int(str(stopped.value.code)), out, err

    return run


def test_table(printed):
    status, out, _ = printed(GIVEN / "instanced.glb")
    assert status == 0
    lines = [line.split() for line in out.splitlines() if "node0" in line]
    assert [words[0] for words in lines] == [
        "node0/mesh0/-",
        "node0/mesh0/-#2",
        "node0/mesh0/-#3",
    ]
    assert all(
        words[1:] == ["3", "12", "22", "6", "1", "x", "2", "x", "3", "closed"]
        for words in lines
    )
    assert "3 parts, 36 faces, 11 x 2 x 3 m, in the unit that the file states" in out
    assert "y up: give --up y" in out
    _, turned, _ = printed(GIVEN / "instanced.glb", "--up", "y")
    assert "11 x 3 x 2 m" in turned
    assert "--up y" not in turned


def test_json_in_metres(printed):
    status, out, _ = printed(GIVEN / "u_profile.obj", "--unit", "cm", "--json")
    assert status == 0
    sizes = json.loads(out)
    (part,) = sizes["parts"]
    assert sizes["unit"] == "m"
    assert part["name"] == "-/-/-"
    assert part["area"] == pytest.approx(30e-4)
    assert part["volume"] == pytest.approx(7e-6)
    assert part["size"] == pytest.approx([0.03, 0.03, 0.01])
    assert part["closed"] is True


def test_units_of_the_file_and_open_parts(printed, tmp_path):
    path = tmp_path / "roof.obj"
    path.write_text("v 0 0 0\nv 4 0 0\nv 4 3 0\no roof\nusemtl tin\nf 1 2 3\n")
    status, out, _ = printed(path)
    assert status == 0
    assert "roof/-/tin" in out
    assert "open (3 open edges)" in out
    assert "1 part, 1 faces" not in out
    assert "1 part, 1 face, 4 x 3 x 0 file units: --unit says how long" in out


def test_height_and_axis(printed, tmp_path):
    path = tmp_path / "box.glb"
    path.write_bytes(box_gltf(name="block").glb())
    status, out, _ = printed(path, "--height", "20 cm", "--up", "y")
    assert status == 0
    assert "block/mesh0/-" in out
    assert "0.1 x 0.3 x 0.2 m" in out


def test_a_part_of_no_extent_has_a_line_and_is_left_out(printed, tmp_path):
    path = tmp_path / "parts.glb"
    writer = box_gltf(name="block")
    writer.node(mesh=0, name="point", scale=[0.0] * 3, translation=[0.0, 0.0, 1.0])
    path.write_bytes(writer.glb())
    status, out, _ = printed(path)
    assert status == 0
    assert "0 x 0 x 0" in next(line for line in out.splitlines() if "point" in line)
    assert "2 parts, 24 faces, 1 x 2 x 3 m" in out
    rule = "{match: [point], ignore: true}"
    (told,) = [line for line in out.splitlines() if "leave it out" in line]
    assert told.startswith("1 part has no extent")
    assert told.endswith(rule)
    status, out, _ = printed(path, "--scene")
    assert status == 0
    assert "{match: [point], ignore: true}  # no extent" in out


def test_parts_without_a_material_are_told(printed):
    _, out, _ = printed(GIVEN / "instanced.glb", "--scene")
    assert "{match: '-', material: carbon_steel" in out
    assert "# material: the file has none" in out


def test_small_parts_do_not_give_large_ones_their_voxels():
    sizes = {"beam": (2.0, 0.2, 0.2), "rail": (1.5, 0.2, 0.1)}
    sizes |= dict.fromkeys(("screw", "nut", "washer"), (0.006, 0.006, 0.02))
    meshes = {
        f"{node}/{node}/steel": box(size).moved((3.0 * number, 0.0, 0.0))
        for number, (node, size) in enumerate(sizes.items())
    }
    start = parse_yaml(scene_start({"path": "beam.glb"}, meshes), "start")
    rules = {str(rule["match"]): rule["pitch"] for rule in start["assembly"]["parts"]}
    assert rules == {"['beam', 'rail']": 0.025, "steel": 0.0015}


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--unit", "furlong"), "unit 'furlong' is not known"),
        (("--height", "3 K"), "--height"),
        (("--height", "0 m"), "give a positive number"),
        (("--unit", "m", "--height", "1 m"), "not both"),
        (("--up", "w"), "up='w'"),
    ],
)
def test_mistakes_are_one_line(printed, arguments, reason):
    status, out, err = printed(GIVEN / "u_profile.off", *arguments)
    assert status == 2
    assert out == ""
    assert reason in err
    assert len(err.splitlines()) == 1


def test_a_file_that_cannot_be_read(printed):
    status, _, err = printed(GIVEN / "draco.glb")
    assert status == 2
    assert "compressed with Draco" in err
