"""From a config to a least-squares problem: scenes, data and parameters."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from PIL import Image

from jaxthermo.arrays import precision
from jaxthermo.config.camera_framing import build_camera
from jaxthermo.config.schema.image import CameraConfig
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.image.files import read_exr
from jaxthermo.image.view import View
from jaxthermo.integrate.run.parametric_run import ParametricRun, ParametricSolution
from jaxthermo.integrate.run.solution_file import load_solution
from jaxthermo.integrate.surface_error import check_surfaces
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.scene.scene import Scene, SolvedSurface

from ..config import schema
from ..config.loader import scene_config
from ..config.schema import (
    CalibrationConfig,
    ParameterConfig,
    default_bounds,
    value_in_si,
)
from .parameter_paths import Path, find_path, value_at
from .parameters import Parameter, ParameterSet, Prior, Smoothness
from .problem import Case, Problem
from .reference import Log, full_volume_run, select_times
from .targets import AbstractTarget, surface_target
from .thermogram_targets import FrameTarget, frame_target, render_frames, view_of


_DEFAULT_SMOOTHNESS = 0.5
"""Standard deviation of log(weight) of a link from its neighbours' mean."""
_CHANNELS = {"temperature": "apparent_temperature", "radiance": "radiance"}
"""Channel of an EXR file by compared quantity."""


@dataclass
class Calibration:
    """The problem to fit, the one to validate with, and what they are made of."""

    parameters: ParameterSet
    configs: dict[str, SceneConfig]
    """Scene config of every case."""
    scenes: dict[str, Scene]
    train: Problem
    held_out: Problem | None


def build(config: CalibrationConfig, log: Log) -> Calibration:
    """Build scenes, data and parameters.

    Raises:
        InputError: for a contradiction between config, scene and data.
    """
    every = (*config.train, *config.held_out, *config.candidates)
    configs = {case.name: scene_config(config, case.set) for case in every}
    log("building the scenes")
    scenes = _build_scenes(configs)
    parameters = build_parameters(config, scenes[config.train[0].name])
    # Values and bounds come from the first case, but every case needs the paths.
    for scene in scenes.values():
        parameters.check(scene)
    targets = _TargetBuilder(config, configs, scenes, log)

    def problem(cases: tuple[schema.CaseConfig, ...]) -> Problem:
        made = []
        for case in cases:
            given = configs[case.name]
            run = ParametricRun(given.time.save_times, given.solver.build())
            target = targets.build(case)
            made.append(Case(case.name, scenes[case.name], run, target))
        return Problem(parameters, tuple(made), config.fit.time_norm)

    train = problem(config.train)
    held_out = problem(config.held_out) if config.held_out else None
    return Calibration(parameters, configs, scenes, train, held_out)


def _build_scenes(configs: Mapping[str, SceneConfig]) -> dict[str, Scene]:
    scenes: dict[str, Scene] = {}
    for name, config in configs.items():
        # Voxelize bodies that are the same in several cases once.
        same = (other for other in scenes if configs[other].bodies == config.bodies)
        first = next(same, None)
        if first is None:
            scenes[name] = config.build()
        else:
            terms = tuple(term.build() for term in config.terms)
            scenes[name] = Scene(scenes[first].bodies, terms, config.dtype)
    return scenes


def camera_views(
    cameras: tuple[CameraConfig, ...],
    scene: Scene,
    surfaces: tuple[SolvedSurface, ...] | None = None,
) -> tuple[View, ...]:
    """Views of a scene's surfaces, by default those at the start."""
    surfaces = _start_surfaces(scene) if surfaces is None else surfaces
    triangles = np.concatenate([s.geometry.triangles for s in surfaces])
    made = (build_camera(camera, triangles) for camera in cameras)
    return tuple(view_of(surfaces, scene, camera) for camera in made)


