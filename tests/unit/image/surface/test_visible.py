"""Normals with which surfaces are shaded: smooth where round, sharp at edges."""

from typing import NamedTuple

import numpy as np
import pytest

from jaxthermo.geometry import shapes
from jaxthermo.image.surface.facets import corner_normals, smooth_normals


class Samples(NamedTuple):
    face: np.ndarray
    point: np.ndarray
    flat: np.ndarray
    """Normals of the faces."""


def sampled(mesh, count=2000) -> Samples:
    """Random points on a mesh."""
    random = np.random.default_rng(5)
    face = random.integers(len(mesh.faces), size=count)
    weight = random.dirichlet(np.ones(3), size=count)
    point = np.einsum("pi,pij->pj", weight, mesh.triangles[face])
    flat = mesh.area_vectors[face]
    flat = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    return Samples(face=face, point=point, flat=flat)


def off(normal, exact):
    """Largest angle between two sets of unit vectors [deg]."""
    cosine = np.einsum("pi,pi->p", normal, exact)
    return float(np.rad2deg(np.arccos(np.clip(cosine, -1, 1)).max()))


def test_a_ball_of_facets_is_shaded_like_a_ball():
    mesh = shapes.sphere(0.1, 2)
    face, point, flat = sampled(mesh)
    exact = point / np.linalg.norm(point, axis=1, keepdims=True)
    smooth = smooth_normals(mesh.vertices, faces=mesh.faces, face=face, points=point)
    np.testing.assert_allclose(np.linalg.norm(smooth, axis=1), 1.0)
    assert off(flat, exact) > 9.0
    # The second order of the interpolation is left of the first order of the facets.
    assert off(smooth, exact) < 1.0


def test_a_cylinder_is_round_along_its_side_and_sharp_at_its_rims():
    mesh = shapes.cylinder(0.05, 0.2)
    face, point, flat = sampled(mesh)
    cap = np.abs(flat[:, 2]) > 0.5
    smooth = smooth_normals(mesh.vertices, faces=mesh.faces, face=face, points=point)
    np.testing.assert_allclose(smooth[cap], flat[cap], atol=1e-12)
    radial = point[~cap] * [1, 1, 0]
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    assert off(smooth[~cap], radial) < 0.1 * off(flat[~cap], radial)


def test_a_block_stays_flat():
    mesh = shapes.box((0.1, 0.2, 0.3))
    face, point, flat = sampled(mesh, 200)
    smooth = smooth_normals(mesh.vertices, faces=mesh.faces, face=face, points=point)
    np.testing.assert_allclose(smooth, flat, atol=1e-12)


def test_it_is_the_mean_of_the_normals_at_the_corners():
    mesh = shapes.cylinder(0.05, 0.2)
    face, point, _ = sampled(mesh, 100)
    _, normals, corners = corner_normals(mesh.vertices, mesh.faces)
    expected = []
    for number, at in zip(face, point, strict=True):
        corner = mesh.vertices[mesh.faces[number]]
        # Weights that add up to 1 and whose mean of the corners is the point.
        rows = np.vstack([corner.T, np.ones(3)])
        weight = np.linalg.lstsq(rows, np.append(at, 1.0), rcond=None)[0]
        mean = weight @ normals[corners[number]]
        expected.append(mean / np.linalg.norm(mean))
    smooth = smooth_normals(mesh.vertices, faces=mesh.faces, face=face, points=point)
    np.testing.assert_allclose(smooth, expected, atol=1e-9)


@pytest.mark.parametrize("corner", [0, 1, 2])
def test_neighbours_agree_at_a_common_corner(corner):
    mesh = shapes.sphere(1.0, 1)
    vertex = int(mesh.faces[7, corner])
    around = np.flatnonzero((mesh.faces == vertex).any(1))
    point = np.repeat(mesh.vertices[vertex][None], len(around), axis=0)
    normal = smooth_normals(mesh.vertices, faces=mesh.faces, face=around, points=point)
    assert off(normal, np.repeat(normal[:1], len(around), axis=0)) < 1e-5
