"""Ambient occlusion on and off: a warm figurine under a cold sky."""

from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.geometry.shapes import box, figurine, sphere
from jaxthermo.image.colour.annotate import write_png
from jaxthermo.image.colour.ticks import to_celsius
from jaxthermo.image.radiance.draw import draw
from jaxthermo.image.surface.camera import frame_all
from jaxthermo.image.surface.occlusion import screen_space_occlusion
from jaxthermo.image.surface.view import compute_view
from jaxthermo.physics.radiation.visibility import DEFAULT_DIRECTIONS, sky_view
from jaxthermo.raster.fragments import peel
from jaxthermo.report.sheet import sheet

from ..harness.present import colour_bar, thermal_tile
from ..harness.timing import timed_call


# Height of the figurine [m].
_TALL = 0.3
# A clear, cold evening: a sky 50 K and a ground 25 K below the start [K], and half an
# hour of it [s], in which hidden and open parts of a ceramic body part by some kelvin.
_START, _SKY, _GROUND = 303.15, 253.15, 278.15
_COOLING = 1800.0
_CERAMIC = jt.Material(1.2, density=2000.0, specific_heat=850.0, emissivity=0.92)
# Radius of the screen-space occlusion [m].
_NEAR = 0.15
# Width and height of a picture [px].
_SIZE = (420, 560)


def show_occlusion(folder: Path, height: int) -> dict[str, Any]:
    """The figurine with and without occlusion: pictures and numbers."""
    mesh = figurine(_TALL)
    grid = jt.voxelize(mesh, _TALL / height)
    place = grid.fragment_position, grid.fragment_normal
    view, time = timed_call(lambda: sky_view(mesh.triangles, *place, grid.pitch))
    visible = view.sky + view.ground
    structure = jt.FullVolume(grid)
    cooled = {on: _cooled(structure, on) for on in (False, True)}
    camera = frame_all(mesh.triangles, *_SIZE)
    scenery = compute_view(cooled[True].surfaces, (), camera)
    # True temperatures: of what is reflected nothing is shown.
    zero, surfaces = jnp.zeros((), jnp.float32), cooled[True].surfaces
    shot = lambda values: draw(scenery, surfaces, (), values, None, zero)
    kelvin = {on: shot(s.surface_temperature[-1]) for on, s in cooled.items()}
    # View factors are drawn like temperatures: one value a fragment.
    seen = shot(jnp.asarray(visible, jnp.float32))
    body = np.asarray(seen.object_id) >= 0
    screen = screen_space_occlusion(
        np.asarray(seen.depth, float), np.asarray(seen.normal, float), camera, _NEAR
    )
    rays = np.asarray(seen.temperature, float)
    off, on = (np.asarray(kelvin[key].temperature, float) for key in (False, True))
    sheets = {
        "occlusion_view_factor.png": _view_factors(rays, screen, body),
        "occlusion_off_on.png": _temperatures(off, on, body),
        "occlusion_difference.png": _difference(on - off, body),
    }
    for name, image in sheets.items():
        write_png(folder / name, image)
    warmer = np.asarray(
        cooled[True].surface_temperature[-1] - cooled[False].surface_temperature[-1]
    )
    area = grid.fragment_area
    return {
        "height_voxels": height,
        "fragments": len(visible),
        "triangles": len(mesh.faces),
        "directions": DEFAULT_DIRECTIONS,
        "time_s": time,
        "view_factor_mean": float(visible @ area / area.sum()),
        "view_factor_least": float(visible.min()),
        "warmer_mean_K": float(warmer @ area / area.sum()),
        "warmer_most_K": float(warmer.max()),
        "screen_less_rays_rms": float(np.sqrt(np.mean((screen - rays)[body] ** 2))),
        "ball_on_plane": _ball_on_plane(),
        "pictures": list(sheets),
    }


def _cooled(structure, occluded: bool):
    term = jt.Surroundings(
        _SKY, ground=_GROUND, occlusion=DEFAULT_DIRECTIONS if occluded else None
    )
    body = jt.Body(structure, _CERAMIC, temperature=_START)
    return jt.simulate(jt.Scene((body,), (term,)), _COOLING)


def _view_factors(rays: np.ndarray, screen: np.ndarray, body: np.ndarray):
    note, limits = f"{DEFAULT_DIRECTIONS} directions", (0.0, 1.0)
    tiles = [
        thermal_tile(rays, body, limits, "rays", note, "white-hot"),
        thermal_tile(screen, body, limits, "screen space", "8 slices", "white-hot"),
    ]
    bar = colour_bar(0.0, 1.0, "view factor to the surroundings", "white-hot")
    return sheet(tiles, bar, "Ambient occlusion of the figurine")


def _temperatures(off: np.ndarray, on: np.ndarray, body: np.ndarray):
    # One scale for both; a few hot tips must not darken the rest.
    both = np.concatenate([off[body], on[body]])
    low, high = (float(x) for x in np.quantile(both, [0.002, 0.998]))
    hollow = "even the hollow inside sees sky and ground"
    tiles = [
        thermal_tile(off, body, (low, high), "off", hollow),
        thermal_tile(on, body, (low, high), "on", "what is hidden sees itself"),
    ]
    title = "surface temperature [\N{DEGREE SIGN}C]"
    bar = colour_bar(to_celsius(low), to_celsius(high), title)
    return sheet(tiles, bar, f"After {_COOLING / 60:g} min under a cold sky")


def _difference(warmer: np.ndarray, body: np.ndarray):
    top = float(np.quantile(warmer[body], 0.998))
    tile = thermal_tile(warmer, body, (0.0, top), "on less off")
    bar = colour_bar(0.0, top, "warmer with occlusion [K]")
    return sheet([tile], bar, "What occlusion changes")


def _ball_on_plane() -> dict[str, float]:
    """Both kinds of occlusion on a plane under a ball of 1 m, against 1 - (R/d)^3."""
    floor = box((8.0, 8.0, 0.2)).triangles - np.array([0.0, 0.0, 0.1])
    ball = sphere(1.0, 4).triangles + np.array([0.0, 0.0, 1.0])
    size, above, up = 256, (0.0, 0.0, 10.0), (0.0, 1.0, 0.0)
    camera = jt.OrthographicCamera(
        above, (0.0, 0.0, 0.0), view_height=8.0, up=up, width=size, height=size
    )
    triangles = np.concatenate([ball, floor])
    corners, parent = camera.to_raster(triangles)
    layers = peel(corners, *camera.size)
    front = layers.layer == 0
    pixel = layers.pixel[front]
    point, depth = camera.points(pixel, layers.depth[front])
    a, b, c = np.moveaxis(triangles[parent[layers.triangle[front]]], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    depths, normals = np.full((size, size), np.inf), np.zeros((size, size, 3))
    depths.reshape(-1)[pixel], normals.reshape(-1, 3)[pixel] = depth, normal
    screen = screen_space_occlusion(depths, normals, camera, 4.0).reshape(-1)[pixel]
    view = sky_view(triangles, point, normal, 0.05)
    rays = view.sky + view.ground
    plane = (normal[:, 2] > 0.99) & (np.abs(point[:, 2]) < 1e-3)
    exact = 1 - (1 + point[plane, 0] ** 2 + point[plane, 1] ** 2) ** -1.5
    rms = lambda gap: float(np.sqrt(np.mean(gap**2)))
    return {
        "rays_rms": rms(rays[plane] - exact),
        "screen_rms": rms(screen[plane] - exact),
        "screen_less_rays_rms": rms(screen - rays),
    }
