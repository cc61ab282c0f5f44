"""Scenes of `configs/scenes` that need no files run, and what they promise happens."""

import json
from pathlib import Path

import numpy as np
import pytest
from cli_runs import sets, succeed


SCENES = Path(__file__).parents[2] / "configs" / "scenes"

COARSE = ("camera={width: 32, height: 24}", "image.samples=1")


def _numbered(mechanism, count):
    return (mechanism, *(f"{mechanism}#{n}" for n in range(2, count + 1)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "changes", "mechanisms"),
    [
        ("figurine", ("bodies.0.voxels_high=40",), {"sun", "convection", "emission"}),
        ("figurine-steel", ("bodies.0.voxels_high=30",), {"sun", "convection"}),
        ("figurine-day", ("bodies.0.voxels_high=30", "outdoors.occlusion=16"),
         {"sun", "diffuse_sky", "emission", "wind"}),
        ("windy", ("bodies.0.voxels_high=40", "terms.1.occlusion=16"),
         {"wind", "emission"}),
        ("ball-on-figurine", ("bodies.0.voxels_high=50", "bodies.1.pitch=6 mm"),
         {"contact", "emission"}),
        ("part", ("bodies.0.pitch=4 mm",), {"heat_flux", "convection"}),
        ("mixed-small", ("bodies.0.voxels_high=30", "terms.3.occlusion=16"),
         {"sun", "wind", "contact", "emission"}),
        ("cabinet", (), {"heat_source", "convection", "interior_air", "emission"}),
        ("wall", ("time.end=12 h",), {"sun", "convection", "convection#2"}),
        ("van", ("bodies.0.sheet.pitch=40 cm", "bodies.7.sheet.pitch=1 m",
                 "outdoors.occlusion=16", "time={end: 9 h, save_every: 3 h}"),
         {"sun", "diffuse_sky", "emission", "convection", "heat_source",
          "interior_air", "fixed_temperature"}),
        ("street", ("bodies.0.sheet.pitch=60 cm", "bodies.12.sheet.pitch=1 m",
                    "bodies.19.sheet.pitch=2 m", "outdoors.occlusion=16",
                    "time={end: 2 h, save_every: 1 h}"),
         {"sun", "diffuse_sky", "emission", "convection", "convection#2",
          "heat_flux", "heat_source", *_numbered("interior_air", 4),
          *_numbered("fixed_temperature", 4)}),
    ],
)  # fmt: skip
def test_it_runs(out, name, changes, mechanisms):
    options = sets(*changes, *COARSE)
    scene = SCENES / f"{name}.yaml"
    succeed("simulate", scene, "--out", out, *options)
    summary = json.loads((out / "summary.json").read_text())
    assert set(summary["receipt"]["included"]) == {"conduction", *mechanisms}
    assert np.abs(summary["energy"]["residual_relative"]).max() < 1e-5
    assert [air["inside_body"] for air in summary["airs"]] == (
        [3 * n for n in range(sum("interior_air" in name for name in mechanisms))]
    )
    through = [heat for key, heat in summary["energy"].items() if "contact" in key]
    assert bool(through) == ("contact" in mechanisms)
    # From the warm ball, which is the later body, to what it stands on.
    assert all(heat[-1] < 0 for heat in through)


def test_each_scene_is_run_or_needs_a_file():
    marks = test_it_runs.pytestmark
    (cases,) = (mark.args[1] for mark in marks if mark.name == "parametrize")
    run_here = {case[0] for case in cases}
    texts = {path.stem: path.read_text() for path in SCENES.glob("*.yaml")}
    assert run_here == {name for name, text in texts.items() if "mesh:" not in text}
