"""Thermal images of a solution, differentiable in its temperatures."""

from collections.abc import Callable, Iterator
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..arrays import precision
from ..errors import require
from ..integrate.run.solution import AbstractSolution
from .detector.recorder import Moment, Recorder
from .radiance.band import LONG_WAVE, Band
from .radiance.effect import in_order
from .radiance.image import Image
from .surface.camera import AbstractCamera


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
    frame = _frames_of(
        solution,
        camera=camera,
        band=band,
        effects=effects,
        samples=samples,
        smooth=smooth,
        occlusion=occlusion,
    )
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
    # A mistake raises an error at once, not with the first frame.
    frame = _frames_of(
        solution,
        camera=camera,
        band=band,
        effects=effects,
        samples=samples,
        smooth=smooth,
        occlusion=occlusion,
    )
    return map(frame, range(len(solution.times)))


def _frames_of(
    solution: AbstractSolution,
    camera: AbstractCamera,
    band: Band | None,
    effects: Any,
    samples: int,
    smooth: bool,
    occlusion: float | None,
) -> Callable[[int], Image]:
    """Draws frames of a solution by the index of their time."""
    solutions = "a solution of simulate or steady"
    require(
        solution, classes=AbstractSolution, argument="render(solution=)", give=solutions
    )
    cameras = "a Camera or an OrthographicCamera"
    require(camera, classes=AbstractCamera, argument="render(camera=)", give=cameras)
    if band is not None:
        bands = "a Band, such as Band((7.5e-6, 14e-6))"
        require(band, classes=Band, argument="render(band=)", give=bands)
    recorder = Recorder(
        camera,
        band=band,
        effects=in_order(effects, "render(effects=)"),
        samples=samples,
        smooth=smooth,
        occlusion=occlusion,
    )
    times = np.asarray(solution.times)

    def moment(index: int) -> Moment:
        return Moment(
            surfaces=solution.surfaces,
            terms=solution.terms,
            temperature=jnp.asarray(solution.surface_temperature[index]),
            received=solution.irradiance(index),
            time=times[index],
            load_time=solution.load_time(index),
        )

    recording = recorder.recording(moment, times)

    def frame(index: int) -> Image:
        with precision(solution.receipt.dtype):
            return recording.frame(index)

    return frame
