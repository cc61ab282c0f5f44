"""Where a fit is wrong: pictures of default and fitted beside the data."""

import io
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image

from jaxthermo.arrays import precision
from jaxthermo.config.camera_framing import build_camera
from jaxthermo.image.palette import apply_palette
from jaxthermo.image.render import draw
from jaxthermo.image.ticks import decimals_of, label, nice_ticks, time_label
from jaxthermo.integrate.run.parametric_run import ParametricSolution
from jaxthermo.report.difference_scale import (
    BACKGROUND,
    DifferenceScale,
    difference_bar,
    nice_limit,
)
from jaxthermo.report.sheet import ColourBar, Tile, sheet

from ..problem.problem import Case, Problem
from ..problem.targets import SurfaceTarget
from ..problem.thermogram_targets import FrameTarget, body_mask, view_of


WITHIN = 0.995
"""Share of the pixels that a scale spans: a few hot tips must not darken the rest."""
SIDE = 440
"""Pixels of a picture's longer side, about."""
PALETTE = "iron"
DECADES = 1.0
"""Of the scale of differences: a fit that halves them must show."""

Frame = Float[np.ndarray, "h w"]
Mask = Bool[np.ndarray, "h w"]
Solutions = dict[str, ParametricSolution]
"""By "default" and "fitted"."""


def run_both(problem: Problem, case: Case, z: Float[np.ndarray, " p"]) -> Solutions:
    """A case's runs with the values at the start and with those that were found.

    Args:
        problem: of the parameters.
        case: one of its cases.
        z: free numbers that were found.
    """
    alone = Problem(problem.parameters, (case,))
    found = {}
    with precision(problem.dtype.name):
        step_tables = None
        run = eqx.filter_jit(lambda z, table: case.run(alone.scene(case, z), table))
        for name, point in (("default", np.zeros_like(z)), ("fitted", z)):
            at = jnp.asarray(point, problem.dtype)
            step_tables = alone.step_tables_at(at, step_tables)
            found[name] = run(at, step_tables[0])
    return found


def difference_picture(
    case: Case, camera: Any, found: Solutions, whens: list[int]
) -> bytes:
    """A PNG: the body's surface less the reference's [K], default beside fitted.

    Args:
        case: with a surface as its data.
        camera: of the scene's config.
        found: both runs.
        whens: numbers of the saved times that are shown.

    Raises:
        InputError: if the camera is inside a body or sees none.
    """
    target = case.target
    assert isinstance(target, SurfaceTarget)
    surfaces = found["default"].surfaces
    triangles = np.concatenate([s.geometry.triangles for s in surfaces])
    view = view_of(surfaces, case.scene, build_camera(_sized(camera), triangles))

    def frame(surface: Any, when: int) -> Frame:
        with precision(case.scene.dtype):
            at = jnp.asarray(target.times[when], surface.dtype)
            seen = draw(view, surfaces, case.scene.terms, surface[when], at)
            return np.asarray(seen.temperature, float)

    differences = {
        f"{name}, {time_label(target.times[when])}": frame(
            solution.surface_temperature, when
        )
        - frame(target.reference, when)
        for when in whens
        for name, solution in found.items()
    }
    words = "surface less the reference's"
    return _png(_sheet(differences, body_mask(view), words, "K", case.name))


def frame_picture(case: Case, found: Solutions, when: int, view: int) -> bytes:
    """A PNG: data, the fitted model's frame, and what default and fitted are off by.

    Args:
        case: with frames as its data.
        found: both runs.
        when: number of the saved time.
        view: number of the view.
    """
    target = case.target
    assert isinstance(target, FrameTarget)
    counts = target.mask(view)
    unit = "K" if target.quantity == "temperature" else "W/(m\N{SUPERSCRIPT TWO} sr)"
    shown = whole(np.asarray(target.data[view][when], float), counts)
    frames = {}
    with precision(case.scene.dtype):
        for name, solution in found.items():
            pixels = target.model_pixels(view, case.scene, solution)[when]
            frames[name] = whole(np.asarray(pixels, float), counts)
    differences = {n: np.where(counts, f - shown, 0.0) for n, f in frames.items()}
    number = f", view {view}" if len(target.views) > 1 else ""
    title = f"{case.name}{number}, {time_label(target.times[when])}"
    above = _frames({"data": shown, "fitted model": frames["fitted"]}, counts, unit)
    below = _sheet(differences, counts, "model less data", unit, title)
    return _png(_stacked(below, above))


