"""Vertex temperatures and textures: what a camera shows at the same points."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.image.files.surfaces import _vertex_mesh
from jaxthermo.image.files.textures import _build_atlas


BODIES = {
    "ball": jt.shapes.sphere(0.04),
    "box": jt.shapes.box((0.06, 0.08, 0.05)),
}


@pytest.fixture(scope="module", params=BODIES)
def uneven(request):
    """A body whose temperature varies along all axes."""
    grid = jt.voxelize(BODIES[request.param], 0.004)
    body = jt.Body(
        jt.FullVolume(grid),
        jt.materials["copper"],
        temperature=lambda x: 300 + 400 * x[..., 0] - 250 * x[..., 1] + 90 * x[..., 2],
        pose=jt.Pose((0.3, -0.1, 0.2), ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0, 0, 1))),
    )
    return jt.simulate(jt.Scene((body,), dtype="float64"), 0.0)


def seen(solution, point, normal):
    """Temperature of the one pixel of a camera that looks at a point of the surface."""
    camera = jt.OrthographicCamera(
        position=tuple((point + 0.5 * normal).tolist()),
        look_at=tuple(point.tolist()),
        up=(0.31, -0.52, 0.8),
        view_height=1e-6,
        width=1,
        height=1,
    )
    return float(np.asarray(jt.render(solution, camera).temperature)[0, 0])


def test_vertices_have_the_temperatures_of_the_image(uneven):
    geometry = uneven.surfaces[0].geometry
    mesh = _vertex_mesh(geometry)
    pose = geometry.placed
    kelvin = mesh.values(np.asarray(uneven.surface_temperature[-1]))
    corners = mesh.vertices[mesh.faces]
    length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1)
    assert length.max() <= 2 * geometry.pitch
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-12)
    assert np.ptp(kelvin) > 20
    # Vertices inside of smooth surfaces: a ray at a crease may hit either side.
    inside = np.abs(mesh.vertices) < np.abs(mesh.vertices).max(0) - 1e-6
    smooth_vertices = np.flatnonzero(inside.sum(axis=1) >= 2)[::211]
    assert len(smooth_vertices) >= 4
    for vertex in smooth_vertices:
        point = pose.to_world(mesh.vertices[vertex])
        normal = pose.rotate(mesh.normals[vertex])
        assert seen(uneven, point, normal) == pytest.approx(kelvin[vertex], abs=2e-4)


def test_sides_of_a_crease_have_vertices_of_their_own():
    grid = jt.voxelize(BODIES["box"], 0.01)
    body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=300.0)
    surface = jt.simulate(jt.Scene((body,)), 0.0).surfaces[0]
    mesh = _vertex_mesh(surface.geometry)
    at_corner = np.isclose(mesh.vertices, [0.03, 0.04, 0.025]).all(axis=1)
    assert at_corner.sum() == 3
    np.testing.assert_allclose(mesh.normals[at_corner].sum(axis=0), 1, atol=1e-12)


def sampled(image, uv):
    """Texture at coordinates, linear between the centres of texels."""
    height, width = image.shape
    x = uv[:, 0] * width - 0.5
    y = (1 - uv[:, 1]) * height - 0.5
    left = np.floor(x).astype(int)
    top = np.floor(y).astype(int)
    right = np.minimum(left + 1, width - 1)
    low = np.minimum(top + 1, height - 1)
    a = x - left
    b = y - top
    upper = (1 - a) * image[top, left] + a * image[top, right]
    return (1 - b) * upper + b * ((1 - a) * image[low, left] + a * image[low, right])


def test_a_texture_has_the_temperatures_of_the_image(uneven):
    geometry = uneven.surfaces[0].geometry
    atlas = _build_atlas(geometry)
    fragments = np.asarray(uneven.surface_temperature[-1])
    image = atlas.texture(fragments)
    # No texel belongs to two triangles.
    assert len(np.unique(atlas.texel)) == len(atlas.texel)
    assert atlas.uv.min() > 0 and atlas.uv.max() < 1
    generator = np.random.default_rng(0)
    face = generator.integers(len(atlas.faces), size=12)
    share = generator.dirichlet([1, 1, 1], size=12)

    def mixed(corners: np.ndarray) -> np.ndarray:
        return np.einsum("pc,pci->pi", share, corners)

    points = geometry.placed.to_world(mixed(atlas.vertices[atlas.faces[face]]))
    triangles = geometry.placed.to_world(atlas.vertices)[atlas.faces[face]]
    flat = np.cross(
        triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    )
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    texture_kelvin = sampled(image, mixed(atlas.uv[face]))
    image_kelvin = [
        seen(uneven, point, normal) for point, normal in zip(points, flat, strict=True)
    ]
    # Linear between texels of one voxel, of a mean over two.
    np.testing.assert_allclose(texture_kelvin, image_kelvin, atol=0.15)
    assert np.abs(texture_kelvin - image_kelvin).mean() < 0.04


def test_corners_of_triangles_are_at_texels(uneven):
    geometry = uneven.surfaces[0].geometry
    atlas = _build_atlas(geometry)
    mesh = _vertex_mesh(geometry, longest_edge=1.0)
    fragments = np.asarray(uneven.surface_temperature[-1])
    corners = sampled(atlas.texture(fragments), atlas.uv.reshape(-1, 2))
    np.testing.assert_allclose(
        corners, mesh.values(fragments)[mesh.faces].ravel(), atol=1e-3
    )
