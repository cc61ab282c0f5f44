"""The pieces of the exhibits of C16 and C25, on small cases."""

from dataclasses import replace

import numpy as np
import pytest

import jaxthermo as jt
from calibrate.problem.parameters import Parameter, ParameterSet
from calibrate.study.front import Point
from experiments.harness.present import from_to
from experiments.thesis.exhibits import image as parts_of_image, parameters, weights
from tests import calibrating
from tests.imaging import at_start, block, metal


def test_parts_of_a_frame_add_up_to_the_whole():
    body = block((0.04, 0.04, 0.04), 330.0, metal(parts_of_image.PAINT, 0.6))
    bare = jt.Coating(parts_of_image.SHINY, on=jt.Side((1.0, 0.0, 0.0)))
    surroundings = jt.Surroundings(268.0, ground=303.0)
    sun = jt.Sun((-1.0, 0.5, -1.0), 800.0)
    solution = at_start((replace(body, coatings=(bare,)),), surroundings, sun)
    camera = jt.Camera((0.14, -0.1, 0.08), (0.0, 0.0, 0.0), width=40, height=30)
    frame = parts_of_image.separate(solution, camera)
    errors = {name: parts.sum_error for name, parts in frame.bands.items()}
    assert errors["all wavelengths"] < 1e-14 and max(errors.values()) < 1e-7
    assert frame.shiny.sum() > 30 and frame.paint.sum() > 30
    read = parts_of_image.readings(frame)
    assert read.spot == pytest.approx(330.0, abs=0.01) and read.spot_per_kelvin < -5
    shown = {name: k[frame.shiny].mean() for name, k in read.frames.items()}
    assert shown[parts_of_image.ITSELF] == pytest.approx(330.0)
    assert shown[parts_of_image.AT_ONE] < 300.0
    # In the long wave bare metal shows what is around it, and hardly the sun.
    patch = parts_of_image.mean_radiances(frame)[1]
    assert patch["surface"] == "patch" and patch["band"] == parts_of_image.LONG
    assert patch[parts_of_image.OF_SUN] < 0.02 * patch[parts_of_image.OF_AROUND]


def test_one_factor_scales_the_conductances_alone():
    capacity = Parameter("weights.nearest_capacity", (0.4,), -3.0, 3.0)
    free = ParameterSet((calibrating.WITHIN, calibrating.BETWEEN, capacity))
    found = free.values(weights.scaled(free, 0.5))
    assert {name: float(v) for name, v in found.items()} == pytest.approx(
        {
            "weights.within": 0.5,
            "weights.between": 0.5,
            "weights.nearest_capacity": 0.4,
        }
    )


@pytest.mark.slow
def test_errors_of_known_weights_are_none():
    problem = calibrating.twin()
    true = problem.parameters.coordinates(dict(calibrating.TRUTH))
    points = [np.zeros(2), np.asarray(true, float)]
    first, last = problem.errors_at(points)
    assert first.keys() == last.keys() == {case.name for case in problem.cases}
    assert max(error.worst for error in last.values()) < 1e-9
    assert max(error.worst for error in first.values()) > 0.1


def point(name, error):
    choice = {"structure": name, "voxels_high": "48", "solver": "explicit"}
    return Point(name, choice, {"rms_percent": error}, 0.0, 10, 10, 10, None)


def test_the_least_work_within_a_tolerance_counts_the_error_of_the_reference():
    points = [point("blocks x3", 2.5), point("single shell", 2.0), point("octree", 1.0)]
    work = {choice.name: 10 * (n + 1) for n, choice in enumerate(points)}
    swept = parameters.Swept(points, cases={}, work=work, reference_error=0.0)

    def cheapest(swept, tolerance, structures=None):
        return getattr(swept.cheapest(tolerance, structures), "name", None)

    assert cheapest(swept, 3.0) == "blocks x3" and cheapest(swept, 0.5) is None
    # 2.5 % and 2 % together are more than 3 %.
    assert cheapest(swept._replace(reference_error=2.0), 3.0) == "single shell"
    assert cheapest(swept, 3.0, parameters._THESIS) == "single shell"


def test_ends_that_read_alike_are_said_once():
    assert from_to([0.121, 0.123], ".0%") == "12%"
    assert from_to([2.0, 0.5, 1.0], ".2g") == "0.5 to 2"
