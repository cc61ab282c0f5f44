"""Surfaces read what is prescribed, and stay between what surrounds them."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.scene.named import Probe
from jaxthermo.voxels.selection import Region, Side
from jaxthermo.voxels.voxelize import voxelize
from tests.shallow import SHALLOW


CONDUCTIVITY = 2.0
CERAMIC = jt.Material(CONDUCTIVITY, density=2000.0, specific_heat=900.0, emissivity=0.9)
AIR = 293.15
WARM = 333.15
EDGE = 0.04
FACE = Side((1.0, 0.0, 0.0))

STRUCTURES = {
    "full": jt.FullVolume,
    "links": lambda grid: jt.FullVolume(grid, stencil=False),
    "shell": jt.SingleShell,
    "core": jt.ShellOverCore,
    "multi": lambda grid: jt.MultiLevel(grid, levels=2),
    "irregular": jt.IrregularMultiLevel,
    "octree": jt.Octree,
    "aggregate": lambda grid: jt.Aggregate(grid, factor=3),
}
MAPS = {
    "constant": jt.ConstantMap(),
    "linear": jt.LinearMap(),
    "flux": jt.FluxCorrectedMap(),
}


def _cube(cells: int):
    return voxelize(jt.shapes.box((EDGE, EDGE, EDGE)), EDGE / cells)


@pytest.fixture(scope="module")
def grid():
    return _cube(8)


def _simulated(structure, *terms, times, start=WARM, **options):
    options = {"surface_map": jt.FluxCorrectedMap(), **options}
    probes = options.pop("probes", ())
    body = jt.Body(structure, CERAMIC, temperature=start, **options)
    return jt.simulate(jt.Scene((body,), terms, probes=probes), times[-1], times)


QUICK = (
    ("full", "constant"),
    ("irregular", "linear"),
    ("aggregate", "constant"),
    ("aggregate", "flux"),
)


@SHALLOW
@pytest.mark.parametrize(
    ("kind", "surface_map"),
    [
        pytest.param(*case, marks=() if case in QUICK else pytest.mark.slow)
        for case in itertools.product(STRUCTURES, MAPS)
    ],
)
def test_a_held_surface_reads_what_is_prescribed(grid, kind, surface_map):
    # In a corner of the face and in its middle, off the centres of fragments.
    probes = tuple(
        Probe(name, (EDGE / 2, y, z))
        for name, y, z in (("middle", 0.0013, -0.0007), ("corner", 0.0199, -0.0198))
    )
    held = jt.FixedTemperature(jt.Table([0.0, 100.0], [400.0, 450.0]), on=FACE)
    solution = _simulated(
        STRUCTURES[kind](grid),
        held,
        jt.Convection(50.0, AIR),
        times=[1.0, 40.0],
        surface_map=MAPS[surface_map],
        probes=probes,
    )
    on_face = grid.fragment_normal[:, 0] > 0.9
    for time, surface, at_probes in zip(
        solution.times[-2:],
        np.asarray(solution.surface_temperature)[-2:],
        np.asarray(solution.probe_temperature)[-2:],
        strict=True,
    ):
        prescribed = 400.0 + float(time) / 2
        np.testing.assert_allclose(surface[on_face], prescribed, atol=1e-3)
        np.testing.assert_allclose(at_probes, prescribed, atol=1e-3)


@SHALLOW
@pytest.mark.parametrize(
    ("factor", "surface_map"),
    [
        (2, jt.FluxCorrectedMap()),
        (3, jt.LinearMap()),
        pytest.param(2, jt.LinearMap(), marks=pytest.mark.slow),
        pytest.param(3, jt.FluxCorrectedMap(), marks=pytest.mark.slow),
        pytest.param(4, jt.LinearMap(), marks=pytest.mark.slow),
        pytest.param(4, jt.FluxCorrectedMap(), marks=pytest.mark.slow),
    ],
)
def test_cooling_stays_between_the_air_and_the_start(factor, surface_map):
    """Bi 50: the surface is at the temperature of the air almost at once."""
    structure = jt.Aggregate(_cube(12), factor=factor)
    h = 50 * CONDUCTIVITY / (EDGE / 2)
    surface = _simulated(
        structure,
        jt.Convection(h, AIR),
        times=[1.0, 5.0, 20.0, 60.0, 200.0],
        surface_map=surface_map,
    ).surface_temperature
    rounding = 1e-4
    assert float(surface.min()) >= AIR - rounding
    assert float(surface.max()) <= WARM + rounding
    assert float(surface.min()) < AIR + 1.0


@pytest.mark.parametrize("surface_map", [jt.LinearMap(), jt.FluxCorrectedMap()])
def test_a_hot_cap_makes_nothing_hotter_or_colder(surface_map):
    cap = Region((-1.0, -1.0, EDGE / 4), (1.0, 1.0, 1.0))
    hot = jt.FixedTemperature(1273.0, on=cap)
    surface = _simulated(
        jt.Aggregate(_cube(12), factor=3),
        hot,
        jt.Surroundings(293.0),
        times=[1.0, 5.0, 20.0, 100.0],
        start=293.0,
        surface_map=surface_map,
    ).surface_temperature
    assert float(surface.min()) >= 293.0 - 1e-3
    assert float(surface.max()) <= 1273.0 + 1e-3


@SHALLOW
@pytest.mark.parametrize("h", [pytest.param(20.0, marks=pytest.mark.slow), 5000.0])
def test_what_is_limited_has_a_derivative(h):
    """Limited or not, the derivative with the air's temperature is the difference."""
    structure = jt.Aggregate(_cube(8), factor=4)

    def surface(air):
        body = jt.Body(structure, CERAMIC, temperature=WARM)
        scene = jt.Scene((body,), (jt.Convection(h, air),), dtype="float64")
        run = jt.simulate(scene, 5.0, solver=jt.ForwardEuler(dt=1.0))
        return run.surface_temperature[-1]

    with jax.enable_x64(True):
        air = jnp.asarray(AIR)
        _, slope = jax.jvp(surface, (air,), (jnp.ones_like(air),))
        difference = surface(air + 0.5) - surface(air - 0.5)
        np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-9)
        pulled = jax.grad(lambda t: surface(t).sum())(air)
        np.testing.assert_allclose(pulled, slope.sum(), rtol=1e-9)
