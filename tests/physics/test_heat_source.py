"""Heat released inside: as much as asked for, and where, in any structure."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.physics.heat_source import HeatSource, VolumeBinding
from jaxthermo.physics.surface import Omitted
from jaxthermo.voxels.fragment_mask import FragmentMask
from jaxthermo.voxels.selection import Everything, Region, Side
from tests.bodies import bar, blocks, body_at, depth, on_top, single_body_scene


PITCH = 0.01


@pytest.fixture(scope="module")
def grid():
    solid = np.ones((12, 10, 11), bool)
    solid[8:, 6:, :3] = False
    return blocks(solid, PITCH)


STRUCTURES = {
    "full": jt.FullVolume,
    "shell": jt.SingleShell,
    "hollow": lambda grid: jt.SingleShell(grid, capacity="own"),
    "multi": lambda grid: jt.MultiLevel(grid, levels=2),
    "irregular": jt.IrregularMultiLevel,
    "octree": jt.Octree,
    "aggregate": lambda grid: jt.Aggregate(grid, factor=3),
    "core": jt.ShellOverCore,
}


def _box(lower, upper):
    return Region(lower=(lower,) * 3, upper=upper)


WITHIN = {
    "all": None,
    "everything": Everything(),
    "corner": _box(-1.0, (0.035, 0.045, 0.055)),
    "core": _box(0.04, (0.07, 0.06, 0.06)),
}


def _bound(source, structure):
    binding = source.bind(structure, 0)
    assert isinstance(binding, VolumeBinding)
    return binding


class Intersected(NamedTuple):
    """Common part of the whole voxels of a grid and a box, None for all of space."""

    volume: float
    middle: np.ndarray


def _intersected(grid, within):
    centre = grid.lattice.centres(np.argwhere(grid.solid))
    low = centre - PITCH / 2
    high = centre + PITCH / 2
    if isinstance(within, Region):
        low = np.maximum(low, within.lower)
        high = np.minimum(high, within.upper)
    volume = np.prod(np.maximum(high - low, 0), axis=1)
    total = volume.sum()
    return Intersected(volume=total, middle=volume @ (low + high) / 2 / total)


@pytest.mark.parametrize("within", WITHIN.values(), ids=WITHIN)
@pytest.mark.parametrize("structure_name", STRUCTURES)
def test_the_heat_in_all_is_the_same_in_every_structure(grid, structure_name, within):
    structure = STRUCTURES[structure_name](grid)
    binding = _bound(HeatSource(1e5, within), structure)
    assert binding.volume.shape == (structure.node_count,)
    assert binding.volume.min() >= 0.0
    total = _intersected(grid, within).volume
    assert binding.volume.sum() == pytest.approx(total, rel=1e-12)
    assert binding.heat_rate_density == 1e5


@pytest.mark.parametrize("structure_name", ["full", "octree", "aggregate", "core"])
def test_and_so_is_where_it_is(grid, structure_name):
    """The middle of the heat is that of the region, as far as nodes resolve it."""
    structure = STRUCTURES[structure_name](grid)
    within = WITHIN["corner"]
    share = _bound(HeatSource(1.0, within), structure).volume
    middle = share @ structure.nodes().centre / share.sum()
    away = np.abs(middle - _intersected(grid, within).middle).max()
    assert away < (0.5 if structure_name == "full" else 1.0) * PITCH
    untouched = (structure.nodes().centre > 0.035 + 3 * PITCH).any(axis=1)
    assert share[untouched].sum() == 0.0


def test_everything_is_the_volume_of_the_nodes(grid):
    for structure_name in ("full", "octree", "aggregate", "core"):
        structure = STRUCTURES[structure_name](grid)
        share = _bound(HeatSource(1.0), structure).volume
        assert_allclose(share, structure.nodes().volume, rtol=1e-12)


def test_what_does_nothing_is_left_out(grid):
    structure = jt.FullVolume(grid)
    elsewhere = HeatSource(1.0, Everything(body=1)).bind(structure, 0)
    assert elsewhere == Omitted("`within` is on another body")
    none = HeatSource(0.0).bind(structure, 0)
    assert none == Omitted("the heat rate density is 0")
    zero = jt.Table([0.0, 1.0], [0.0, 0.0])
    assert isinstance(HeatSource(zero).bind(structure, 0), Omitted)


def test_an_insulated_body_warms_at_q_over_rho_c(grid):
    """In every structure, to rounding: dT/dt = q''' / (rho c)."""
    density = 1e6
    material = jt.Material(16.0, density=8e3, specific_heat=500.0)
    kelvin = 300.0
    for structure_name in ("full", "octree"):
        scene = single_body_scene(
            STRUCTURES[structure_name](grid), material, kelvin, HeatSource(density)
        )
        solution = jt.simulate(scene, 20.0, [10.0, 20.0], solver=jt.ForwardEuler())
        exact = kelvin + density / (8e3 * 500.0) * np.array([10.0, 20.0])
        assert_allclose(solution.mean_temperature[:, 0], exact, rtol=1e-13)
        assert float(np.ptp(solution.surface_temperature[-1])) < 1e-10
        total = density * grid.solid_count * grid.voxel_volume * 20.0
        assert float(solution.energy.mechanisms["heat_source"][-1]) == pytest.approx(
            total
        )
        assert float(np.abs(solution.energy.residual_relative).max()) < 1e-12


def test_a_slab_with_cold_faces_has_a_parabola():
    """Steady: T = T_0 + q (L x - x^2) / 2 k, and q h^2 / 8 k more on cells of h."""
    cells = 10
    pitch = 0.01
    k = 50.0
    q = 2e6
    cold = 300.0
    line = bar(cells, pitch)
    ends = [
        jt.FixedTemperature(cold, on=jt.Side(normal=(sign, 0.0, 0.0)))
        for sign in (-1.0, 1.0)
    ]
    scene = single_body_scene(
        line, jt.Material(k, 1e3, 1e2), cold, HeatSource(q), *ends
    )
    solution = jt.simulate(scene, 60.0, solver=jt.ForwardEuler())
    x = depth(line)
    length = cells * pitch
    exact = cold + q / (2 * k) * (length * x - x**2) + q * pitch**2 / (8 * k)
    assert_allclose(solution.surface_temperature[-1][on_top(line)], exact, rtol=1e-9)


def test_functions_of_time_are_kept(grid):
    ramp = jt.Table([0.0, 10.0], [0.0, 1e6])
    source = HeatSource(ramp)
    assert source.values == (ramp,)
    assert _bound(source, jt.FullVolume(grid)).heat_rate_density is ramp
    assert source.name == "heat_source"


def test_mistakes_are_one_line(grid):
    aside = _box(1.0, (2.0, 2.0, 2.0))
    surfaces: tuple[Any, ...] = (
        Side(normal=(1.0, 0.0, 0.0)),
        FragmentMask(np.ones(3, bool)),
        "all",
    )
    with pytest.raises(
        InputError, match="no part of body 0 is in it; corners are metres"
    ):
        HeatSource(1.0, aside).bind(jt.FullVolume(grid), 0)
    for within in surfaces:
        with pytest.raises(InputError, match="it heats the inside: give a Region"):
            HeatSource(1.0, within)
    with pytest.raises(InputError, match="give a finite number"):
        HeatSource(np.nan)


@pytest.mark.parametrize("make", [jt.HeatSource, jt.HeatFlux])
def test_a_heat_rate_is_that_of_all_bodies_and_has_a_slope(make):
    """60 W of two bodies: each has its part of the volume or the surface."""
    small = jt.voxelize(jt.shapes.box(0.02), 0.01)
    large = jt.voxelize(jt.shapes.box(0.04), 0.013)
    material = jt.Material(400.0, 8e3, 400.0)

    def stored(rate):
        bodies = tuple(
            body_at(grid, material, 300.0, at=(x, 0.0, 0.0))
            for grid, x in ((small, 0.0), (large, 1.0))
        )
        scene = jt.Scene(bodies, (make(heat_rate=rate),), dtype="float64")
        energy = jt.simulate(scene, 8.0, solver=jt.BackwardEuler(4.0)).energy
        return jnp.stack([body.stored_J[-1] for body in energy.bodies])

    with jax.enable_x64(True):
        heat, slope = jax.jvp(stored, (60.0,), (1.0,))
    share = 8 / 64 if make is jt.HeatSource else 4 / 16
    fractions = np.array([share, 1.0]) / (1 + share)
    assert_allclose(heat, 480.0 * fractions, rtol=1e-9)
    assert_allclose(slope, 8.0 * fractions, rtol=1e-9)


def test_a_heat_rate_varies_with_time_as_a_flux_does(grid):
    ramp = jt.Table([0.0, 10.0], [0.0, 60.0])
    material = jt.Material(16.0, density=8e3, specific_heat=500.0)
    top = jt.Side((0.0, 0.0, 1.0)) & jt.Region((0.017, 0.0, 0.0), (1.0, 1.0, 1.0))
    flux = jt.HeatFlux(heat_rate=ramp, on=top)
    scene = single_body_scene(jt.Octree(grid), material, 300.0, flux)
    solution = jt.simulate(scene, 10.0, [5.0, 10.0])
    assert_allclose(solution.energy.stored_J, [75.0, 300.0], rtol=1e-5)
    (part,) = solution.receipt.parts
    assert part.area == pytest.approx(0.103 * 0.1, rel=0.01)


@pytest.mark.parametrize("make", [jt.HeatSource, jt.HeatFlux])
def test_a_heat_rate_stands_in_place_of_a_density(make):
    with pytest.raises(InputError, match="give either `heat_.*` or `heat_rate`"):
        make(1.0, heat_rate=1.0)
    with pytest.raises(InputError, match="give either"):
        make()
    with pytest.raises(InputError, match="heat_rate .W.*: give a finite number"):
        make(heat_rate=np.nan)
