"""From a config to a problem: scenes, references or frames, and parameters."""

from collections.abc import Mapping
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
from jaxthermo.integrate.run.parametric_run import Answer, Response
from jaxthermo.integrate.run.solution_file import load_solution
from jaxthermo.integrate.surface_error import check_surfaces
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.scene.scene import Scene
from jaxthermo.scene.solved_surface import SolvedSurface

from ..config import schema
from ..config.loader import scene_config
from ..config.schema import CalibrationConfig, CaseConfig, ParameterConfig
from .parameter_paths import find, get
from .parameter_units import default_bounds, value_in_si
from .parameters import Parameter, ParameterSet, Prior, Smoothness
from .problem import Case, Problem
from .reference import Doing, check_reference, full_volume_run
from .targets import AbstractTarget, surface_target
from .thermogram_targets import FrameTarget, frame_target, frames_of, see


Views = tuple[View, ...]

SMOOTH = 0.5
"""Of the logarithm of a link's weight beside its neighbours', by default."""

CHANNELS = {"temperature": "apparent_temperature", "radiance": "radiance"}
"""Of an EXR file, by what is compared."""


class Built:
    """A calibration's problems: one to fit, one to check."""

    def __init__(
        self,
        parameters: ParameterSet,
        configs: dict[str, SceneConfig],
        scenes: dict[str, Scene],
        config: CalibrationConfig,
        doing: Doing,
    ):
        """Makes the data of what is fitted and of what is held out."""
        self.parameters, self.configs = parameters, configs
        self.scenes, self._worst = scenes, config.fit.worst
        self._maker = TargetMaker(config, configs, scenes, doing)
        self.train = self.problem(tuple(c.name for c in config.train))
        held = tuple(case.name for case in config.held_out)
        self.held_out = self.problem(held) if held else None

    def problem(self, names: tuple[str, ...]) -> Problem:
        """Of some of the cases.

        Args:
            names: of the cases.
        """
        cases = tuple(
            Case(
                name,
                self.scenes[name],
                _response(self.configs[name]),
                self._maker.target(name),
            )
            for name in names
        )
        return Problem(self.parameters, cases, self._worst)

    def views(self, cameras: tuple[CameraConfig, ...], scene: Scene) -> Views:
        """What cameras see of a scene's bodies."""
        return views(cameras, scene, surfaces_of(scene))


def surfaces_of(scene: Scene) -> tuple[SolvedSurface, ...]:
    """Of its bodies, where they are at the start."""
    with precision(scene.dtype):
        return compile_scene(scene, 1, 1.0).surfaces


def views(
    cameras: tuple[CameraConfig, ...],
    scene: Scene,
    surfaces: tuple[SolvedSurface, ...],
) -> Views:
    """What cameras see of surfaces in a scene."""
    triangles = np.concatenate([s.geometry.triangles for s in surfaces])
    made = (build_camera(camera, triangles) for camera in cameras)
    return tuple(see(surfaces, scene, camera) for camera in made)


def build(config: CalibrationConfig, doing: Doing) -> Built:
    """Scenes, their data, and the parameters.

    Args:
        config: of the calibration.
        doing: is told what takes a while.

    Raises:
        InputError: for a mistake between config, scene and data.
    """
    configs = case_configs(config)
    doing("building the scenes")
    scenes = _scenes(configs)
    first = scenes[config.train[0].name]
    parameters = build_parameters(config, first)
    for scene in scenes.values():
        parameters.check(scene)
    return Built(parameters, configs, scenes, config, doing)


def case_configs(config: CalibrationConfig) -> dict[str, SceneConfig]:
    """The config of every case's scene, by its name."""
    every = (*config.train, *config.held_out, *config.further)
    return {case.name: scene_config(config, case.set) for case in every}


