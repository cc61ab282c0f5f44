"""The command line in this process: exit statuses, messages, what is left behind."""

import json
import os

import pytest

from jaxthermo.__main__ import app, main


SCENE = """
bodies:
  - {shape: {kind: sphere, radius: 1 cm}, pitch: 2 mm, material: gold, temperature: 300}
time: {end: 1, save_at: [1]}
"""


@pytest.fixture
def command(capsys):
    """A function from arguments to exit status, standard output, standard error."""

    def run(*arguments: object) -> tuple[object, str, str]:
        with pytest.raises(SystemExit) as stopped:
            main([str(argument) for argument in arguments])
        return (stopped.value.code, *capsys.readouterr())

    return run


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("simulate",), "CONFIG"),
        (("simualte",), "simulate"),
        (("simulate", "a", "b"), "Unused"),
        (("voxelize", "a.obj"), "--pitch"),
        (("materials", "--bogus"), "--bogus"),
        (("voxelize", "a.obj", "--pitch", "2 s"), "--pitch: expected a length"),
        (("voxelize", "a.obj", "--pitch=-2 mm"), "--pitch: must be more than 0"),
        (("voxelize", "a.obj", "--pitch", "2mm", "--unit", "mm"), "a.obj"),
        (("voxelize", "a.obj", "--pitch", "2mm"), "give either --unit, such as mm, or"),
        (
            ("voxelize", "a.obj", "--pitch", "2mm", "--surface-cells", "all"),
            "--surface-cells all: choose crossings or dominant_axis",
        ),
        (("materials", "coper"), "copper"),
        (("materials", "zz", "--emissivity"), "no surface has 'zz' in its name"),
        (("simulate", "nowhere.yaml"), "nowhere.yaml: cannot be read"),
        (("render", "nowhere"), "config.yaml"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(command, arguments, message):
    status, out, err = command(*arguments)
    assert status == 2
    assert out == ""
    assert err.startswith("jaxthermo: ") and err.count("\n") == 1
    assert message in err


def test_each_mistake_in_a_config_is_a_line(command, tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE.replace("gold", "glod").replace("2 mm", "2 s"))
    status, _, err = command(
        "simulate", scene, "--set", "dtype=x", "--set", "time.end=2"
    )
    assert status == 2
    assert [line.split(": ")[0] for line in err.splitlines()] == ["jaxthermo"] * 3
    assert "--set dtype=x" in err


def test_the_out_folder_is_refused_before_any_work(command, tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)
    status, _, err = command("simulate", scene, "--out", scene)
    assert (status, "is a file" in err) == (2, True)
    status, _, err = command("simulate", scene, "--out", scene / "below")
    assert (status, "cannot be created" in err) == (2, True)


def test_a_folder_that_cannot_be_written(command, tmp_path, monkeypatch):
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    status, _, err = command("simulate", scene, "--out", tmp_path / "out")
    assert (status, "cannot be written" in err) == (2, True)


def test_render_changes_only_what_is_drawn(command, tmp_path):
    (tmp_path / "config.yaml").write_text(SCENE)
    (tmp_path / "solution.npz").touch()
    status, _, err = command("render", tmp_path, "--set", "time.end=3")
    assert (status, "only camera and image" in err) == (2, True)


def test_voxelize_leaves_its_facts(command, tmp_path, out, monkeypatch):
    monkeypatch.setattr("jaxthermo.report.voxel_sheet._EDGE", 80)
    mesh = tmp_path / "tetrahedron.obj"
    corners = "v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\n"
    mesh.write_text(corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")

    def voxelize(*options):
        return command("voxelize", mesh, "--pitch", "0.5mm", "--unit", "mm", *options)

    status, text, _ = voxelize(
        "--out", tmp_path / "cut", "--surface-cells", "crossings"
    )
    assert status == 0 and "of its volume" in text
    facts = json.loads((tmp_path / "cut/voxels.json").read_text())
    volume = facts["represented"]["volume_m3"]
    assert volume["true"] == pytest.approx(9e-3**3 / 6)
    assert volume["represented"] == pytest.approx(volume["true"], rel=0.02)
    assert facts["surface_cells"] == "crossings"
    status, text, _ = voxelize("--out", out)
    assert status == 0
    facts = json.loads((out / "voxels.json").read_text())
    assert facts["pitch_m"] == pytest.approx(5e-4)
    assert facts["lattice_shape"] == [18, 18, 18]
    assert facts["solid_voxels"] * 5e-4**3 == pytest.approx(9e-3**3 / 6, rel=0.05)
    assert f"{facts['solid_voxels']:,} solid voxels" in text
    assert facts["ratios_applied"] is True
    assert (out / "voxels.png").stat().st_size > 0
    contents = ("depth", "normal", "dominant", "packed")
    for sheet in (
        f"layers_{axis}_{content}.png" for axis in "xyz" for content in contents
    ):
        assert (out / sheet).stat().st_size > 0


def test_materials(command):
    assert "stainless_steel" in command("materials")[1]
    assert "401" in command("materials", "copper")[1]


def test_an_interrupt_is_one_line_and_status_130(command, monkeypatch):
    def interrupted(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(type(app), "__call__", interrupted)
    assert command("materials") == (130, "", "jaxthermo: interrupted\n")
