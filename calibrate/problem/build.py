"""From a config to a least-squares problem: scenes, data and parameters."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as FilePath

import jax.numpy as jnp
import numpy as np
from PIL import Image

from jaxthermo.arrays import precision
from jaxthermo.config.camera_framing import build_camera
from jaxthermo.config.schema.image import CameraConfig
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.image.band import Band
from jaxthermo.image.files import read_exr
from jaxthermo.image.view import View
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.integrate.run.solution_file import StoredSolution, load_solution
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
from .parameters import (
    Parameter,
    ParameterSet,
    Path,
    Prior,
    Smoothness,
    find_path,
    value_at,
)
from .problem import Case, Problem
from .reference import (
    Log,
    TruthReference,
    full_volume_run,
    read_at_surface,
    refined_reference,
)
from .targets import (
    AbstractTarget,
    FrameTarget,
    frame_target,
    render_frames,
    surface_target,
    view_of,
)


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
    references: dict[str, TruthReference]
    """Runs of finer voxels by case, of those cases that are fitted to them."""


def build(config: CalibrationConfig, log: Log) -> Calibration:
    """Build scenes, data and parameters."""
    every = (*config.train, *config.held_out, *config.candidates)
    configs = {case.name: scene_config(config, case.set) for case in every}
    log("building the scenes")
    scenes = _build_scenes(configs)
    if isinstance(config.reference, schema.TruthRuns):
        # Finer voxels have their nodes elsewhere: only the surface is common.
        scenes = {name: read_at_surface(scene) for name, scene in scenes.items()}
    parameters = _build_parameters(config, scenes[config.train[0].name])
    # Values and bounds come from the first case, but every case needs the paths.
    for scene in scenes.values():
        parameters.check(scene)

    references: dict[str, TruthReference] = {}

    def problem(cases: tuple[schema.CaseConfig, ...]) -> Problem:
        made = []
        for case in cases:
            given, scene = configs[case.name], scenes[case.name]
            run = ParametricRun(given.time.save_times, given.solver.build())
            data = _TargetBuilder(config, case, given, scene, references, log)
            made.append(Case(case.name, scene, run, data.build()))
        return Problem(parameters, tuple(made), config.fit.time_norm)

    train = problem(config.train)
    held_out = problem(config.held_out) if config.held_out else None
    return Calibration(parameters, configs, scenes, train, held_out, references)


def _build_scenes(configs: Mapping[str, SceneConfig]) -> dict[str, Scene]:
    scenes: dict[str, Scene] = {}
    for name, config in configs.items():
        # Voxelize bodies that are the same in several cases once.
        same = (other for other in scenes if configs[other].bodies == config.bodies)
        first = next(same, None)
        if first is None:
            scenes[name] = config.build()
        else:
            terms = config.build_terms()
            scenes[name] = config.scene(scenes[first].bodies, terms)
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
    # Neither the number of save times nor the end has an effect on the surfaces.
    with precision(scene.dtype):
        return compile_scene(scene, 1, 1.0).surfaces


def _build_parameters(config: CalibrationConfig, scene: Scene) -> ParameterSet:
    # Starts and bounds that are not given are those of the scene.
    return ParameterSet(tuple(_parameter(p, scene) for p in config.parameters))


def _parameter(given: ParameterConfig, scene: Scene) -> Parameter:
    path = find_path(scene, given.name)
    values = _start_values(given, path, scene)
    start = tuple(float(v) for v in np.atleast_1d(values))
    lower, upper = default_bounds(given.name, start[0])
    if given.bounds is not None:
        lower, upper = (value_in_si(v, given.name) for v in given.bounds)
    prior = None if given.prior is None else _prior(given.prior, given.name)
    smoothness = None
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


def _prior(given: schema.PriorConfig, name: str) -> Prior:
    mean, sd = (value_in_si(value, name) for value in (given.mean, given.sd))
    return Prior(mean, sd, given.log_normal)


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
    # The data of one case, from the reference that the config names.
    config: CalibrationConfig
    case: schema.CaseConfig
    given: SceneConfig
    scene: Scene
    references: dict[str, TruthReference]
    log: Log

    def build(self) -> AbstractTarget:
        name, times = self.case.name, self.given.time.save_times
        with precision(self.scene.dtype):
            match self.config.reference:
                case schema.FullVolumeReference() as reference:
                    truth = scene_config(self.config, self.case.set, reference.set)
                    log = lambda stage: self.log(f"{name}: {stage}")
                    return self._surface(full_volume_run(truth, reference.step, log))
                case schema.TruthRuns():
                    return self._finer_surface()
                case schema.SolutionReference(files=files):
                    if name not in files:
                        text = "reference: files: there is none for the case"
                        raise InputError(f"{text} {name}")
                    path = files[name]
                    found = load_solution(path).at_times(times, path)
                    return self._surface(found)
                case schema.SimulatedFrames() as reference:
                    return self._frames(reference, self._simulated(reference), None)
                case schema.MeasuredFrames() as reference:
                    frames = _measured(name, reference)
                    return self._frames(reference, frames, _read_mask(reference.mask))

    def _surface(self, found: StoredSolution) -> AbstractTarget:
        check_surfaces(_start_surfaces(self.scene), found.surfaces)
        return surface_target(found, jnp.dtype(self.scene.dtype))

    def _finer_surface(self) -> AbstractTarget:
        name = self.case.name
        assert self.config.truth is not None
        log = lambda stage: self.log(f"{name}: {stage}")
        found = refined_reference(self.given, self.config.truth, log)
        self.references[name] = found
        surface, unknown = found.read_at(_start_surfaces(self.scene))
        return surface_target(surface, jnp.dtype(self.scene.dtype), unknown)

    def _simulated(self, given: schema.SimulatedFrames) -> list[np.ndarray]:
        truth = scene_config(self.config, self.case.set, given.set)
        times = truth.time.save_times
        # The truth may change anything but the times at which it is compared.
        if times != self.given.time.save_times:
            raise InputError("reference: set: the save times are the case's")
        self.log(f"{self.case.name}: running the truth")
        scene = truth.build()
        with precision(truth.dtype):
            run = ParametricRun(times, truth.solver.build())
            solution = run(scene, run.step_table(scene))
            cameras = given.views or (self.given.camera,)
            views = camera_views(cameras, scene, solution.surfaces)
            shown = scene, solution, times, given.quantity, self._band
            frames = [np.asarray(render_frames(v, *shown), float) for v in views]
        if given.noiseless:
            return frames
        # The seed differs between cases, so that their noise is independent.
        noise = np.random.default_rng([given.seed, *self.case.name.encode()])
        return [f + noise.normal(0, given.noise, f.shape) for f in frames]

    def _frames(
        self,
        given: schema.SimulatedFrames | schema.MeasuredFrames,
        frames: list[np.ndarray],
        mask: np.ndarray | None,
    ) -> FrameTarget:
        views = camera_views(given.views or (self.given.camera,), self.scene)
        if len(views) != len(frames):
            raise InputError(
                f"{self.case.name}: {len(frames)} sequences of frames and "
                f"{len(views)} views"
            )
        times, dtype = self.given.time.save_times, jnp.dtype(self.scene.dtype)
        noise, quantity, band = given.noise, given.quantity, self._band
        return frame_target(times, views, frames, noise, quantity, mask, dtype, band)

    @property
    def _band(self) -> Band | None:
        """Band of the case's detector."""
        band = self.given.image.band
        return None if band is None else band.build()


def _measured(name: str, given: schema.MeasuredFrames) -> list[np.ndarray]:
    views = sorted((f for f in given.frames if f.case == name), key=lambda f: f.view)
    if not views:
        raise InputError(f"reference: frames: there are none for the case {name}")
    return [_read_frames(view, _CHANNELS[given.quantity]) for view in views]


def _read_frames(view: schema.FramesOfCase, channel: str) -> np.ndarray:
    rows = []
    for path in view.files:
        channels, _ = read_exr(path)
        if channel not in channels:
            listed = ", ".join(sorted(channels))
            raise InputError(f"{path}: has no channel {channel} (it has {listed})")
        rows.append(channels[channel])
    # Frames of one view are stacked, and compared with one camera.
    if len({row.shape for row in rows}) > 1:
        raise InputError(f"{view.case}, view {view.view}: frames of several sizes")
    return np.stack(rows).astype(float)


def _read_mask(path: FilePath | None) -> np.ndarray | None:
    if path is None:
        return None
    with Image.open(path) as picture:
        # Every pixel that is not black is compared.
        return np.asarray(picture.convert("L")) > 0