def _scenes(configs: Mapping[str, SceneConfig]) -> dict[str, Scene]:
    """Bodies that are the same in all cases are voxelized once."""
    found: dict[str, Scene] = {}
    made: list[tuple[SceneConfig, Scene]] = []
    for name, config in configs.items():
        same = next((s for c, s in made if c.bodies == config.bodies), None)
        if same is None:
            found[name] = config.build()
            made.append((config, found[name]))
            continue
        terms = tuple(term.build() for term in config.terms)
        found[name] = Scene(same.bodies, terms, config.dtype)
    return found


def _response(config: SceneConfig) -> Response:
    return Response(config.time.save_times, config.solver.build())


def build_parameters(config: CalibrationConfig, scene: Scene) -> ParameterSet:
    """What is fitted, with starts and bounds from the scene where none are given.

    Args:
        config: of the calibration.
        scene: of one of its cases.

    Raises:
        InputError: for a parameter that does not exist, or bounds that exclude its
            start.
    """
    made = tuple(_parameter(each, scene) for each in config.parameters)
    return ParameterSet(made)


def _parameter(given: ParameterConfig, scene: Scene) -> Parameter:
    path = find(scene, given.name)
    inside = np.asarray(_number(get(scene, path), given.name), float)
    if given.start is not None:
        listed = given.start if isinstance(given.start, list) else [given.start]
        inside = np.asarray([value_in_si(v, given.name) for v in listed])
        inside = inside if isinstance(given.start, list) else inside[0]
    if given.each is not None:
        inside = np.broadcast_to(inside, (_count(given, path, scene),))
    start = tuple(float(v) for v in np.atleast_1d(inside))
    lower, upper = default_bounds(given.name, start[0])
    if given.bounds is not None:
        lower, upper = (value_in_si(v, given.name) for v in given.bounds)
    prior = None
    if given.prior is not None:
        mean, sd = (
            value_in_si(v, given.name) for v in (given.prior.mean, given.prior.sd)
        )
        prior = Prior(mean, sd, given.prior.of_logarithm)
    by_level = given.each == "level" and path[-1] == "capacity"
    return Parameter(
        name=given.name,
        start=start,
        lower=lower,
        upper=upper,
        also=given.also,
        prior=prior,
        soft=given.bijection == "softplus",
        is_scalar=inside.ndim == 0,
        # The total capacity is the body's, so that only ratios count.
        anchored=by_level and len(start) > 1,
        smoothness=_smoothness(given, path, scene),
    )


def _smoothness(given: ParameterConfig, path: tuple, scene: Scene) -> Any:
    if given.each != "link":
        return None
    links = scene.bodies[int(path[1])].structure.links()
    return Smoothness(links.src, links.dst, given.smoothness or SMOOTH)


def _number(value: Any, name: str) -> Any:
    if value is None or callable(value):
        raise InputError(
            f"parameter {name}: the scene has no number there, but {value!r}: name a "
            "part of it, or give it a number"
        )
    return value


def _count(given: ParameterConfig, path: tuple, scene: Scene) -> int:
    """Values of a list, one a level or a link of the structure."""
    if path[:1] != ("bodies",) or path[2:4] != ("structure", "weights"):
        raise InputError(
            f"parameter {given.name}: `each: {given.each}` is for weights only"
        )
    structure = scene.bodies[int(path[1])].structure
    if given.each == "link":
        return structure.link_count
    levels = int(structure.nodes().level.max()) + 1
    return max(levels - 1, 1) if path[-1] == "between" else levels


