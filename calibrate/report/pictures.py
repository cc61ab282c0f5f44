"""Pictures of a fit's errors: default and fitted values compared with the data."""

import io
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image

from jaxthermo.arrays import precision
from jaxthermo.config.camera_framing import camera_on
from jaxthermo.image.colour.palette import apply_palette
from jaxthermo.image.colour.ticks import (
    scale_ticks,
    time_label,
)
from jaxthermo.image.radiance.draw import Moment, draw
from jaxthermo.image.surface.abstract_camera import AbstractCamera
from jaxthermo.image.surface.view import compute_view
from jaxthermo.integrate.run.parametric_run import ParametricSolution
from jaxthermo.report.difference_scale import (
    BACKGROUND,
    DifferenceScale,
    difference_bar,
    nice_limit,
)
from jaxthermo.report.sheet import ColourBar, Tile, sheet

from ..problem.frame_values import FrameValues
from ..problem.problem import Case, Problem
from ..problem.targets import FrameTarget, SurfaceTarget, body_mask


SIDE = 440
"""Length of a picture's longer side, about [px]."""

# A scale over all pixels would be stretched by a few hot tips, and darken the rest.
_SCALE_QUANTILE = 0.995
_PALETTE = "iron"
_DECADES = 1.0
"""Decades of the scale of differences, so that a fit that halves them is seen."""
_QUANTITIES = {
    "temperature": ("K", "apparent temperature"),
    # The font of pictures has no superscripts.
    "radiance": ("W/(m^2 sr)", "radiance"),
}
"""Unit and name of what frames show."""
Solutions = dict[str, ParametricSolution]
"""Runs by name, such as with the "default" and the "fitted" values."""
_Frame = Float[np.ndarray, "h w"]
_Mask = Bool[np.ndarray, "h w"]


def runs_at(
    problem: Problem, case: Case, points: Mapping[str, Float[np.ndarray, " p"]]
) -> Solutions:
    """Run a case with the values at each of some coordinates, by name."""
    alone = Problem(problem.parameters, (case,))
    solutions = {}
    with precision(problem.dtype.name):

        @eqx.filter_jit
        def run(z, table):
            return case.run(problem.parameters.insert(case.scene, z), table)

        for name, point in points.items():
            at = jnp.asarray(point, problem.dtype)
            # One compiled program for all: tables differ in their values only.
            solutions[name] = run(at, alone.step_tables_at(at)[0])
    return solutions


def run_both(problem: Problem, case: Case, z: Float[np.ndarray, " p"]) -> Solutions:
    """Run a case with the scene's own values and with those of the coordinates z."""
    return runs_at(problem, case, {"default": problem.default(), "fitted": z})


def values_of_both(
    problem: Problem, case: Case, z: Float[np.ndarray, " p"]
) -> dict[str, FrameValues]:
    """Values that a case's frames depend on, the scene's own and those of z."""
    values = {}
    number = problem.cases.index(case)
    with precision(problem.dtype.name):
        for name, point in (("default", problem.default()), ("fitted", z)):
            at = jnp.asarray(point, problem.dtype)
            views = problem.views_at(at)
            case_views = views[number] if views else ()
            values[name] = problem.parameters.frame_values(at, case_views)
    return values


def difference_picture(
    case: Case, camera: Any, solutions: Solutions, times: list[int]
) -> bytes:
    """PNG of surface minus reference temperature [K], runs side by side."""
    target = case.target
    assert isinstance(target, SurfaceTarget)
    surfaces = next(iter(solutions.values())).surfaces
    # Bodies of a fit do not move: one view for both runs and all times.
    camera = _resized(camera_on(camera, surfaces))
    view = compute_view(surfaces, case.scene.terms, camera)

    def frame(surface: Any, time: int) -> _Frame:
        with precision(case.scene.dtype):
            at = jnp.asarray(target.times[time], surface.dtype)
            # True temperatures do not depend on what the surface reflects.
            moment = Moment(
                surfaces=surfaces,
                terms=case.scene.terms,
                temperature=surface[time],
                received=None,
                time=at,
            )
            return np.asarray(draw(view, moment).temperature, float)

    differences = {}
    for time in times:
        for name, solution in solutions.items():
            difference = frame(solution.surface_temperature, time)
            difference = difference - frame(target.reference, time)
            differences[f"{name}, {time_label(target.times[time])}"] = difference
    words = "surface temperature minus reference"
    sheet_of_all = _difference_sheet(
        differences, mask=body_mask(view), words=words, unit="K", title=case.name
    )
    return _png(sheet_of_all)


