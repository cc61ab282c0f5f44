"""Ambient occlusion on and off: a warm figurine under a cold sky."""

import time
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.geometry.shapes import box, figurine, sphere
from jaxthermo.image.annotate import write_png
from jaxthermo.image.camera import OrthographicCamera, frame_all
from jaxthermo.image.palette import apply_palette, palette_table
from jaxthermo.image.render import draw
from jaxthermo.image.ssao import screen_space_occlusion
from jaxthermo.image.ticks import decimals_of, label as written, nice_ticks, to_celsius
from jaxthermo.image.view import compute_view
from jaxthermo.physics.radiation.visibility import DEFAULT_DIRECTIONS, sky_view
from jaxthermo.raster.fragments import peel
from jaxthermo.report.difference_scale import BACKGROUND
from jaxthermo.report.sheet import ColourBar, Tile, sheet
from jaxthermo.voxels.voxelize import voxelize


TALL = 0.3
"""[m]"""
START, SKY, GROUND = 303.15, 253.15, 278.15
"""[K]"""
COOLING = 1800.0
"""[s]"""
CERAMIC = jt.Material(1.2, density=2000.0, specific_heat=850.0, emissivity=0.92)
NEAR = 0.15
"""Radius of the screen-space occlusion [m]."""
SIZE = (420, 560)
"""Width and height of a picture [px]."""


def show_occlusion(folder: Path, height: int) -> dict[str, Any]:
    """The figurine with and without occlusion: pictures and numbers."""
    mesh = figurine(TALL)
    grid = voxelize(mesh, TALL / height)
    start = time.perf_counter()
    view = sky_view(
        mesh.triangles, grid.fragment_position, grid.fragment_normal, grid.pitch
    )
    seconds = time.perf_counter() - start
    visible = view.sky + view.ground
    structure = jt.FullVolume(grid)
    cooled = {on: _cooled(structure, on) for on in (False, True)}
    camera = frame_all(mesh.triangles, *SIZE)
    scenery = compute_view(cooled[True].surfaces, (), camera)
    shot = lambda values: _shot(scenery, cooled[True].surfaces, values)
    kelvin = {on: shot(s.surface_temperature[-1]) for on, s in cooled.items()}
    seen = shot(jnp.asarray(visible, jnp.float32))
    body = np.asarray(seen.object_id) >= 0
    screen = screen_space_occlusion(
        np.asarray(seen.depth, float), np.asarray(seen.normal, float), camera, NEAR
    )
    rays = np.asarray(seen.temperature, float)
    off, on = (np.asarray(kelvin[key].temperature, float) for key in (False, True))
    files = {
        "occlusion_view_factor.png": _view_factors(rays, screen, body),
        "occlusion_off_on.png": _temperatures(off, on, body),
        "occlusion_difference.png": _difference(on - off, body),
    }
    for name, image in files.items():
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
        "time_s": seconds,
        "view_factor_mean": float(visible @ area / area.sum()),
        "view_factor_least": float(visible.min()),
        "warmer_mean_K": float(warmer @ area / area.sum()),
        "warmer_most_K": float(warmer.max()),
        "screen_less_rays_rms": float(np.sqrt(np.mean((screen - rays)[body] ** 2))),
        "ball_on_plane": ball_on_plane(),
        "pictures": list(files),
    }


def _cooled(structure, occluded: bool):
    term = jt.Surroundings(
        SKY, ground=GROUND, occlusion=DEFAULT_DIRECTIONS if occluded else None
    )
    body = jt.Body(structure, CERAMIC, temperature=START)
    return jt.simulate(jt.Scene((body,), (term,)), COOLING)


def _shot(scenery, surfaces, values):
    zero = jnp.zeros((), values.dtype)
    return draw(scenery, surfaces, (), values, zero)


def _tile(
    values: np.ndarray, body, limits: tuple[float, float], palette, label, note
) -> Tile:
    colours = apply_palette(values, *limits, palette)
    colours[~body] = BACKGROUND
    return Tile(colours, label, note)


def _bar(low: float, high: float, palette: str, title: str) -> ColourBar:
    ticks = nice_ticks(low, high)
    decimals = decimals_of(ticks[1] - ticks[0]) if len(ticks) > 1 else 1
    places = [((t - low) / (high - low), written(t, decimals)) for t in ticks]
    return ColourBar(palette_table(palette), tuple(places), title)


def _view_factors(rays: np.ndarray, screen: np.ndarray, body: np.ndarray):
    tiles = [
        _tile(
            rays,
            body,
            (0.0, 1.0),
            "white-hot",
            "rays",
            f"{DEFAULT_DIRECTIONS} directions",
        ),
        _tile(screen, body, (0.0, 1.0), "white-hot", "screen space", "8 slices"),
    ]
    bar = _bar(0.0, 1.0, "white-hot", "view factor to the surroundings")
    return sheet(tiles, bar, "Ambient occlusion of the figurine")


def _temperatures(off: np.ndarray, on: np.ndarray, body: np.ndarray):
    both = np.concatenate([off[body], on[body]])
    low, high = (float(x) for x in np.quantile(both, [0.002, 0.998]))
    tiles = [
        _tile(
            off,
            body,
            (low, high),
            "iron",
            "off",
            "even the hollow inside sees sky and ground",
        ),
        _tile(on, body, (low, high), "iron", "on", "what is hidden sees itself"),
    ]
    limits = to_celsius(low), to_celsius(high)
    bar = _bar(*limits, "iron", "surface temperature [\N{DEGREE SIGN}C]")
    return sheet(tiles, bar, f"After {COOLING / 60:g} min under a cold sky")


def _difference(warmer: np.ndarray, body: np.ndarray):
    top = float(np.quantile(warmer[body], 0.998))
    tile = _tile(warmer, body, (0.0, top), "iron", "on less off", "")
    bar = _bar(0.0, top, "iron", "warmer with occlusion [K]")
    return sheet([tile], bar, "What occlusion changes")


def ball_on_plane() -> dict[str, float]:
    """Both kinds of occlusion on a plane under a ball of 1 m, against 1 - (R/d)^3."""
    floor = box((8.0, 8.0, 0.2)).triangles - np.array([0.0, 0.0, 0.1])
    ball = sphere(1.0, 4).triangles + np.array([0.0, 0.0, 1.0])
    camera = OrthographicCamera(
        (0.0, 0.0, 10.0),
        (0.0, 0.0, 0.0),
        8.0,
        up=(0.0, 1.0, 0.0),
        width=256,
        height=256,
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
    depths, normals = np.full(256 * 256, np.inf), np.zeros((256 * 256, 3))
    depths[pixel], normals[pixel] = depth, normal
    found = screen_space_occlusion(
        depths.reshape(256, 256), normals.reshape(256, 256, 3), camera, 4.0
    )
    screen = found.reshape(-1)[pixel]
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
