"""5.1: a warm figurine under a cold sky, with and without ambient occlusion."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from PIL import Image

import jaxthermo as jt
from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.geometry.shapes import box, figurine, sphere
from jaxthermo.image.radiance.draw import Moment, draw
from jaxthermo.image.surface.camera import frame_all
from jaxthermo.image.surface.occlusion import screen_space_occlusion
from jaxthermo.image.surface.view import compute_view
from jaxthermo.physics.radiation.visibility import DEFAULT_DIRECTIONS, sky_view
from jaxthermo.timing import timed_call

from ...harness.present import Shot, thermal_sheet
from ..exhibit import Finding, Verdict, exhibit, rms
from ..shaded import seen_points


# Height of the figurine [m].
_TALL = 0.3
# A clear, cold evening: a sky 50 K and a ground 25 K below the start [K], and half an
# hour of it [s], in which hidden and open regions of a ceramic body part.
_START = 303.15
_SKY = 253.15
_GROUND = 278.15
_COOLING = 1800.0
_CERAMIC = jt.Material(1.2, density=2000.0, specific_heat=850.0, emissivity=0.92)
# Radius of the screen-space occlusion [m].
_NEAR = 0.15

Pixels = Float[np.ndarray, "h w"]
Flags = Bool[np.ndarray, "h w"]


@exhibit("section-5.1-occlusion", "5.1")
def _ambient_occlusion(quick: bool) -> Finding:
    """Cool the figurine with and without occlusion."""
    height = 60 if quick else 110
    mesh = figurine(_TALL)
    grid = jt.voxelize(mesh, _TALL / height)
    view, time = timed_call(
        lambda: sky_view(
            mesh.triangles, grid.fragment_position, grid.fragment_normal, grid.pitch
        )
    )
    visible = view.sky + view.ground
    structure = jt.FullVolume(grid)
    plain = _cooled(structure, directions=None)
    occluded = _cooled(structure, directions=DEFAULT_DIRECTIONS)
    camera = frame_all(mesh.triangles, 420, 560)
    scenery = compute_view(occluded.surfaces, (), camera)

    def shot(values):
        # True temperatures: of what is reflected nothing is shown.
        zero = jnp.zeros((), jnp.float32)
        return draw(
            scenery,
            Moment(
                occluded.surfaces,
                terms=(),
                temperature=values,
                received=None,
                time=zero,
            ),
        )

    off, on = (
        np.asarray(shot(solution.surface_temperature[-1]).temperature, float)
        - ZERO_CELSIUS
        for solution in (plain, occluded)
    )
    # View factors are drawn like temperatures: one value a fragment.
    seen = shot(jnp.asarray(visible, jnp.float32))
    body = np.asarray(seen.object_id) >= 0
    rays = np.asarray(seen.temperature, float)
    screen = screen_space_occlusion(
        np.asarray(seen.depth, float), np.asarray(seen.normal, float), camera, _NEAR
    )
    warmer = np.asarray(
        occluded.surface_temperature[-1] - plain.surface_temperature[-1]
    )
    area = grid.fragment_area
    return Finding(
        Verdict.NOT_REPRODUCIBLE,
        {
            "height_voxels": height,
            "fragments": len(visible),
            "triangles": len(mesh.faces),
            "directions": DEFAULT_DIRECTIONS,
            "time_s": time,
            "view_factor_mean": float(visible @ area / area.sum()),
            "view_factor_min": float(visible.min()),
            "warmer_mean_K": float(warmer @ area / area.sum()),
            "warmer_max_K": float(warmer.max()),
            "screen_less_rays_rms": rms((screen - rays)[body]),
            "ball_on_plane": _ball_on_plane(),
        },
        {
            "occlusion_view_factor": _view_factors(rays, screen, body),
            "occlusion_off_on": _temperatures(off, on, body),
            "occlusion_difference": _difference(on - off, body),
        },
    )


def _cooled(structure: jt.FullVolume, directions: int | None) -> jt.Solution:
    term = jt.Surroundings(_SKY, ground=_GROUND, occlusion=directions)
    body = jt.Body(structure, _CERAMIC, temperature=_START)
    return jt.simulate(jt.Scene((body,), (term,)), _COOLING)


def _view_factors(rays: Pixels, screen: Pixels, body: Flags) -> Image.Image:
    return thermal_sheet(
        [
            Shot(rays, body, "rays", f"{DEFAULT_DIRECTIONS} directions"),
            Shot(screen, body, "screen space", "8 slices"),
        ],
        limits=(0.0, 1.0),
        scale="view factor to the surroundings",
        title="Ambient occlusion of the figurine",
        palette="white-hot",
    )


def _temperatures(off: Pixels, on: Pixels, body: Flags) -> Image.Image:
    # One scale for both; a few hot tips must not darken the rest.
    shots = [
        Shot(off, body, "off", "even the hollow inside sees sky and ground"),
        Shot(on, body, "on", "what is hidden sees itself"),
    ]
    temperatures = np.concatenate([shot.values[body] for shot in shots])
    low, high = np.quantile(temperatures, [0.002, 0.998]).tolist()
    return thermal_sheet(
        shots,
        limits=(low, high),
        scale="surface temperature [\N{DEGREE SIGN}C]",
        title=f"After {_COOLING / 60:g} min under a cold sky",
    )


def _difference(warmer: Pixels, body: Flags) -> Image.Image:
    return thermal_sheet(
        [Shot(warmer, body, "on less off")],
        limits=(0.0, float(np.quantile(warmer[body], 0.998))),
        scale="warmer with occlusion [K]",
        title="What occlusion changes",
    )


def _ball_on_plane() -> dict[str, float]:
    """Both kinds of occlusion on a plane under a ball of 1 m, against 1 - (R/d)^3."""
    floor = box((8.0, 8.0, 0.2)).moved((0.0, 0.0, -0.1))
    ball = sphere(1.0, 4).moved((0.0, 0.0, 1.0))
    size = 256
    camera = jt.OrthographicCamera(
        position=(0.0, 0.0, 10.0),
        look_at=(0.0, 0.0, 0.0),
        view_height=8.0,
        up=(0.0, 1.0, 0.0),
        width=size,
        height=size,
    )
    bodies = (ball, floor)
    seen, normal = seen_points(bodies, camera)
    depths = camera.frame_of(seen.pixel, seen.depth, np.inf)
    normals = camera.frame_of(seen.pixel, normal, 0.0)
    occlusion = screen_space_occlusion(depths, normals, camera, 4.0)
    screen = occlusion.reshape(-1)[seen.pixel]
    triangles = np.concatenate([mesh.triangles for mesh in bodies])
    view = sky_view(triangles, seen.position, normal, 0.05)
    rays = view.sky + view.ground
    x, y, z = seen.position.T
    plane = (normal[:, 2] > 0.99) & (np.abs(z) < 1e-3)
    exact = 1 - (1 + x[plane] ** 2 + y[plane] ** 2) ** -1.5
    return {
        "rays_rms": rms(rays[plane] - exact),
        "screen_rms": rms(screen[plane] - exact),
        "screen_less_rays_rms": rms(screen - rays),
    }
