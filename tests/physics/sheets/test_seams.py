"""Heat along seams of sheets: closed forms, energy and derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq

import jaxthermo as jt
from jaxthermo.geometry.mesh import Mesh
from tests.sheet_bodies import plate
from tests.slopes import check_gradient


METAL = jt.Material(50.0, 2000.0, specific_heat=500.0, emissivity=0.5)
LENGTH = 0.3
WIDTH = 0.1
THICKNESS = 2e-3


def half(side, temperature, cells=1, pitch=0.05, turned_over=False, material=METAL):
    """One of two plates in a line, which meet at x = 0."""
    mesh = plate(LENGTH, WIDTH)
    faces = mesh.faces[:, ::-1] if turned_over else mesh.faces
    layers = (jt.Layer(material, THICKNESS),)
    sheet = jt.Sheet(Mesh(mesh.vertices, faces), layers, pitch=pitch, cells=cells)
    pose = jt.Pose((side * LENGTH / 2, 0.0, 0.0))
    return jt.Body(sheet, temperature=temperature, pose=pose)


def line(seam, **options):
    bodies = (half(-1, 350.0, **options), half(1, 300.0, **options))
    return jt.Scene(bodies, (seam,), dtype="float64")


def means(solution):
    return np.asarray(solution.mean_temperature)[-1]


def mean_of_halves(resistance, time):
    """Mean of the hot half of a bar above 325 K, with a resistance in the middle.

    The resistance R is a length of bar. From both ends modes cos(q s) with q tan(q L)
    = 2 / R.
    """
    if not resistance:
        q = (np.arange(100) + 0.5) * np.pi / LENGTH
    else:
        q = np.array(
            [
                brentq(
                    lambda q: (
                        q * np.sin(q * LENGTH) - 2 / resistance * np.cos(q * LENGTH)
                    ),
                    n * np.pi / LENGTH,
                    (n + 0.5) * np.pi / LENGTH,
                )
                for n in range(100)
            ]
        )
    wave = q * LENGTH
    mode = 2 * np.sin(wave) ** 2 / (wave**2 + wave * np.sin(2 * wave) / 2)
    return 25.0 * (mode * np.exp(-float(METAL.diffusivity) * q**2 * time)).sum()


def test_two_plates_with_a_weld_conduct_as_one():
    """But for the resistance of an eighth of a cell."""
    time = 1000.0
    pitch = 0.05
    hot, cold = means(jt.simulate(line(jt.Seam(np.inf), pitch=pitch), time)) - 325.0
    assert hot + cold == pytest.approx(0.0, abs=1e-9)
    assert hot == pytest.approx(mean_of_halves(pitch / 8, time), rel=0.01)
    assert hot == pytest.approx(mean_of_halves(0.0, time), rel=0.035)


def mean_of_a_web(time):
    """Mean of a hot web above 300 K, on the middle of a flange of twice its length.

    From the three ends modes cos(q s): equal ones, and with cos(q L) = 0 twice as large
    in the web as in the halves of the flange, against them.
    """
    q = (np.arange(100) + 0.5) * np.pi / LENGTH
    decay = np.exp(-float(METAL.diffusivity) * q**2 * time)
    return 50.0 * (1 / 3 + (4 / 3 / (q * LENGTH) ** 2 * decay).sum())


def web_on_flange(seam, pitch):
    upright = jt.Pose.about((0.0, 1.0, 0.0), np.pi / 2)
    web = half(0, 350.0, pitch=pitch)
    layers = (jt.Layer(METAL, THICKNESS),)
    flange = jt.Sheet(plate(2 * LENGTH, WIDTH), layers, pitch=pitch, cells=1)
    bodies = (
        replace(web, pose=jt.Pose((0.0, 0.0, LENGTH / 2), upright.rotation)),
        jt.Body(flange, temperature=300.0),
    )
    return jt.Scene(bodies, (seam,), dtype="float64")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "exact"),
    [
        (lambda seam, pitch: line(seam, pitch=pitch), 325.0 + mean_of_halves(0, 500.0)),
        (web_on_flange, 300.0 + mean_of_a_web(500.0)),
    ],
    ids=["line", "web"],
)
def test_the_error_of_a_weld_is_of_first_order(scene, exact):
    solver = jt.TRBDF2(dt=10.0)
    coarse, fine = (
        means(jt.simulate(scene(jt.Seam(np.inf), pitch), 500.0, solver=solver))[0]
        - exact
        for pitch in (0.025, 0.0125)
    )
    # The hot sheet is too hot by the resistance of the seam.
    assert 0 < fine < 0.004 * 50.0
    assert np.log2(coarse / fine) == pytest.approx(0.9, abs=0.15)


@pytest.mark.parametrize(
    ("solver", "cells"),
    [
        (jt.SuperTimeStepping(dt=10.0, stages=7), 3),
        pytest.param(
            jt.SuperTimeStepping(dt=10.0, stages=7), 1, marks=pytest.mark.slow
        ),
        pytest.param(jt.TRBDF2(dt=100.0), 3, marks=pytest.mark.slow),
    ],
)
def test_a_poor_seam_equalizes_exponentially(solver, cells):
    """Plates of one temperature each; the cells through them meet by their depths."""
    conductance = 3.0
    time = 5000.0
    scene = line(jt.Seam(conductance), cells=cells)
    solution = jt.simulate(scene, time, solver=solver)
    decay = np.exp(-2 * conductance / (LENGTH * 1e6) * time)
    assert_allclose(means(solution), [325 + 25 * decay, 325 - 25 * decay], atol=0.03)
    energy = solution.energy
    through = np.asarray(energy.contacts["seam 0-1"])
    assert_array_equal(energy.bodies[1].contacts["seam 0-1"], through)
    assert through[-1] == pytest.approx(
        LENGTH * WIDTH * THICKNESS * 1e6 * (350.0 - means(solution)[0]), rel=1e-9
    )
    for body in energy.bodies:
        assert np.abs(body.residual_relative).max() < 1e-11


@pytest.mark.slow
def test_faces_of_sheets_that_are_turned_over_meet():
    """Layers meet by their places: a seam of three layers, one sheet upside down."""
    layers = (jt.Layer("copper", 1e-3), jt.Layer("brick", 1e-2))
    mesh = plate(LENGTH, WIDTH)
    flipped = Mesh(mesh.vertices, mesh.faces[:, ::-1])
    scenes = []
    for second, stack in ((mesh, layers), (flipped, layers[::-1])):
        bodies = tuple(
            jt.Body(
                jt.Sheet(surface, of_sheet, pitch=0.05, cells=4),
                temperature=temperature,
                pose=jt.Pose((side * LENGTH / 2, 0.0, 0.0)),
            )
            for surface, of_sheet, temperature, side in (
                (mesh, layers, 350.0, -1),
                (second, stack, 300.0, 1),
            )
        )
        scenes.append(jt.Scene(bodies, (jt.Seam(np.inf),), dtype="float64"))
    first, second = (
        jt.simulate(scene, 200.0, solver=jt.SuperTimeStepping(dt=5.0, stages=15))
        for scene in scenes
    )
    assert means(first)[0] < 349.5
    assert_allclose(means(first), means(second), atol=1e-9)


@pytest.mark.slow
def test_a_sheet_on_a_solid_conducts_through_its_foot():
    """The heat of the sheet goes into a large block at the rate of two resistances."""
    conductance = 3.0
    time = 5000.0
    block = jt.Body(
        jt.FullVolume(jt.voxelize(jt.shapes.box((0.2, 0.2, 0.2)), 0.05)),
        jt.Material(400.0, 4e5, specific_heat=500.0),
        temperature=300.0,
        pose=jt.Pose((0.1, 0.0, 0.0)),
    )
    scene = jt.Scene((block, half(-1, 350.0)), (jt.Seam(conductance),), dtype="float64")
    solution = jt.simulate(scene, time, solver=jt.TRBDF2(dt=100.0))
    decay = np.exp(-conductance / (LENGTH * 1e6) * time)
    assert means(solution)[1] == pytest.approx(300.0 + 50.0 * decay, abs=0.05)
    assert np.abs(solution.energy.residual_relative).max() < 1e-11


def test_derivatives_by_the_conductance_and_the_thickness():
    def cold(values):
        conductance, thickness = values
        bodies = tuple(
            jt.Body(
                jt.Sheet(
                    plate(LENGTH, WIDTH), (jt.Layer(METAL, thickness),), 0.1, cells=1
                ),
                temperature=temperature,
                pose=jt.Pose((side * LENGTH / 2, 0.0, 0.0)),
            )
            for side, temperature in ((-1, 350.0), (1, 300.0))
        )
        terms = (jt.Seam(conductance), jt.Convection(20.0, 300.0))
        scene = jt.Scene(bodies, terms, dtype="float64")
        solver = jt.SuperTimeStepping(dt=5.0, stages=5)
        return jt.simulate(scene, 100.0, solver=solver).mean_temperature[0, 1]

    check_gradient(cold, [2000.0, 2e-3], step=[1.0, 1e-6], rtol=1e-6)
