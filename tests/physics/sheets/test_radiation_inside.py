"""Radiation inside closed sheets, against closed forms, and apart from the outside."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN


HOT = 400.0
COLD = 300.0


def grey(emissivity):
    metal = jt.Material(45.0, 7850.0, specific_heat=480.0, emissivity=emissivity)
    return (jt.Layer(metal, 1e-3),)


def heat_rates(bodies, temperatures, surroundings=COLD):
    """Net radiation into every fragment of each body [W], at temperatures of theirs."""
    exchange = jt.RadiativeExchange(surroundings, max_patches=48, directions=128)
    scene = jt.Scene(bodies, (exchange,), dtype="float64")
    program = jt.compile_scene(scene).program
    reference = np.concatenate(
        [
            np.full(len(body.structure.grid.fragment_area), body.temperature)
            for body in bodies
        ]
    )
    theta = np.concatenate(temperatures) - reference
    ((_, term),) = program.fragment_terms.natural
    assert program.fine_enclosure is not None
    net = program.fine_enclosure.net(jnp.zeros(()), jnp.asarray(theta))
    heat = np.asarray(term.effective_area) * np.asarray(net)
    counts = [len(body_temperatures) for body_temperatures in temperatures]
    return np.split(heat, np.cumsum(counts)[:-1])


def test_a_black_box_exchanges_with_itself_inside_and_with_the_surroundings_outside():
    cube = jt.shapes.box((1.0, 1.0, 1.0))
    body = jt.Body(jt.Sheet(cube, grey(1.0), 0.2), temperature=350.0)
    grid = body.structure.grid
    is_inner = grid.fragment_cavity > 0
    is_hot = grid.fragment_normal[:, 0] * np.where(is_inner, -1, 1) > 0.9
    (heat,) = heat_rates((body,), [np.where(is_hot, HOT, COLD)])
    flux = STEFAN_BOLTZMANN * (HOT**4 - COLD**4)
    # The hot face of 1 m^2 sees nothing but cold ones, on both of its sides.
    assert heat[is_inner & is_hot].sum() == pytest.approx(-flux, rel=1e-3)
    assert heat[is_inner & ~is_hot].sum() == pytest.approx(flux, rel=1e-3)
    assert heat[~is_inner & is_hot].sum() == pytest.approx(-flux, rel=1e-9)
    assert abs(heat[is_inner].sum()) < 1e-9 * flux
    assert np.abs(heat[~is_inner & ~is_hot]).max() < 1e-9 * flux


PANELS = [
    (axis, side, jt.Pose.about(about, angle))
    for axis, about, angles in (
        (2, (1.0, 0.0, 0.0), (0.0, np.pi)),
        (1, (1.0, 0.0, 0.0), (-np.pi / 2, np.pi / 2)),
        (0, (0.0, 1.0, 0.0), (np.pi / 2, -np.pi / 2)),
    )
    for side, angle in zip((1, -1), angles, strict=True)
]
"""Axis and side of each face of a cube, and the turn from z to its outward normal."""


@pytest.mark.parametrize("lid", ["sheet", "solid"])
def test_a_cavity_between_six_bodies_is_that_of_one_box(lid):
    """Panels as bodies of their own, in no order of sides; the lid may be a slab."""
    square = jt.shapes.rectangle(1.0, 1.0)
    bodies = []
    for number, (axis, side, turn) in enumerate(PANELS):
        x, y, z = 0.5 * side * np.eye(3)[axis]
        if lid == "solid" and number == 0:
            slab = jt.voxelize(jt.shapes.box((1.0, 1.0, 0.1)), 0.1)
            grey_lid = jt.Material(45.0, 7850.0, specific_heat=480.0, emissivity=1.0)
            pose = jt.Pose((0.0, 0.0, 0.55))
            bodies.append(
                jt.Body(jt.FullVolume(slab), grey_lid, temperature=350.0, pose=pose)
            )
            continue
        # Every other one with its front inside.
        faces = square.faces[:, :: 1 if number % 2 else -1]
        sheet = jt.Sheet(jt.Mesh(square.vertices, faces), grey(1.0), 0.2)
        pose = jt.Pose((x, y, z), turn.rotation)
        bodies.append(jt.Body(sheet, temperature=350.0, pose=pose))
    hot = 5
    temperatures = [
        np.full(len(body.structure.grid.fragment_area), HOT if n == hot else COLD)
        for n, body in enumerate(bodies)
    ]
    heat = heat_rates(tuple(bodies), temperatures)
    flux = STEFAN_BOLTZMANN * (HOT**4 - COLD**4)
    # The hot panel of 1 m^2 sees cold ones on one side, and surroundings on the other.
    front = bodies[hot].structure.grid.fragment_face == 0
    for side in (front, ~front):
        assert heat[hot][side].sum() == pytest.approx(-flux, rel=2e-3)
    received = sum(heat[n].sum() for n in range(6) if n != hot)
    assert received == pytest.approx(flux, rel=2e-3)
    # View factors of a cube: 0.1998 to the opposite panel, 0.2000 to each beside it.
    of_cold = [heat[n].sum() / flux for n in range(6) if n != hot]
    assert of_cold == pytest.approx([0.2000] * 4 + [0.1998], abs=0.01)


def test_concentric_spheres_of_sheets_exchange_as_grey_ones():
    def sphere(radius, emissivity):
        mesh = jt.shapes.sphere(radius, 3)
        # Inside out: the outer sphere has its front inside.
        mesh = jt.Mesh(mesh.vertices, mesh.faces[:, ::-1])
        return jt.Body(jt.Sheet(mesh, grey(emissivity), radius / 3), temperature=350.0)

    inner = sphere(0.5, 0.6)
    outer = sphere(1.0, 0.3)
    grids = [body.structure.grid for body in (inner, outer)]
    of_inner, of_outer = heat_rates(
        (inner, outer),
        [np.full(len(grids[0].fragment_area), HOT)]
        + [np.full(len(grids[1].fragment_area), COLD)],
    )
    area = [grid.mesh.area for grid in grids]
    resistance = 1 / (0.6 * area[0]) + (1 - 0.3) / (0.3 * area[1])
    expected = STEFAN_BOLTZMANN * (HOT**4 - COLD**4) / resistance
    is_inside = grids[1].fragment_cavity > 0
    assert of_outer[is_inside].sum() == pytest.approx(expected, rel=0.01)
    assert of_inner.sum() == pytest.approx(-expected, rel=0.01)
    # Nothing passes through the wall, in which the small sphere has its own inside.
    assert of_inner.sum() + of_outer[is_inside].sum() == pytest.approx(
        0, abs=1e-9 * expected
    )
    assert np.abs(of_outer[~is_inside]).max() < 1e-9 * expected