class TargetMaker:
    """Data of the cases, whatever they are."""

    def __init__(
        self,
        config: CalibrationConfig,
        configs: Mapping[str, SceneConfig],
        scenes: Mapping[str, Scene],
        doing: Doing,
    ):
        """Nothing is run or read yet."""
        self.config, self.configs = config, configs
        self.scenes, self.doing = scenes, doing

    def target(self, name: str) -> AbstractTarget:
        """Of one case."""
        with precision(self.scenes[name].dtype):
            return self._made(name)

    def _made(self, name: str) -> AbstractTarget:
        match self.config.reference:
            case schema.FullVolumeReference() as given:
                return self._full_volume(name, given)
            case schema.SolutionReference() as given:
                return self._solution(name, given)
            case schema.SimulatedFrames() as given:
                return self._simulated(name, given)
            case schema.MeasuredFrames() as given:
                return self._measured(name, given)

    def _full_volume(self, name: str, given) -> AbstractTarget:
        truth = scene_config(self.config, self._case(name).set, given.set)
        found = full_volume_run(
            truth, given.step, lambda what: self.doing(f"{name}: {what}")
        )
        check_surfaces(surfaces_of(self.scenes[name]), found.surfaces)
        return surface_target(found, self._dtype(name))

    def _solution(self, name: str, given) -> AbstractTarget:
        if name not in given.files:
            raise InputError(f"reference: files: there is none for the case {name}")
        path = given.files[name]
        times = self.configs[name].time.save_times
        found = check_reference(load_solution(path), times, path)
        check_surfaces(surfaces_of(self.scenes[name]), found.surfaces)
        return surface_target(found, self._dtype(name))

    def _simulated(self, name: str, given) -> FrameTarget:
        truth = scene_config(self.config, self._case(name).set, given.set)
        if truth.time.save_times != self.configs[name].time.save_times:
            raise InputError("reference: set: the save times are the case's")
        self.doing(f"{name}: running the truth")
        scene = truth.build()
        times = truth.time.save_times
        frames = []
        with precision(truth.dtype):
            response = Response(times, truth.solver.build())
            answer: Answer = response(scene, response.layout(scene))
            for view in views(self._cameras(given, name), scene, answer.surfaces):
                seen = frames_of(view, scene, answer, times, given.quantity)
                frames.append(np.asarray(seen, float))
        if not given.noiseless:
            key = [given.seed, *name.encode()]
            noise = np.random.default_rng(key)
            frames = [f + noise.normal(0, given.noise, f.shape) for f in frames]
        return self._frames(name, given, frames, None)

    def _measured(self, name: str, given) -> FrameTarget:
        own = sorted((f for f in given.frames if f.case == name), key=lambda f: f.view)
        if not own:
            raise InputError(f"reference: frames: there are none for the case {name}")
        channel = CHANNELS[given.quantity]
        frames = []
        for each in own:
            rows = []
            for path in each.files:
                channels, _ = read_exr(path)
                if channel not in channels:
                    raise InputError(
                        f"{path}: has no channel {channel} (it has "
                        f"{', '.join(sorted(channels))})"
                    )
                rows.append(channels[channel])
            if len({row.shape for row in rows}) > 1:
                raise InputError(f"{name}, view {each.view}: frames of several sizes")
            frames.append(np.stack(rows).astype(float))
        mask = None
        if given.mask is not None:
            with Image.open(given.mask) as picture:
                mask = np.asarray(picture.convert("L")) > 0
        return self._frames(name, given, frames, mask)

    def _frames(self, name: str, given, frames, mask) -> FrameTarget:
        scene = self.scenes[name]
        seen = views(self._cameras(given, name), scene, surfaces_of(scene))
        if len(seen) != len(frames):
            raise InputError(
                f"{name}: {len(frames)} sequences of frames and {len(seen)} views"
            )
        masks = []
        for frame in frames:
            if mask is not None and mask.shape != frame.shape[1:]:
                raise InputError(
                    f"the mask is {mask.shape[1]} x {mask.shape[0]} pixels and the "
                    f"frames {frame.shape[2]} x {frame.shape[1]}"
                )
            masks.append(np.ones(frame.shape[1:], bool) if mask is None else mask)
        return frame_target(
            self.configs[name].time.save_times,
            seen,
            frames,
            given.noise,
            given.quantity,
            masks,
            self._dtype(name),
        )

    def _cameras(self, given, name: str) -> tuple[CameraConfig, ...]:
        return given.views or (self.configs[name].camera,)

    def _case(self, name: str) -> CaseConfig:
        every = (*self.config.train, *self.config.held_out, *self.config.further)
        return next(case for case in every if case.name == name)

    def _dtype(self, name: str) -> Any:
        return jnp.dtype(self.scenes[name].dtype)
