"""The shipped scenes of sheets: what they are made of."""

from pathlib import Path

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.config.loader import load_config


SCENES = Path(__file__).parents[3] / "configs" / "scenes"


def test_the_van_is_closed_and_stands_on_the_ground():
    config = load_config(SCENES / "van.yaml")
    body, bonnet = (config.bodies[n].build().structure for n in (0, 1))
    assert body.grid.cells.border == 0.0
    assert bonnet.grid.cells.border > 0.0
    glass = {
        name
        for name, stack in zip(body.grid.part_names, body.stacks, strict=True)
        if stack == (jt.Layer("car_glass", 4e-3),)
    }
    assert glass == {"glass_windscreen", "glass_rear", "glass_left", "glass_right"}
    # All fronts are outside: the mesh encloses its volume the right way round.
    mesh = config.bodies[0].build_mesh()
    outline = np.array(
        [(-2.5, 0.78), (1.75, 0.78), (1.75, 1.42), (1.0, 2.38), (-2.5, 2.38)]
    )
    x, z = outline.T
    area = 0.5 * abs((x * np.roll(z, -1) - np.roll(x, -1) * z).sum())
    assert mesh.volume == pytest.approx(1.96 * area)
    assert body.grid.cavity_volume == pytest.approx(mesh.volume)
    for n in range(3, 7):
        placed = config.bodies[n].build_mesh().placed(config.bodies[n].pose.build())
        assert placed.bounds[0, 2] == pytest.approx(0.0, abs=6e-3)


@pytest.fixture(scope="module")
def street():
    return load_config(SCENES / "street.yaml")


def test_vans_of_the_street_are_copies_of_one(street):
    by_name = {body.name: body for body in street.bodies}
    assert len(by_name) == len(street.bodies) == 20
    for part, names in (("van", "parked_{}"), ("tyres", "parked_{}_tyres")):
        for number in (1, 2, 3):
            parked = by_name[names.format(number)]
            assert parked.shape == by_name[part].shape
            assert parked.sheet == by_name[part].sheet


def test_people_of_the_street_have_the_size_of_people(street):
    """An adult of 1.72 m and 70 kg has 1.8 m^2 of skin (DuBois and DuBois 1916)."""
    people = [body for body in street.bodies if body.name.startswith("person")]
    assert len(people) == 3
    parts = people[0].shape.build_parts()
    assert sum(part.area for part in parts.values()) == pytest.approx(1.8, rel=0.1)
    mesh = people[0].shape.build()
    assert mesh.bounds[:, 2] == pytest.approx([0.01, 1.73], abs=0.01)
    # Nothing of a person is inside another part: all of it is bare or in clothes.
    corners = np.array([part.bounds for part in parts.values()])
    apart = (corners[:, None, 0] > corners[None, :, 1]).any(axis=2)
    assert (apart | apart.T | np.eye(len(parts), dtype=bool)).all()
    assert all(body.sheet.held == pytest.approx(306.15) for body in people)


@pytest.mark.parametrize("name", ["cabinet", "wall"])
def test_scenes_of_sheets_can_be_built(name):
    scene = load_config(SCENES / f"{name}.yaml").build()
    sheet = scene.bodies[0].structure
    assert isinstance(sheet, jt.Sheet)
    assert (sheet.grid.cells.border == 0.0) == (name == "cabinet")
