"""Frames as data: their compared pixels, and checks of what can be compared."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxthermo.errors import InputError
from jaxthermo.image.pose.derivative import linearize_view
from jaxthermo.image.pose.outline import outline_distance
from jaxthermo.image.pose.pose import moved_camera
from jaxthermo.image.radiance.band import black_radiance
from jaxthermo.image.surface.view import View, compute_view
from jaxthermo.physics.term import AbstractTerm
from jaxthermo.scene.scene import SolvedSurface
from jaxthermo.temperatures import (
    ALLOW_EXTREME,
    CheckedValues,
    Limits,
    LinearUnit,
    pixel_mistake,
    temperature_limits,
)

from .frame_quantity import FrameQuantity
from .targets import FrameTarget, body_mask


Masks = Sequence[Bool[np.ndarray, "_ _"] | None]
"""Pixels to compare of each view; None for all."""


class FitsPoses(NamedTuple):
    """Cameras whose poses are fitted."""

    surfaces: tuple[SolvedSurface, ...]
    """Surfaces of the bodies."""
    terms: tuple[AbstractTerm, ...]
    """Terms of the scene, whose sources may hide bodies."""
    poses: Float[np.ndarray, "v 6"]
    """Start of the fit."""
    margin: float
    """Distance from outlines within which pixels are not compared [pixels]."""


class FrameLimits(NamedTuple):
    """Limits of the values of frames, in their own unit."""

    bounds: Limits
    symbol: str = "K"
    unit: LinearUnit | None = None
    """Unit in which files were read, which may be the mistake."""


def frame_limits(
    frame_quantity: FrameQuantity,
    unit: LinearUnit | None,
    allow_extreme_temperatures: bool,
) -> FrameLimits:
    """Limits of frames of a quantity, read in a unit."""
    kelvin = temperature_limits(allow_extreme_temperatures)
    if frame_quantity.quantity == "temperature":
        return FrameLimits(kelvin, "K", unit)
    if allow_extreme_temperatures:
        return FrameLimits(kelvin, "W/(m^2 sr)")
    ends = black_radiance(np.array(kelvin), frame_quantity.band)
    return FrameLimits(Limits(*np.asarray(ends).tolist()), "W/(m^2 sr)")


_MORE_WEIGHTS = 1.3
"""Room for weights of fragments in a view, over their number at the start."""


def frame_target(
    times: tuple[float, ...],
    views: tuple[View, ...],
    frames: list[Float[np.ndarray, "_ _ _"]],
    noise: float,
    frame_quantity: FrameQuantity,
    masks: Masks,
    dtype: Any,
    limits: FrameLimits,
    moving: FitsPoses | None = None,
) -> FrameTarget:
    """Make a target of the frames [time, row, column] of every view of the model.

    The masks hold the pixels to compare, of each view; those without a body are left
    out, and with `moving` cameras those near outlines. The other arguments are those of
    `FrameTarget`.
    """
    check_frames(times, views=views, frames=frames, masks=masks)
    data = []
    indices = []
    room = []
    for n, (view, view_frames) in enumerate(zip(views, frames, strict=True)):
        # The background depends on no parameter.
        compared = body_mask(view) if moving is None else _interior(view, n, moving)
        if n < len(masks) and (mask := masks[n]) is not None:
            compared = mask & compared
        if not compared.any():
            why = "" if moving is None else ", or give a smaller `margin`"
            raise InputError(
                f"view {n}: no pixel of a body is compared: check the mask{why}"
            )
        _check_pixels(
            view_frames, compared, times=times, limits=limits, where=f"view {n}"
        )
        pixels = np.flatnonzero(compared)
        data.append(jnp.asarray(view_frames[:, compared], dtype))
        indices.append(jnp.asarray(pixels, jnp.int32))
        if moving is not None:
            linearized = linearize_view(
                moving.surfaces,
                camera=view.camera,
                pose=moving.poses[n],
                pixels=pixels,
            )
            room.append(int(_MORE_WEIGHTS * len(linearized.weights.row)))
    return FrameTarget(
        times=times,
        views=views,
        data=tuple(data),
        indices=tuple(indices),
        noise=noise,
        frame_quantity=frame_quantity,
        surfaces=() if moving is None else moving.surfaces,
        room=tuple(room),
    )


def _check_pixels(
    frames: Float[np.ndarray, "t h w"],
    compared: Bool[np.ndarray, "h w"],
    times: tuple[float, ...],
    limits: FrameLimits,
    where: str,
) -> None:
    """Refuse compared pixels that are not finite, or hardly are temperatures."""
    compared_values = np.where(compared, frames, np.nan)
    checked = CheckedValues(
        compared_values, symbol=limits.symbol, noun="compared pixels", times=times
    )
    bad = ~np.isfinite(frames) & compared
    if bad.any():
        raise InputError(
            f"{where}: {int(bad.sum())} compared pixels are not finite: "
            f"{checked.listed(bad)}: mask them, or repair the frames"
        )
    mistake = pixel_mistake(
        checked, limits.bounds, limits.unit, option=f"set `{ALLOW_EXTREME}: true`"
    )
    if mistake:
        raise InputError(f"{where}: {mistake}")


def check_frames(
    times: tuple[float, ...],
    views: tuple[View, ...],
    frames: list[Float[np.ndarray, "_ _ _"]],
    masks: Masks,
) -> None:
    """Refuse frames and masks that do not fit the times and cameras."""
    for n, (view, view_frames) in enumerate(zip(views, frames, strict=True)):
        width, height = view.camera.size
        if view_frames.shape[0] != len(times):
            raise InputError(
                f"view {n}: {view_frames.shape[0]} frames for {len(times)} saved times"
            )
        rows, columns = view_frames.shape[1:]
        if (rows, columns) != (height, width):
            raise InputError(
                f"view {n}: frames of {columns} x {rows} pixels and a camera of "
                f"{width} x {height}: give the camera the frames' size"
            )
        mask = masks[n] if n < len(masks) else None
        if mask is not None and mask.shape != (height, width):
            raise InputError(
                f"the mask is {mask.shape[1]} x {mask.shape[0]} pixels and the frames "
                f"{width} x {height}"
            )


def _interior(view: View, number: int, moving: FitsPoses) -> Bool[np.ndarray, "h w"]:
    """Pixels of bodies away from outlines, in the pose where the fit starts."""
    camera = moved_camera(view.camera, moving.poses[number])
    start_view = compute_view(moving.surfaces, moving.terms, camera, keep=False)
    return body_mask(start_view) & (outline_distance(start_view) > moving.margin)
