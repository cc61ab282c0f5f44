"""Moving a body moves its voxels and fragments, and changes nothing else."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from voxel_bodies import BALL

from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.voxels.voxelize import voxelize


PITCH = 1 / 16
FIGURINE = shapes.figurine(height=2.0, resolution=60)
BODIES = {"ball": BALL, "figurine": FIGURINE}


@pytest.fixture(scope="module")
def still():
    return {name: voxelize(mesh, PITCH) for name, mesh in BODIES.items()}


# Whole voxels of a power of two are exact, any other shift rounds.
shifts = st.tuples(*[st.integers(-99, 99)] * 3).map(lambda n: np.array(n) * PITCH)


@settings(deadline=None, max_examples=4)
@given(shift=shifts)
def test_whole_voxels(still, shift):
    grid = voxelize(BODIES["ball"].moved(shift), PITCH)
    assert (grid.solid == still["ball"].solid).all()
    assert grid.origin == pytest.approx(still["ball"].origin + shift)
    assert len(grid.fragment_area) == len(still["ball"].fragment_area)
    moved = still["ball"].fragment_position + shift
    assert grid.fragment_position == pytest.approx(moved, abs=1e-9)
    assert (grid.fragment_voxel == still["ball"].fragment_voxel).all()
    assert grid.fragment_area == pytest.approx(still["ball"].fragment_area)


@settings(deadline=None, max_examples=6)
@given(
    name=st.sampled_from(sorted(BODIES)),
    shift=st.tuples(*[st.floats(-7, 7)] * 3).map(np.array),
)
def test_any_shift(still, name, shift):
    """The lattice goes with the mesh, so that only rounding is left."""
    grid = voxelize(BODIES[name].moved(shift), PITCH)
    unmoved = still[name]
    assert grid.solid.shape == unmoved.solid.shape
    assert np.count_nonzero(grid.solid != unmoved.solid) <= 2
    assert grid.fragment_area.sum() == pytest.approx(unmoved.fragment_area.sum())
    assert grid.layers == unmoved.layers


@pytest.mark.parametrize("order", [(1, 2, 0), (2, 0, 1)])
def test_turning_the_axes_turns_the_voxels(still, order):
    turned = Mesh(FIGURINE.vertices[:, order], FIGURINE.faces, "turned")
    grid = voxelize(turned, PITCH)
    unturned = still["figurine"]
    assert np.count_nonzero(grid.solid != unturned.solid.transpose(order)) <= 2
    assert grid.layers.peeled == tuple(unturned.layers.peeled[a] for a in order)
    assert abs(len(grid.fragment_area) - len(unturned.fragment_area)) <= 4


def test_any_lattice_gives_about_the_same_body():
    rng = np.random.default_rng(5)
    volumes = []
    areas = []
    for _ in range(4):
        # A lattice is centred on the mesh: a far small part moves it by part of a cell.
        extra = 3.0 + PITCH * rng.uniform(0, 1)
        chip = shapes.box(2 * PITCH).moved((extra, 0.0, 0.0))
        pair = Mesh(
            np.concatenate([BALL.vertices, chip.vertices]),
            np.concatenate([BALL.faces, chip.faces + len(BALL.vertices)]),
        )
        grid = voxelize(pair, PITCH)
        on_ball = grid.fragment_position[:, 0] < 1.5
        areas.append(grid.fragment_area[on_ball].sum() / grid.area_ratio)
        cells = np.argwhere(grid.solid)
        near = grid.lattice.centres(cells)[:, 0] < 1.5
        volumes.append(near.sum() * PITCH**3)
    assert volumes == pytest.approx([BALL.volume] * 4, rel=5e-3)
    assert areas == pytest.approx([BALL.area] * 4, rel=1e-2)