def _start_surfaces(scene: Scene) -> tuple[SolvedSurface, ...]:
    """Surfaces of the bodies at the start."""
    # Neither the number of save times nor the end has an effect on the surfaces.
    with precision(scene.dtype):
        return compile_scene(scene, 1, 1.0).surfaces


def build_parameters(config: CalibrationConfig, scene: Scene) -> ParameterSet:
    """Build the parameters, with starts and bounds from a scene where none are given.

    Raises:
        InputError: for a parameter that does not exist, or bounds that exclude its
            start.
    """
    return ParameterSet(tuple(_parameter(p, scene) for p in config.parameters))


def _parameter(given: ParameterConfig, scene: Scene) -> Parameter:
    path = find_path(scene, given.name)
    values = _start_values(given, path, scene)
    start = tuple(float(v) for v in np.atleast_1d(values))
    lower, upper = default_bounds(given.name, start[0])
    if given.bounds is not None:
        lower, upper = (value_in_si(v, given.name) for v in given.bounds)
    prior = smoothness = None
    if given.prior is not None:
        known = given.prior
        mean, sd = (value_in_si(v, given.name) for v in (known.mean, known.sd))
        prior = Prior(mean, sd, known.log_normal)
    if given.per == "link":
        links = scene.bodies[int(path[1])].structure.links()
        sd = given.smoothness or _DEFAULT_SMOOTHNESS
        smoothness = Smoothness(links.src, links.dst, sd)
    is_capacity = given.per == "level" and path[-1] == "capacity"
    return Parameter(
        name=given.name,
        start=start,
        lower=lower,
        upper=upper,
        tied=given.tied,
        prior=prior,
        softplus=given.bijection == "softplus",
        is_scalar=values.ndim == 0,
        # The body's total capacity is conserved, so that only ratios matter.
        first_is_fixed=is_capacity and len(start) > 1,
        smoothness=smoothness,
    )


def _start_values(
    given: ParameterConfig, path: Path, scene: Scene
) -> np.ndarray | np.generic:
    value = value_at(scene, path)
    if value is None or callable(value):
        raise InputError(
            f"parameter {given.name}: the scene has no number there, but {value!r}: "
            "name a part of it, or give it a number"
        )
    values = np.asarray(value, float)
    if given.start is not None:
        is_list = isinstance(given.start, list)
        listed = given.start if is_list else [given.start]
        values = np.asarray([value_in_si(v, given.name) for v in listed])
        values = values if is_list else values[0]
    if given.per is not None:
        # A scalar becomes one equal value per level or link.
        values = np.broadcast_to(values, (_value_count(given, path, scene),))
    return values


def _value_count(given: ParameterConfig, path: Path, scene: Scene) -> int:
    if path[:1] != ("bodies",) or path[2:4] != ("structure", "weights"):
        raise InputError(
            f"parameter {given.name}: `per: {given.per}` is for weights only"
        )
    structure = scene.bodies[int(path[1])].structure
    if given.per == "link":
        return structure.link_count
    # Links between levels have one value for each pair of neighbouring levels.
    levels = int(structure.nodes().level.max()) + 1
    return max(levels - 1, 1) if path[-1] == "between" else levels


