"""Thermal images of a solution, differentiable in its temperatures."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ..arrays import precision
from ..errors import require
from ..integrate.run.solution import AbstractSolution
from .band import LONG_WAVE, Band
from .camera import AbstractCamera
from .detector import Detector
from .draw import draw
from .effects.effect import in_order
from .image import Image
from .view import at_time, kept_view


def render(
    solution: AbstractSolution,
    camera: AbstractCamera,
    index: int = -1,
    *,
    smooth: bool = True,
    samples: int = 1,
    occlusion: float | None = None,
    band: Band | None = LONG_WAVE,
    effects: Any = (),
) -> Image:
    """Draw the thermal image of one saved time.

    Args:
        solution: from `simulate` or `steady`.
        camera: position, direction and size of the image.
        index: index of the saved time.
        smooth: interpolate temperatures smoothly over the voxels.
        samples: radiance samples per pixel along each axis.
        occlusion: distance within which surfaces in the image hide the surroundings
            from what others reflect [m], for scenes whose terms do not detect it.
        band: of the detector, 7.5 to 14 um by default; None for the radiance of all
            wavelengths, in which the sun is as bright as it heats.
        effects: of surfaces, air, optics and detector, such as (Atmosphere(290.0),
            DetectorNoise(netd=0.05)).

    Raises:
        InputError: if the camera is inside a body or sees none, or for effects that are
            none.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> copper = jt.materials["copper"]
        >>> body = jt.Body(jt.FullVolume(grid), copper, temperature=350.0)
        >>> warm = jt.steady(jt.Scene((body,), (jt.Convection(10.0, 290.0),)))
        >>> camera = jt.Camera((0.2, -0.2, 0.1), (0.0, 0.0, 0.0), width=32, height=24)
        >>> jt.render(warm, camera).temperature.shape  # rows, columns
        (24, 32)
    """
    options = _Options(
        smooth=smooth, samples=samples, occlusion=occlusion, band=band, effects=effects
    )
    frame = _recording(solution, camera, options)
    return frame(range(len(solution.times))[index])


def frames(
    solution: AbstractSolution,
    camera: AbstractCamera,
    *,
    smooth: bool = True,
    samples: int = 1,
    occlusion: float | None = None,
    band: Band | None = LONG_WAVE,
    effects: Any = (),
) -> Iterator[Image]:
    """Draw the thermal images of all saved times, one after the other.

    The arguments are those of `render`. With a `BolometerLag` each frame is drawn once,
    while `render` draws all earlier frames that matter anew.

    Raises:
        InputError: as `render`.
    """
    options = _Options(
        smooth=smooth, samples=samples, occlusion=occlusion, band=band, effects=effects
    )
    # A mistake raises an error at once, not with the first frame.
    frame = _recording(solution, camera, options)
    return map(frame, range(len(solution.times)))


class _Options(NamedTuple):
    """Arguments of `render` and `frames` after solution and camera."""

    smooth: bool
    samples: int
    occlusion: float | None
    band: Band | None
    effects: Any


def _recording(
    solution: AbstractSolution, camera: AbstractCamera, options: _Options
) -> Callable[[int], Image]:
    """Draws frames by the index of their time."""
    solutions = "a solution of simulate or steady"
    require(
        solution, classes=AbstractSolution, argument="render(solution=)", give=solutions
    )
    cameras = "a Camera or an OrthographicCamera"
    require(camera, classes=AbstractCamera, argument="render(camera=)", give=cameras)
    band = options.band
    if band is not None:
        require(
            band,
            classes=Band,
            argument="render(band=)",
            give="a Band, such as Band((7.5e-6, 14e-6))",
        )
    effects = in_order(options.effects, "render(effects=)")

    times = np.asarray(solution.times)

    def reaching(index: int) -> Image:
        time = float(times[index])
        surfaces, terms = at_time(solution.surfaces, solution.terms, time)
        finer = camera.finer(options.samples)
        view = kept_view(
            surfaces,
            terms=terms,
            camera=finer,
            smooth=options.smooth,
            occlusion=options.occlusion,
        )
        return draw(
            view,
            surfaces=surfaces,
            terms=terms,
            temperature=jnp.asarray(solution.surface_temperature[index]),
            received=solution.irradiance(index),
            time=jnp.asarray(times[index]),
            load_time=solution.load_time(index),
            band=band,
            effects=effects,
        )

    detector = Detector(
        reaching=reaching, times=times, effects=effects, samples=options.samples
    )

    def frame(index: int) -> Image:
        with precision(solution.receipt.dtype):
            return detector.frame(index)

    return frame
