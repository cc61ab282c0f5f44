"""A reader of the path from a solution to a frame opens few files."""

import sys
from pathlib import Path

import numpy as np

import jaxthermo as jt


PACKAGE = Path(jt.__file__).parent


def test_a_frame_in_a_known_view_enters_twelve_files():
    grid = jt.grid_from_voxels(np.ones((2, 2, 2), bool), pitch=0.01)
    body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=300.0)
    terms = (jt.Sun((0.0, 0.0, -1.0), 900.0), jt.Surroundings(280.0))
    solution = jt.simulate(jt.Scene((body,), terms), 0.0)
    camera = jt.Camera((0.1, 0.02, 0.04), (0.0, 0.0, 0.0), width=16, height=12)
    jt.render(solution, camera)
    files = set()

    def profile(frame, event, argument):
        path = Path(frame.f_code.co_filename)
        if event == "call" and path.is_relative_to(PACKAGE):
            files.add(str(path.relative_to(PACKAGE)))

    sys.setprofile(profile)
    try:
        jt.render(solution, camera)
    finally:
        sys.setprofile(None)
    assert "image/render.py" in files
    assert len(files) <= 12, sorted(files)
