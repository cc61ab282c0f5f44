"""The verdict says in plain types whether a mesh is closed, how large, how mended."""

import json
from dataclasses import replace

import numpy as np
import pytest

from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh, describe_mesh, mesh_summary
from jaxthermo.geometry.repair import repair_mesh


def test_closed_body():
    facts = json.loads(json.dumps(describe_mesh(shapes.box((1.0, 2.0, 3.0)))))
    assert facts["watertight"] is True
    assert facts["open_edges"] == 0
    assert facts["volume"] == pytest.approx(6.0)
    assert facts["area"] == pytest.approx(22.0)
    assert facts["size"] == [1.0, 2.0, 3.0]
    assert (facts["bodies"], facts["cavities"]) == (1, 0)
    assert facts["repairs"] == {}


def test_open_body_has_no_volume_and_says_so():
    mesh = shapes.box(1.0)
    cup = repair_mesh(
        replace(mesh, faces=mesh.faces[mesh.triangles[:, :, 2].min(1) < 0.4])
    )
    assert describe_mesh(cup)["volume"] is None
    assert "open (4 open edges), no volume" in mesh_summary(cup)


def test_line_names_cavity_and_repairs():
    ball = shapes.sphere(1.0, 2)
    hole = shapes.sphere(0.5, 2)
    hollow = Mesh(
        np.concatenate([ball.vertices, hole.vertices]),
        np.concatenate([ball.faces, hole.faces[:, ::-1] + len(ball.vertices)]),
        "shell",
    )
    line = mesh_summary(
        repair_mesh(
            replace(hollow, faces=np.concatenate([hollow.faces[:2], hollow.faces]))
        )
    )
    assert line.startswith("shell: 640 faces, watertight, volume 3.665 m^3")
    assert "1 body with 1 cavity" in line
    assert line.endswith("repaired: 2 duplicate faces")
    assert "\n" not in line