def frame_picture(
    case: Case,
    solutions: Solutions,
    values: dict[str, FrameValues],
    time: int,
    view: int,
) -> bytes:
    """PNG of data, the fitted model's frame, and both differences from the data.

    The values are those of frames with the "default" and with the "fitted" numbers.
    """
    target = case.target
    assert isinstance(target, FrameTarget)
    mask = target.mask(view)
    unit, words = _QUANTITIES[target.frame_quantity.quantity]
    data = _scatter(np.asarray(target.data[view][time], float), mask)
    frames = {}
    with precision(case.scene.dtype):
        for name, solution in solutions.items():
            pixels = target.model_pixels(
                view, scene=case.scene, solution=solution, values=values[name]
            )
            pixels = pixels[time]
            frames[name] = _scatter(np.asarray(pixels, float), mask)
    # The scale of differences takes no NaN.
    differences = {n: np.where(mask, f - data, 0.0) for n, f in frames.items()}
    number = f", view {view}" if len(target.views) > 1 else ""
    title = f"{case.name}{number}, {time_label(target.times[time])}"
    below = _difference_sheet(
        differences, mask=mask, words="model minus data", unit=unit, title=title
    )
    pictured = {"data": data, "fitted model": frames["fitted"]}
    above = _frame_sheet(pictured, mask=mask, unit=unit, words=f"{words} [{unit}]")
    return _png(_stacked(below, above))


def _scatter(pixels: Float[np.ndarray, " p"], mask: _Mask) -> _Frame:
    """Frame of the pixels of a mask; NaN elsewhere."""
    frame = np.full(mask.shape, np.nan)
    frame[mask] = pixels
    return frame


def _resized(camera: AbstractCamera) -> AbstractCamera:
    scale = SIDE / max(camera.width, camera.height)
    width = max(1, round(scale * camera.width))
    height = max(1, round(scale * camera.height))
    return replace(camera, width=width, height=height)


def _close_up(
    image: UInt8[np.ndarray, "h w 3"], mask: _Mask
) -> UInt8[np.ndarray, "rows columns 3"]:
    """Part of a picture around a mask, enlarged by a whole factor."""
    slices = []
    for axis, size in zip((1, 0), mask.shape, strict=True):
        covered = np.flatnonzero(mask.any(axis))
        margin = 1 + len(covered) // 16
        first = covered[0] - margin
        last = covered[-1] + margin
        slices.append(slice(max(first, 0), min(last, size - 1) + 1))
    detail = image[tuple(slices)]
    # Whole pixels of a camera of few pixels, without smoothing.
    factor = max(1, SIDE // max(detail.shape[:2]))
    return detail.repeat(factor, axis=0).repeat(factor, axis=1)


def _difference_sheet(
    differences: dict[str, _Frame], mask: _Mask, words: str, unit: str, title: str
) -> Image.Image:
    # Side by side, on one scale that is symmetric about zero.
    sizes = np.abs([d[mask] for d in differences.values()])
    limit = nice_limit(float(np.quantile(sizes, _SCALE_QUANTILE)))
    scale = DifferenceScale(limit, _DECADES)
    tiles = []
    for name, difference in differences.items():
        picture = _close_up(scale.picture(difference, mask), mask)
        rms = float(np.sqrt((difference[mask] ** 2).mean()))
        tiles.append(Tile(picture, name, f"RMS of its pixels {rms:.2g} {unit}"))
    text = f"{words} [{unit}]; largest difference {sizes.max():.2g} {unit}"
    return sheet(tiles, difference_bar(scale, text), title)


def _frame_sheet(
    frames: dict[str, _Frame], mask: _Mask, unit: str, words: str
) -> Image.Image:
    # Side by side, on the scale of the first.
    first = next(iter(frames.values()))[mask]
    ends = np.quantile(first, [1 - _SCALE_QUANTILE, _SCALE_QUANTILE])
    low, high = (float(v) for v in ends)
    # A uniform frame still needs a scale of some width.
    high = max(high, low + 1e-6 * max(abs(low), 1.0))
    tiles = []
    for name, frame in frames.items():
        colours = apply_palette(
            np.where(mask, frame, low), low=low, high=high, name=_PALETTE
        )
        colours[~mask] = BACKGROUND
        note = f"{frame[mask].min():.4g} to {frame[mask].max():.4g} {unit}"
        tiles.append(Tile(_close_up(colours, mask), name, note))
    ramp = np.linspace(low, high, 512)[None]
    bar = ColourBar(
        colours=apply_palette(ramp, low=low, high=high, name=_PALETTE)[0],
        ticks=scale_ticks(low, high, 6),
        title=words,
    )
    return sheet(tiles, bar, "data and fitted model")


def _stacked(*sheets: Image.Image) -> Image.Image:
    width = max(s.width for s in sheets)
    height = sum(s.height for s in sheets)
    paper = sheets[0].getpixel((0, 0))
    image = Image.new("RGB", (width, height), paper)
    top = 0
    for picture in sheets:
        image.paste(picture, ((width - picture.width) // 2, top))
        top += picture.height
    return image


def _png(image: Image.Image) -> bytes:
    with io.BytesIO() as file:
        image.save(file, "png", optimize=True)
        return file.getvalue()
