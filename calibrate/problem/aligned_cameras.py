"""Cameras of a calibration, aligned with the first case's frames before the fit."""

from dataclasses import replace

import numpy as np

from jaxthermo.arrays import precision
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.scene.scene import Scene

from ..config.frame_names import is_of_camera, pose_numbers
from .alignment import Aligned, Limits, ShownRun, align
from .frame_source import CaseFrames
from .parameters import ParameterSet


def align_cameras(
    case_frames: CaseFrames,
    scene: Scene,
    run: ParametricRun,
    parameters: ParameterSet,
) -> dict[int, Aligned]:
    """Poses of the cameras that are fitted, by their numbers, at the start values."""
    with precision(scene.dtype):
        z = np.zeros(parameters.size, scene.dtype)
        poses = parameters.start_poses(len(case_frames.views))
        warm = parameters.insert(scene, z)
        solution = run(warm, run.step_table(warm))
        frame_quantity = case_frames.frame_quantity
        reflected = parameters.frame_values(z).reflected
        if reflected is not None:
            frame_quantity = frame_quantity._replace(reflected=reflected)
        drawn = ShownRun.of(
            frame_quantity, scene=warm, solution=solution, times=case_frames.times
        )
        aligned = {}
        for number, (view, frames) in enumerate(
            zip(case_frames.views, case_frames.frames, strict=True)
        ):
            limits = _limits(parameters, number)
            if limits is None:
                continue
            mask = (
                case_frames.masks[number] if number < len(case_frames.masks) else None
            )
            # A dead pixel in the background has an outline of its own.
            is_extreme = case_frames.limits.bounds.exceeded(frames)
            aligned[number] = align(
                drawn,
                camera=view.camera,
                frames=np.where(is_extreme, np.nan, frames),
                mask=mask,
                start=poses[number],
                limits=limits,
            )
    return aligned


def _limits(parameters: ParameterSet, camera: int) -> Limits | None:
    """Fitted numbers of a camera's pose; None without any."""
    rows = []
    for p in parameters.parameters:
        if is_of_camera(p.name) and pose_numbers(p.name)[0] == camera:
            rows += [(n, p.lower, p.upper) for n in pose_numbers(p.name)[1]]
    if not rows:
        return None
    numbers, lower, upper = np.array(rows).T
    return Limits(numbers.astype(int), lower, upper)


def started_at(parameters: ParameterSet, aligned: dict[int, Aligned]) -> ParameterSet:
    """Parameters whose poses of cameras start where they were aligned."""
    started = []
    for p in parameters.parameters:
        if is_of_camera(p.name) and pose_numbers(p.name)[0] in aligned:
            camera, numbers = pose_numbers(p.name)
            start = tuple(float(aligned[camera].pose[n]) for n in numbers)
            p = replace(p, start=start)
        started.append(p)
    return ParameterSet(tuple(started))
