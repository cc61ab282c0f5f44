"""Frames of a case, simulated or from files, and the views of their cameras."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxthermo.arrays import precision
from jaxthermo.config.camera_framing import camera_on
from jaxthermo.config.schema.image import CameraConfig
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.config.types.model import build
from jaxthermo.errors import InputError
from jaxthermo.image.pose.coverage import coverage
from jaxthermo.image.radiance.band import apparent_temperature
from jaxthermo.image.radiance.image import block_means
from jaxthermo.image.surface.abstract_camera import AbstractCamera
from jaxthermo.image.surface.view import View, compute_view
from jaxthermo.image.surface.visible import world_meshes
from jaxthermo.integrate.run.parametric_run import ParametricSolution
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.scene.scene import Scene, SolvedSurface

from ..config import schema
from ..config.frame_names import is_of_camera
from ..config.loader import scene_config
from ..config.schema import CalibrationConfig, FramesConfig
from .case_run import case_run
from .frame_data import FrameLimits, Masks, check_frames, frame_limits
from .frame_files import check_stated, read_measured
from .frame_quantity import FrameQuantity


class CaseFrames(NamedTuple):
    """Frames of one case."""

    settings: FramesConfig
    times: tuple[float, ...]
    """[s]"""
    views: tuple[View, ...]
    """Views of the cameras as given."""
    surfaces: tuple[SolvedSurface, ...]
    frames: list[Float[np.ndarray, "_ _ _"]]
    """Frames of each view, [time, row, column] [K or W/(m^2 sr)]."""
    masks: Masks
    frame_quantity: FrameQuantity
    """Quantity of the frames, in a band."""
    limits: FrameLimits
    """Limits of the compared pixels."""


def case_frames(
    config: CalibrationConfig,
    case: schema.CaseConfig,
    case_scene: SceneConfig,
    scene: Scene,
    log: Callable[[str], None],
) -> CaseFrames:
    """Frames that the reference of a calibration gives for a case.

    Raises:
        InputError: if there are none, or they do not fit cameras, masks or times.
    """
    settings = config.reference
    if not isinstance(settings, schema.SimulatedFrames | schema.MeasuredFrames):
        raise AssertionError(f"no frames in {settings.kind}")
    times = case_scene.time.save_times
    if case_scene.image.effects:
        raise InputError(
            f"{case.name}: image.effects: frames of a calibration are compared without "
            "effects of the camera: leave them out"
        )
    frame_quantity = FrameQuantity(
        quantity=settings.quantity,
        band=build(case_scene.image.band),
        reflected=settings.reflected_temperature,
    )
    with precision(scene.dtype):
        surfaces = start_surfaces(scene)
        unit = None
        if isinstance(settings, schema.SimulatedFrames):
            frames, masks = _simulated(
                config,
                case=case,
                case_scene=case_scene,
                settings=settings,
                frame_quantity=frame_quantity,
                log=log,
            )
        else:
            unit = settings.linear_unit
            frames, masks, stated = read_measured(
                case.name,
                settings,
                frame_quantity,
                allow_extreme_temperatures=scene.allow_extreme_temperatures,
            )
            check_stated(
                stated,
                surfaces=surfaces,
                terms=scene.terms,
                settings=settings,
                fitted=tuple(n for p in config.parameters for n in (p.name, *p.tied)),
            )
        views = camera_views(settings.views or (case_scene.camera,), scene, surfaces)
    if len(views) != len(frames):
        raise InputError(
            f"{case.name}: {len(frames)} sequences of frames and {len(views)} views"
        )
    check_frames(times, views=views, frames=frames, masks=masks)
    return CaseFrames(
        settings=settings,
        times=times,
        views=views,
        surfaces=surfaces,
        frames=frames,
        masks=masks,
        frame_quantity=frame_quantity,
        limits=frame_limits(frame_quantity, unit, scene.allow_extreme_temperatures),
    )


def camera_views(
    cameras: tuple[CameraConfig, ...],
    scene: Scene,
    surfaces: tuple[SolvedSurface, ...] | None = None,
) -> tuple[View, ...]:
    """Views of a scene's surfaces, by default those at the start."""
    surfaces = start_surfaces(scene) if surfaces is None else surfaces
    built_cameras = [camera_on(camera, surfaces) for camera in cameras]
    return tuple(
        compute_view(surfaces, scene.terms, camera) for camera in built_cameras
    )


def start_surfaces(scene: Scene) -> tuple[SolvedSurface, ...]:
    """Surfaces of a scene's bodies at the start."""
    # Neither the number of save times nor the end has an effect on the surfaces.
    with precision(scene.dtype):
        return compile_scene(scene, 1, 1.0).surfaces


def _simulated(
    config: CalibrationConfig,
    case: schema.CaseConfig,
    case_scene: SceneConfig,
    settings: schema.SimulatedFrames,
    frame_quantity: FrameQuantity,
    log: Callable[[str], None],
) -> tuple[list[np.ndarray], Masks]:
    truth = scene_config(config, case.set, settings.set)
    times = truth.time.save_times
    # The truth may change anything but the times at which it is compared.
    if times != case_scene.time.save_times:
        raise InputError("reference: set: the save times are the case's")
    log(f"{case.name}: running the truth")
    scene = truth.build()
    with precision(truth.dtype):
        run = case_run(truth, scene)
        solution = run(scene, run.step_table(scene))
        cameras = settings.views or (case_scene.camera,)
        built_cameras = [camera_on(camera, solution.surfaces) for camera in cameras]
        frames = [
            _detected(
                camera,
                scene=scene,
                solution=solution,
                times=times,
                samples=settings.samples,
                frame_quantity=frame_quantity,
            )
            for camera in built_cameras
        ]
        masks = _unmixed_pixels(
            config, cameras=built_cameras, solution=solution, samples=settings.samples
        )
    if settings.noiseless:
        return frames, masks
    # The seed differs between cases, so that their noise is independent.
    noise = np.random.default_rng([settings.seed, *case.name.encode()])
    return [f + noise.normal(0, settings.noise, f.shape) for f in frames], masks


def _detected(
    camera: AbstractCamera,
    scene: Scene,
    solution: ParametricSolution,
    times: tuple[float, ...],
    samples: int,
    frame_quantity: FrameQuantity,
) -> Float[np.ndarray, "_ _ _"]:
    """Frames of a detector whose pixels see the mean radiance of several rays."""
    view = compute_view(solution.surfaces, scene.terms, camera.finer(samples))
    rays = (
        frame_quantity if samples == 1 else frame_quantity._replace(quantity="radiance")
    )
    fine = np.asarray(rays.frames(view, scene, solution=solution, times=times), float)
    if samples == 1:
        return fine
    radiance = np.stack([np.asarray(block_means(frame, samples)) for frame in fine])
    if frame_quantity.quantity == "radiance":
        return radiance
    return np.asarray(apparent_temperature(radiance, frame_quantity.band), float)


def _unmixed_pixels(
    config: CalibrationConfig,
    cameras: list[AbstractCamera],
    solution: ParametricSolution,
    samples: int,
) -> Masks:
    """Pixels that are not mixed of body and background, which one ray cannot model.

    Where poses are fitted those near outlines are left out anyway, by `margin`, but
    tell where the outlines are.
    """
    if samples == 1 or any(is_of_camera(p.name) for p in config.parameters):
        return ()
    bodies = world_meshes(solution.surfaces)
    covered = (coverage(bodies, camera, samples).fraction for camera in cameras)
    return [np.asarray(fraction == 1) for fraction in covered]