@dataclass
class _TargetBuilder:
    config: CalibrationConfig
    configs: Mapping[str, SceneConfig]
    scenes: Mapping[str, Scene]
    log: Log

    def build(self, case: schema.CaseConfig) -> AbstractTarget:
        with precision(self.scenes[case.name].dtype):
            match self.config.reference:
                case schema.FullVolumeReference() as given:
                    return self._full_volume(case, given)
                case schema.SolutionReference() as given:
                    return self._solution(case.name, given)
                case schema.SimulatedFrames() as given:
                    return self._simulated(case, given)
                case schema.MeasuredFrames() as given:
                    return self._measured(case.name, given)

    def _full_volume(
        self, case: schema.CaseConfig, given: schema.FullVolumeReference
    ) -> AbstractTarget:
        truth = scene_config(self.config, case.set, given.set)
        log = lambda stage: self.log(f"{case.name}: {stage}")
        found = full_volume_run(truth, given.step, log)
        check_surfaces(_start_surfaces(self.scenes[case.name]), found.surfaces)
        return surface_target(found, self._dtype(case.name))

    def _solution(self, name: str, given: schema.SolutionReference) -> AbstractTarget:
        if name not in given.files:
            raise InputError(f"reference: files: there is none for the case {name}")
        path = given.files[name]
        times = self.configs[name].time.save_times
        found = select_times(load_solution(path), times, path)
        check_surfaces(_start_surfaces(self.scenes[name]), found.surfaces)
        return surface_target(found, self._dtype(name))

    def _simulated(
        self, case: schema.CaseConfig, given: schema.SimulatedFrames
    ) -> FrameTarget:
        truth = scene_config(self.config, case.set, given.set)
        times = truth.time.save_times
        # The truth may change anything but the times at which it is compared.
        if times != self.configs[case.name].time.save_times:
            raise InputError("reference: set: the save times are the case's")
        self.log(f"{case.name}: running the truth")
        scene = truth.build()
        frames = []
        with precision(truth.dtype):
            run = ParametricRun(times, truth.solver.build())
            solution: ParametricSolution = run(scene, run.step_table(scene))
            cameras = self._cameras(given, case.name)
            for view in camera_views(cameras, scene, solution.surfaces):
                rendered = render_frames(view, scene, solution, times, given.quantity)
                frames.append(np.asarray(rendered, float))
        if not given.noiseless:
            # The seed differs between cases, so that their noise is independent.
            noise = np.random.default_rng([given.seed, *case.name.encode()])
            frames = [f + noise.normal(0, given.noise, f.shape) for f in frames]
        return self._frame_target(case.name, given, frames, None)

    def _measured(self, name: str, given: schema.MeasuredFrames) -> FrameTarget:
        views = sorted(
            (f for f in given.frames if f.case == name), key=lambda f: f.view
        )
        if not views:
            raise InputError(f"reference: frames: there are none for the case {name}")
        channel = _CHANNELS[given.quantity]
        frames = []
        for view in views:
            rows = []
            for path in view.files:
                channels, _ = read_exr(path)
                if channel not in channels:
                    listed = ", ".join(sorted(channels))
                    raise InputError(
                        f"{path}: has no channel {channel} (it has {listed})"
                    )
                rows.append(channels[channel])
            # Frames of one view are stacked, and compared with one camera.
            if len({row.shape for row in rows}) > 1:
                raise InputError(f"{name}, view {view.view}: frames of several sizes")
            frames.append(np.stack(rows).astype(float))
        mask = None
        if given.mask is not None:
            with Image.open(given.mask) as picture:
                # Every pixel that is not black is compared.
                mask = np.asarray(picture.convert("L")) > 0
        return self._frame_target(name, given, frames, mask)

    def _frame_target(
        self,
        name: str,
        given: schema.SimulatedFrames | schema.MeasuredFrames,
        frames: list[np.ndarray],
        mask: np.ndarray | None,
    ) -> FrameTarget:
        views = camera_views(self._cameras(given, name), self.scenes[name])
        if len(views) != len(frames):
            raise InputError(
                f"{name}: {len(frames)} sequences of frames and {len(views)} views"
            )
        times, dtype = self.configs[name].time.save_times, self._dtype(name)
        noise, quantity = given.noise, given.quantity
        return frame_target(times, views, frames, noise, quantity, mask, dtype)

    def _cameras(
        self, given: schema.SimulatedFrames | schema.MeasuredFrames, name: str
    ) -> tuple[CameraConfig, ...]:
        return given.views or (self.configs[name].camera,)

    def _dtype(self, name: str) -> Any:
        return jnp.dtype(self.scenes[name].dtype)
