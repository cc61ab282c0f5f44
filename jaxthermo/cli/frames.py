"""Frames of a run: EXR and PNG of each chosen time, on one temperature scale."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..config.build import build_term
from ..config.build_camera import build_camera
from ..config.loader import to_yaml
from ..config.schema import SceneConfig
from ..errors import InputError
from ..image.files import write_exr, write_png
from ..image.render import Image, coarsen, draw
from ..image.view import View, look
from ..integrate.store import StoredSolution
from ..physics.term import AbstractTerm
from ..scene.surface import SolvedSurface


MARGIN = 0.02
"""Of the scale beyond the coldest and warmest pixels."""


def prepare_view(
    config: SceneConfig,
    surfaces: tuple[SolvedSurface, ...],
    terms: tuple[AbstractTerm, ...],
) -> View:
    """What the config's camera sees; a bad camera is told here, before a long run."""
    triangles = np.concatenate([s.geometry.triangles for s in surfaces])
    camera = build_camera(config.camera, triangles)
    return look(
        surfaces, terms, camera.finer(config.image.samples), config.image.smooth
    )


def chosen_frames(config: SceneConfig, times: Float[Array, " t"]) -> list[int]:
    """Which saved times become frames: all, or those the config names."""
    if config.image.frames is None:
        return list(range(len(times)))
    saved = np.asarray(times, float)
    chosen = [int(np.abs(saved - wanted).argmin()) for wanted in config.image.frames]
    for k, wanted in zip(chosen, config.image.frames, strict=True):
        if not np.isclose(saved[k], wanted, rtol=1e-5):
            raise InputError(f"image.frames: {wanted:g} s is not a saved time")
    return chosen


def _scale(config: SceneConfig, images: list[Image]) -> tuple[float, float]:
    """Ends of the colour scale [K]: as configured, else what the bodies show."""
    seen = []
    for image in images:
        apparent = config.image.quantity == "apparent"
        shown = image.apparent_temperature if apparent else image.temperature
        seen.append(np.asarray(shown)[np.asarray(image.object_id) >= 0])
    values = np.concatenate(seen)
    low, high = float(values.min()), float(values.max())
    margin = max(MARGIN * (high - low), 0.05)
    low = low - margin if config.image.low is None else config.image.low
    high = high + margin if config.image.high is None else config.image.high
    if not low < high:
        raise InputError(
            f"image: the scale would go from {low:g} to {high:g} K; "
            "give both image.low and image.high"
        )
    return low, high


def write_frames(
    config: SceneConfig, view: View, stored: StoredSolution, folder: Path
) -> list[str]:
    """Draw the chosen times into `folder`; returns the names of the pictures."""
    terms = tuple(build_term(term) for term in config.terms)
    images = [
        coarsen(
            draw(
                view,
                stored.surfaces,
                terms,
                stored.surface_temperature[k],
                jnp.asarray(stored.times[k]),
            ),
            config.image.samples,
        )
        for k in chosen_frames(config, stored.times)
    ]
    low, high = _scale(config, images)
    folder.mkdir(exist_ok=True)
    names = []
    for image in images:
        name = f"t{float(image.time):09.2f}s"
        write_exr(folder / f"{name}.exr", image, {"config": to_yaml(config)})
        write_png(
            folder / f"{name}.png",
            image,
            low,
            high,
            palette=config.image.palette,
            quantity=config.image.quantity,
            title=config.name or "",
        )
        names.append(f"{folder.name}/{name}.png")
    return names
