"""The report of a structure: plain types that add up."""

import json

import numpy as np
import pytest

from jaxthermo.geometry.shapes import rectangle
from jaxthermo.material.layer import Layer
from jaxthermo.structures.kinds.aggregate import Aggregate
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.structures.kinds.sheet import Sheet
from jaxthermo.structures.kinds.shell import IrregularMultiLevel, SingleShell
from jaxthermo.structures.kinds.skin import Skin
from jaxthermo.structures.report import structure_report
from tests.bodies import blocks


@pytest.fixture(scope="module")
def grid():
    position = np.indices((14, 13, 16)) - 6.4
    return blocks((position**2).sum(0) < 40, 0.5)


@pytest.fixture(params=["full", "links", "shell", "irregular", "skin"])
def structure(request, grid):
    return {
        "full": FullVolume(grid),
        "links": FullVolume(grid, stencil=False),
        "shell": SingleShell(grid, "own"),
        "irregular": IrregularMultiLevel(grid, levels=2),
        "skin": Skin(Aggregate(grid, 2), cells=3),
    }[request.param]


def test_levels_add_up_and_all_is_json(structure):
    report = structure_report(structure)
    assert json.loads(json.dumps(report)) == report
    assert report["kind"] == type(structure).__name__
    levels = report["levels"]
    assert sum(level["nodes"] for level in levels) == report["nodes"]
    volume = sum(level["volume_m3"] for level in levels)
    assert "solid_voxels" in report
    body = report["solid_voxels"] * 0.5**3
    assert volume == pytest.approx(report["capacity_ratio"] * body)
    sizes = report["bytes_float32"]
    arrays = sizes["state"], sizes["capacity"], sizes["links"], sizes["fragments"]
    assert sizes["total"] == sum(arrays) > 0


def test_a_sheet_has_cells_of_its_surface(grid):
    layers = (Layer("steel", 0.8e-3), Layer("mineral_wool", 0.04))
    sheet = Sheet(rectangle(1.0, 0.5), layers, pitch=0.1, cells=4)
    report = structure_report(sheet)
    assert json.loads(json.dumps(report)) == report
    assert "solid_voxels" not in report
    assert "surface_cells" in report
    assert report["surface_cells"] == sheet.surface_cells
    assert report["nodes"] == 4 * sheet.surface_cells
    assert report["options"] == {"cells": 4, "thickness_m": [[0.8e-3, 0.04]]}
    volumes = [level["volume_m3"] for level in report["levels"]]
    assert len(volumes) == 4
    assert sum(volumes) == pytest.approx(0.5 * 0.0408)


def test_options_and_time_are_told(grid):
    report = structure_report(SingleShell(grid, "own"), build_time=0.25)
    assert report["options"] == {"capacity": "own"}
    assert report["build_time_s"] == 0.25
    report = structure_report(IrregularMultiLevel(grid))
    assert report["options"] == {"levels": None, "keep_capacity": False}
    assert report["build_time_s"] is None


def test_bytes_are_those_of_the_arrays(grid):
    shell = SingleShell(grid)
    nodes = shell.nodes()
    links = shell.links()
    held = [nodes.volume, nodes.volume, links.src, links.dst, links.area]
    held += [shell.fragment_node(), grid.fragment_area]
    expected = sum(array.astype(np.float32).nbytes for array in held)
    assert structure_report(shell)["bytes_float32"]["total"] == expected
    # A stencil: a float and a byte for each of (14 + 2)(13 + 2)(16 + 2) cells.
    sizes = structure_report(FullVolume(grid))["bytes_float32"]
    assert sizes["state"] + sizes["capacity"] + sizes["links"] == 5 * 16 * 15 * 18


def test_an_irregular_structure_tells_how_it_covers_the_body(grid):
    report = structure_report(IrregularMultiLevel(grid))
    shares = report.get("share_of_body_volume")
    assert shares is not None
    total = 1 + shares["overlap"] - shares["crack"] + shares["outside"]
    assert report["capacity_ratio"] == pytest.approx(total)
    assert "share_of_body_volume" not in structure_report(SingleShell(grid))
