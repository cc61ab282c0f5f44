"""Peeling finds the voxels that the slicing of [FC00] finds."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from peeling import BODIES, in_view, peel_checked

from experiments.thesis.slicing import slice_voxels
from jaxthermo.geometry import shapes
from jaxthermo.raster.fragments import peel


SIZE = 24


def peeled_voxels(layers, depth):
    row, column = np.divmod(layers.pixel, layers.width)
    slab = np.floor(layers.depth).astype(int)
    within = (slab >= 0) & (slab < depth)
    # A surface on the face between two slabs belongs to either, by rounding.
    assert (np.abs(layers.depth - np.round(layers.depth)) > 1e-9).all()
    cells = zip(column[within], row[within], slab[within], strict=True)
    return {(int(c), int(r), int(s)) for c, r, s in cells}


@settings(deadline=None, max_examples=8)
@given(seed=st.integers(0, 2**32 - 1), body=st.sampled_from(sorted(BODIES)))
def test_bodies(seed, body):
    rng = np.random.default_rng(seed)
    triangles = in_view(BODIES[body](rng), rng)
    layers = peel_checked(triangles, SIZE, SIZE)
    expected = slice_voxels(triangles, width=SIZE, height=SIZE, depth=SIZE)
    assert peeled_voxels(layers, SIZE) == expected


@settings(deadline=None, max_examples=7)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_triangles_in_and_out_of_the_image(seed):
    rng = np.random.default_rng(seed)
    triangles = rng.uniform(-10, SIZE + 10, (50, 3, 3))
    layers = peel_checked(triangles, SIZE, SIZE)
    expected = slice_voxels(triangles, width=SIZE, height=SIZE, depth=SIZE)
    assert peeled_voxels(layers, SIZE) == expected


@pytest.mark.parametrize(
    "axis",
    [
        pytest.param(0, marks=pytest.mark.slow),
        pytest.param(1, marks=pytest.mark.slow),
        2,
    ],
)
def test_the_figurine(axis):
    mesh = shapes.figurine(resolution=48)
    low, high = mesh.bounds
    pixels = 32
    # Off the lattice: the figurine stands on a flat base.
    cells = (mesh.triangles - low) / (high - low).max() * (pixels - 0.37) + 0.21
    triangles = np.roll(cells, axis, axis=-1)
    layers = peel(triangles, pixels, pixels)
    expected = slice_voxels(triangles, width=pixels, height=pixels, depth=pixels)
    assert peeled_voxels(layers, pixels) == expected
