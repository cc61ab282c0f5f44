"""Names of bodies in the terms of a scene that is made in Python."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.scene.body_numbers import with_numbers


UP = (0.0, 0.0, 1.0)
NAMES = ("wheel_left", "wheel_right", "roof", "air")


@pytest.fixture(scope="module")
def bodies():
    grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.02)
    structures = [jt.FullVolume(grid)] * 3
    solids = [
        jt.Body(
            structure,
            jt.materials["copper"],
            temperature=300.0,
            pose=jt.Pose((0.04 * number, 0.0, 0.0)),
            name=name,
        )
        for number, (structure, name) in enumerate(
            zip(structures, NAMES[:3], strict=True)
        )
    ]
    return (*solids, jt.Body(jt.AirVolume(0.1), temperature=300.0, name="air"))


def numbered(bodies, *terms):
    return with_numbers(terms, bodies)


def flux(on):
    return jt.HeatFlux(10.0, on=on)


def test_selections_of_names_are_those_of_numbers(bodies):
    low = (-1.0, -1.0, -1.0)
    high = (1.0, 1.0, 1.0)
    mask = np.arange(24) < 4
    pairs = [
        (jt.Side(UP, body="roof"), jt.Side(UP, body=2)),
        (jt.Side(UP, body="wheel*"), jt.Side(UP, body=0) | jt.Side(UP, body=1)),
        (jt.Face("front", body="roof"), jt.Face("front", body=2)),
        (jt.Region(low, high, body="roof"), jt.Region(low, high, body=2)),
        (jt.Everything("wheel_?ight"), jt.Everything(1)),
        (jt.FragmentMask(mask, body="roof"), jt.FragmentMask(mask, body=2)),
        (~jt.Side(UP, body="roof"), ~jt.Side(UP, body=2)),
        (
            jt.Side(UP, body="wheel*") & jt.Region(low, high, body="wheel_left"),
            (jt.Side(UP, body=0) | jt.Side(UP, body=1)) & jt.Region(low, high, body=0),
        ),
    ]
    for named, by_number in pairs:
        (term,) = numbered(bodies, flux(named))
        assert term == flux(by_number)
        assert term.named_bodies == by_number.bodies


def test_other_terms_and_cylinders_take_names(bodies):
    source = jt.HeatSource(heat_rate=1.0, within=jt.Everything("roof"))
    air = jt.EnclosedAir(5.0, body="roof", air="air")
    contact = jt.Contact(100.0, bodies=("wheel*", "roof"))
    seam = jt.Seam(100.0, bodies=(("wheel_left", 2), "wheel_right"))
    cylinder = jt.Cylinder((0, 0, 0), UP, 0.1, body="roof")
    wind = jt.Wind((1.0, 0.0, 0.0), 290.0, cylinders=(cylinder,))
    room = jt.InteriorAir(1.0, 290.0, body="roof")
    terms = numbered(bodies, source, air, contact, seam, room, wind)
    expected = [(2,), (2, 3), (0, 1, 2), (0, 2, 1), (2,), ()]
    assert [term.named_bodies for term in terms] == expected
    assert terms[2].bodies == ((0, 1), 2)
    assert terms[5].cylinders[0].body == 2


def test_a_scene_is_that_of_numbers_and_keeps_terms_without_names(bodies):
    plain = jt.Convection(5.0, 290.0)
    terms = (plain, jt.Contact(100.0, bodies=("wheel_left", "wheel_right")))
    scene = jt.Scene(bodies[:3], terms)
    assert scene.terms[0] is plain
    assert scene.terms[1].named_bodies == (0, 1)
    by_number = jt.Scene(bodies[:3], (plain, jt.Contact(100.0, bodies=(0, 1))))
    assert scene.terms == by_number.terms


@pytest.mark.parametrize(
    ("make_term", "line"),
    [
        (
            lambda: flux(jt.Side(UP, body="rof")),
            r"terms\[0\]: no body has the name 'rof'; there are wheel_left, "
            "wheel_right, roof",
        ),
        (
            lambda: jt.Contact(1.0, bodies=("roof", "roof")),
            r"terms\[0\]: Contact\(bodies=\(2, 2\)\): name two bodies",
        ),
        (
            lambda: jt.InteriorAir(1.0, 290.0, body="wheel*"),
            r"terms\[0\]: 'wheel\*' is the name of 2 bodies: name one",
        ),
        (
            lambda: flux(jt.Side(UP, body="roof") & jt.Side(UP, body="wheel*")),
            r"terms\[0\]: .* on different bodies and have nothing in common",
        ),
    ],
)
def test_names_that_are_wrong_are_one_line(bodies, make_term, line):
    with pytest.raises(jt.InputError, match=line) as caught:
        jt.Scene(bodies[:3], (make_term(),))
    assert "\n" not in str(caught.value)


def test_bodies_without_names_are_told(bodies):
    body = jt.Body(bodies[0].structure, bodies[0].material, temperature=300.0)
    with pytest.raises(jt.InputError, match="no body has the name 'roof'; none has"):
        jt.Scene((body,), (flux(jt.Everything("roof")),))
