"""What a camera sees of each structure, and how far that is from the full volume's."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from skimage.metrics import structural_similarity

from jaxthermo.config.camera_framing import build_camera
from jaxthermo.config.schema.image import PinholeConfig
from jaxthermo.image.render import draw
from jaxthermo.image.view import View, compute_view
from jaxthermo.integrate.surface_error import AnySolution, error_span
from jaxthermo.scene.solved_surface import SolvedSurface

from .record import Row


class Scenery(NamedTuple):
    """One camera on one body, for all its structures."""

    view: View
    surfaces: tuple[SolvedSurface, ...]
    body: Bool[np.ndarray, "h w"]
    """Pixels that show the body."""

    def frame(self, temperature: Float[np.ndarray, " s"]) -> Float[np.ndarray, "h w"]:
        """The surface's temperature in every pixel [K]; the air's in the background."""
        values = jnp.asarray(temperature)
        image = draw(self.view, self.surfaces, (), values, jnp.zeros((), values.dtype))
        return np.asarray(image.temperature)


def scenery(camera: PinholeConfig, surfaces: tuple[SolvedSurface, ...]) -> Scenery:
    """The camera of the config, looking at the body."""
    triangles = np.concatenate([s.geometry.triangles for s in surfaces])
    view = compute_view(surfaces, (), build_camera(camera, triangles))
    width, height = view.camera.size
    body = np.zeros(height * width, bool)
    body[view.pixel] = True
    return Scenery(view, surfaces, body.reshape(height, width))


def frame_error(scene: Scenery, solution: AnySolution, reference: AnySolution) -> Row:
    """RMS [K] and SSIM over the body's pixels at each saved time after 0.

    The data range of the SSIM is what the surface error is divided by at that time.
    """
    later = np.asarray(reference.times) > 0
    found = np.asarray(solution.surface_temperature)[later]
    expected = np.asarray(reference.surface_temperature)[later]
    spans = np.asarray(error_span(jnp.asarray(expected)), float)
    rms, ssim = [], []
    for one, other, span in zip(found, expected, spans, strict=True):
        ours, theirs = scene.frame(one), scene.frame(other)
        square = (ours - theirs)[scene.body].astype(float) ** 2
        rms.append(float(np.sqrt(square.mean())))
        ssim.append(_similarity(scene, ours, theirs, float(span)))
    return {
        "rms_kelvin": rms,
        "ssim": ssim,
        "ssim_data_range_K": spans.tolist(),
        "worst_rms_kelvin": max(rms),
        "worst_ssim": min(ssim),
    }


def _similarity(
    scene: Scenery,
    ours: Float[np.ndarray, "h w"],
    theirs: Float[np.ndarray, "h w"],
    span: float,
) -> float:
    """Mean over the body's pixels: the background is the same in all and would flatter.

    Differences from the background keep float32's digits.
    """
    level = float(theirs.min())
    images = [np.asarray(image, float) - level for image in (ours, theirs)]
    every = structural_similarity(*images, data_range=span, full=True)[-1]
    return float(np.asarray(every)[scene.body].mean())