def whole(pixels: Float[np.ndarray, " p"], counts: Mask) -> Frame:
    """A frame of the pixels that count; NaN elsewhere."""
    frame = np.full(counts.shape, np.nan)
    frame[counts] = pixels
    return frame


def _sized(camera: Any) -> Any:
    """The same camera with as many pixels as a page needs."""
    share = SIDE / max(camera.width, camera.height)
    size = {
        "width": max(1, round(share * camera.width)),
        "height": max(1, round(share * camera.height)),
    }
    return camera.model_copy(update=size)


def close_up(
    image: UInt8[np.ndarray, "h w 3"], counts: Mask
) -> UInt8[np.ndarray, "rows columns 3"]:
    """The part of a picture with the pixels that count, in pixels that can be seen."""
    rows, columns = (np.flatnonzero(counts.any(axis)) for axis in (1, 0))
    parts = []
    for found, most in zip((rows, columns), counts.shape, strict=True):
        margin = 1 + len(found) // 16
        first, last = found[0] - margin, found[-1] + margin
        parts.append(slice(max(first, 0), min(last, most - 1) + 1))
    part = image[tuple(parts)]
    times = max(1, SIDE // max(part.shape[:2]))
    return part.repeat(times, axis=0).repeat(times, axis=1)


def _sheet(
    differences: dict[str, Frame], body: Mask, what: str, unit: str, title: str
) -> Image.Image:
    """Differences side by side, on one scale about zero."""
    sizes = np.abs([d[body] for d in differences.values()])
    scale = DifferenceScale(nice_limit(float(np.quantile(sizes, WITHIN))), DECADES)
    tiles = [
        Tile(
            close_up(scale.picture(d, body), body),
            name,
            f"RMS {_rms(d[body]):.2g} {unit}",
        )
        for name, d in differences.items()
    ]
    words = f"{what} [{unit}]; largest difference {sizes.max():.2g} {unit}"
    return sheet(tiles, difference_bar(scale, words), title)


def _frames(frames: dict[str, Frame], counts: Mask, unit: str) -> Image.Image:
    """Frames side by side, on the scale of the first."""
    first = next(iter(frames.values()))[counts]
    low, high = (float(v) for v in np.quantile(first, [1 - WITHIN, WITHIN]))
    high = max(high, low + 1e-6 * max(abs(low), 1.0))
    tiles = []
    for name, frame in frames.items():
        colours = apply_palette(np.where(counts, frame, low), low, high, PALETTE)
        colours[~counts] = BACKGROUND
        ends = f"{frame[counts].min():.4g} to {frame[counts].max():.4g} {unit}"
        tiles.append(Tile(close_up(colours, counts), name, ends))
    ticks = nice_ticks(low, high, 6)
    decimals = decimals_of(ticks[1] - ticks[0]) if len(ticks) > 1 else 1
    bar = ColourBar(
        colours=apply_palette(np.linspace(low, high, 512)[None], low, high, PALETTE)[0],
        ticks=tuple(((t - low) / (high - low), label(t, decimals)) for t in ticks),
        title=f"frames [{unit}]",
    )
    return sheet(tiles, bar, "data and fitted model")


def _rms(values: Float[np.ndarray, " p"]) -> float:
    return float(np.sqrt((values**2).mean()))


def _stacked(*sheets: Image.Image) -> Image.Image:
    """Sheets below each other."""
    width, height = max(s.width for s in sheets), sum(s.height for s in sheets)
    image = Image.new("RGB", (width, height), sheets[0].getpixel((0, 0)))
    top = 0
    for one in sheets:
        image.paste(one, ((width - one.width) // 2, top))
        top += one.height
    return image


def _png(image: Image.Image) -> bytes:
    with io.BytesIO() as file:
        image.save(file, "png", optimize=True)
        return file.getvalue()
