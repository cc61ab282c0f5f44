"""The van that a script in docs/examples writes: its nodes, instances and sizes."""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.__main__ import main


SCRIPT = Path(__file__).parents[3] / "docs" / "examples" / "van_mesh.py"


@pytest.fixture(scope="module")
def van(tmp_path_factory):
    """The file, and what the script prints."""
    path = tmp_path_factory.mktemp("van") / "van.glb"
    run = subprocess.run(
        [sys.executable, str(SCRIPT), "--out", str(path)],
        capture_output=True,
        text=True,
        check=True,
    )
    return path, run.stdout


def test_the_parts_are_those_of_the_script(van, capsys):
    path, printed = van
    assert printed == f"{path}: 60 nodes, 65.0 m^2 of open surfaces\n"
    with pytest.raises(SystemExit) as stopped:
        main(["parts", str(path), "--up", "y", "--json"])
    assert stopped.value.code == 0
    sizes = json.loads(capsys.readouterr().out)
    assert sizes["unit"] == "m"
    parts = {part["name"].split("/")[0]: part for part in sizes["parts"]}
    assert len(parts) == len(sizes["parts"]) == 60
    area = sum(part["area"] for part in parts.values() if not part["closed"])
    assert area == pytest.approx(65.0, abs=0.1)
    for node in ("roof", "windscreen", "lining_left", "exhaust_pipe", "bumper_rear"):
        assert not parts[node]["closed"]
    for node in ("engine_block", "tyre_rear_left", "dashboard", "axle_front"):
        assert parts[node]["closed"] and parts[node]["volume"] > 0
    assert parts["roof"]["size"] == pytest.approx([3.5, 1.96, 0.0])
    wheel = parts["tyre_front_left"]
    assert wheel["volume"] == pytest.approx(np.pi * (0.33**2 - 0.2**2) * 0.2)


def test_four_wheels_are_instances_of_one(van):
    meshes = jt.load_parts(van[0], unit="m", up="y")
    names = [name.split("/") for name in meshes]
    instances = Counter(mesh for _, mesh, _ in names)
    assert instances["tyre"] == instances["rim"] == 4
    tyres = [mesh for name, mesh in meshes.items() if name.startswith("tyre_")]
    centres = np.array([mesh.bounds.mean(axis=0) for mesh in tyres])
    expected = [[x, y, 0.33] for x in (1.7, -1.6) for y in (0.86, -0.86)]
    assert centres == pytest.approx(np.array(expected), abs=1e-6)
    for mesh in tyres:
        assert np.ptp(mesh.bounds, axis=0) == pytest.approx([0.66, 0.2, 0.66], abs=5e-3)
        # They stand on the ground.
        assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=3e-3)


def test_materials_are_those_of_the_table(van):
    meshes = jt.load_parts(van[0], unit="m", up="y")
    materials = {name.split("/")[2] for name in meshes}
    assert materials <= set(jt.materials) | {"steel"}
    assert {"car_glass", "tyre_rubber", "cast_iron"} <= materials


def test_the_whole_van_has_the_size_of_one(van):
    mesh = jt.load_mesh(van[0], unit="m", up="y")
    size = np.ptp(mesh.bounds, axis=0)
    assert size == pytest.approx([5.12, 2.4, 2.38], abs=0.01)


def test_the_fronts_of_panels_are_outside(van):
    meshes = jt.load_parts(van[0], unit="m", up="y")
    front = {
        name.split("/")[0]: mesh.area_vectors.sum(axis=0) / mesh.area
        for name, mesh in meshes.items()
    }
    assert front["roof"] == pytest.approx([0, 0, 1], abs=1e-6)
    assert front["floor"] == pytest.approx([0, 0, -1], abs=1e-6)
    assert front["door_left"] == pytest.approx([0, 1, 0], abs=1e-6)
    assert front["door_right"] == pytest.approx([0, -1, 0], abs=1e-6)
    assert front["rear_window_left"] == pytest.approx([-1, 0, 0], abs=1e-6)
    assert front["windscreen"][0] > 0.5 and front["windscreen"][2] > 0.5
