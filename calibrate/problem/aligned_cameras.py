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
    found: CaseFrames,
    scene: Scene,
    run: ParametricRun,
    parameters: ParameterSet,
) -> dict[int, Aligned]:
    """Poses of the cameras that are fitted, by their numbers, at the start values."""
    with precision(scene.dtype):
        z = np.zeros(parameters.size, scene.dtype)
        poses = np.asarray(parameters.poses(z, len(found.views)), float)
        warm = parameters.insert(scene, z)
        solution = run(warm, run.step_table(warm))
        reflected = parameters.frame_values(z).reflected
        if reflected is None:
            reflected = found.settings.reflected_temperature
        quantity = found.settings.quantity
        shown = warm, solution, found.times, quantity, found.band, reflected
        drawn, aligned = ShownRun.of(*shown), {}
        for number, (view, frames) in enumerate(
            zip(found.views, found.frames, strict=True)
        ):
            limits = _limits(parameters, number)
            if limits is None:
                continue
            mask = found.masks[number] if number < len(found.masks) else None
            given = drawn, view.camera, frames, mask, poses[number], limits
            aligned[number] = align(*given)
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
    made = []
    for p in parameters.parameters:
        if is_of_camera(p.name) and pose_numbers(p.name)[0] in aligned:
            camera, numbers = pose_numbers(p.name)
            start = tuple(float(aligned[camera].pose[n]) for n in numbers)
            p = replace(p, start=start)
        made.append(p)
    return ParameterSet(tuple(made))
