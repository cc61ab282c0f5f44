"""Air inside closed bodies, at a given temperature."""

import numpy as np
import pytest

import jaxthermo as jt
from tests.radiating import shell


STEEL = jt.Material(45.0, 7850.0, specific_heat=480.0, emissivity=0.3)
LAYERS = (jt.Layer(STEEL, 1e-3),)
CAPACITY = 1e-3 * 7850.0 * 480.0
BOX = jt.shapes.box((1.0, 0.6, 0.5))
OUTER = jt.Convection(20.0, 280.0)
INNER = jt.InteriorAir(5.0, 310.0)


def box_at(temperature, mesh=BOX, **options):
    sheet = jt.Sheet(mesh, LAYERS, 0.25)
    return jt.Body(sheet, temperature=temperature, **options)


def test_a_wall_between_two_airs_follows_the_lumped_law():
    times = (0.0, 60.0, 300.0)
    scene = jt.Scene((box_at(300.0),), (OUTER, INNER), dtype="float64")
    solution = jt.simulate(scene, times[-1], save_at=times)
    final = (20.0 * 280.0 + 5.0 * 310.0) / 25.0
    exact = final + (300.0 - final) * np.exp(-25.0 * np.array(times) / CAPACITY)
    assert solution.mean_temperature[:, 0] == pytest.approx(exact, abs=0.02)
    assert np.abs(solution.energy.residual_relative).max() < 1e-11


def test_it_acts_on_bodies_inside_and_on_no_other():
    block = jt.FullVolume(jt.voxelize(jt.shapes.box((0.2, 0.2, 0.2)), 0.1))
    bodies = (
        jt.Body(block, STEEL, temperature=300.0, pose=jt.Pose((3.0, 0.0, 0.0))),
        jt.Body(block, STEEL, temperature=300.0),
        box_at(300.0),
    )
    terms = (OUTER, jt.InteriorAir(5.0, 310.0, body=2))
    receipt = jt.compile_scene(jt.Scene(bodies, terms)).receipt
    area = {(part.mechanism, part.bodies): part.area for part in receipt.parts}
    assert area == {
        ("convection", (0,)): pytest.approx(0.24, rel=1e-6),
        ("convection", (2,)): pytest.approx(BOX.area, rel=1e-6),
        ("interior_air", (1,)): pytest.approx(0.24, rel=1e-6),
        ("interior_air", (2,)): pytest.approx(BOX.area, rel=1e-6),
    }
    omitted = {omission.what: omission.why for omission in receipt.left_out}
    assert omitted["interior_air on body 0"] == "it is not inside body 2"


def test_a_hollow_solid_has_air_in_its_cavity():
    grid = jt.voxelize(shell(0.06, 0.1, 2), 0.02)
    body = jt.Body(jt.FullVolume(grid), STEEL, temperature=300.0)
    (part,) = jt.compile_scene(jt.Scene((body,), (INNER,))).receipt.parts
    assert part.area == pytest.approx(grid.cavity_area, rel=1e-6)


OPEN_BOX = jt.Mesh(BOX.vertices, BOX.faces[:-1])
SOLID = jt.FullVolume(jt.voxelize(BOX, 0.1))


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (box_at(300.0, OPEN_BOX), "encloses no air; its mesh has a border of"),
        (box_at(300.0, inside="open"), "leave out its `inside: open`"),
        (jt.Body(SOLID, STEEL, temperature=300.0), "it has no cavity"),
    ],
)
def test_a_body_without_an_inside_is_refused(body, words):
    with pytest.raises(jt.InputError, match=words):
        jt.compile_scene(jt.Scene((body,), (INNER,)))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [((-1.0, 300.0), "heat_transfer_coefficient"), ((5.0, -300.0), "temperature")],
)
def test_its_numbers_are_checked(arguments, words):
    with pytest.raises(jt.InputError, match=words):
        jt.InteriorAir(*arguments)
