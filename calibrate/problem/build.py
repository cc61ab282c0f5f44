"""From a config to a least-squares problem: scenes, data and parameters."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from jaxthermo.accuracy.surface_error import check_surfaces
from jaxthermo.arrays import precision
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.integrate.run.solution_file import StoredSolution, load_solution
from jaxthermo.scene.scene import Scene

from ..config import schema
from ..config.frame_names import (
    REFLECTED,
    check_frame_names,
    is_of_camera,
    is_of_frames,
    pose_numbers,
)
from ..config.loader import scene_config
from ..config.schema import (
    CalibrationConfig,
    ParameterConfig,
    default_bounds,
    value_in_si,
)
from .aligned_cameras import align_cameras, started_at
from .alignment import Aligned
from .frame_data import FitsPoses, frame_target
from .frame_source import CaseFrames, FramesConfig, case_frames, start_surfaces
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
from .targets import AbstractTarget, FrameTarget, surface_target


_DEFAULT_SMOOTHNESS = 0.5
"""Standard deviation of log(weight) of a link from its neighbours' mean."""


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

    def without_cameras(self) -> Problem | None:
        """Fit of all else with the cameras where they start; None if there is none."""
        rest = [p for p in self.parameters.parameters if not is_of_camera(p.name)]
        if not rest:
            return None
        count = self.train.cases[0].target.camera_count
        start = np.zeros(self.parameters.size)
        poses = np.asarray(self.parameters.poses(start, count), float)
        cases = []
        for case in self.train.cases:
            assert isinstance(case.target, FrameTarget)
            still = case.target.without_moves(poses, case.scene.terms)
            cases.append(replace(case, target=still))
        given = tuple(cases), self.train.time_norm
        return Problem(ParameterSet(tuple(rest)), *given)

    def weighed(self, effect: float) -> "Calibration":
        """Fit in which outlines count `effect` times as much as independent data.

        Squares of alike residuals count as often as there are of them, unless all that
        is independent counts so much more.
        """
        aligned = {n: a._replace(effect=effect) for n, a in self.train.aligned.items()}
        changed = lambda problem: replace(problem, aligned=aligned)
        held_out = None if self.held_out is None else changed(self.held_out)
        return replace(self, train=changed(self.train), held_out=held_out)


def build(config: CalibrationConfig, log: Log) -> Calibration:
    """Build scenes, data and parameters.

    Cameras whose poses are fitted are aligned with the outlines of bodies in the
    frames.
    """
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

    read: dict[str, CaseFrames] = {}

    def frames(case: schema.CaseConfig) -> CaseFrames:
        # Those of the first case are asked for twice, where cameras are aligned.
        if case.name not in read:
            given = configs[case.name], scenes[case.name]
            read[case.name] = case_frames(config, case, *given, log)
        return read[case.name]

    aligned = _align(
        config,
        configs=configs,
        scenes=scenes,
        parameters=parameters,
        frames=frames,
        log=log,
    )
    parameters = started_at(parameters, aligned)
    references: dict[str, TruthReference] = {}

    def problem(cases: tuple[schema.CaseConfig, ...]) -> Problem:
        made = []
        for case in cases:
            given, scene = configs[case.name], scenes[case.name]
            run = ParametricRun(given.time.save_times, given.solver.build())
            shared = references, parameters, frames, log
            data = _TargetBuilder(config, case, given, scene, *shared)
            made.append(Case(name=case.name, scene=scene, run=run, target=data.build()))
        return Problem(
            parameters=parameters,
            cases=tuple(made),
            time_norm=config.fit.time_norm,
            aligned=aligned,
        )

    train = problem(config.train)
    held_out = problem(config.held_out) if config.held_out else None
    return Calibration(
        parameters=parameters,
        configs=configs,
        scenes=scenes,
        train=train,
        held_out=held_out,
        references=references,
    )


def _align(
    config: CalibrationConfig,
    configs: Mapping[str, SceneConfig],
    scenes: Mapping[str, Scene],
    parameters: ParameterSet,
    frames: Callable[[schema.CaseConfig], CaseFrames],
    log: Log,
) -> dict[int, Aligned]:
    """Poses of cameras by the frames of the first case."""
    reference, case = config.reference, config.train[0]
    has_frames = isinstance(reference, FramesConfig)
    if not (parameters.moves_cameras and has_frames and reference.align):
        return {}
    found = frames(case)
    check_frame_names(parameters.paths, len(found.views))
    log("aligning the cameras")
    run = ParametricRun(found.times, configs[case.name].solver.build())
    return align_cameras(found, scene=scenes[case.name], run=run, parameters=parameters)


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


def _build_parameters(config: CalibrationConfig, scene: Scene) -> ParameterSet:
    # Starts and bounds that are not given are those of the scene.
    return ParameterSet(tuple(_parameter(p, scene) for p in config.parameters))


def _parameter(given: ParameterConfig, scene: Scene) -> Parameter:
    path, values = _path_and_start(given, scene)
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


def _path_and_start(
    given: ParameterConfig, scene: Scene
) -> tuple[Path, np.ndarray | np.generic]:
    if is_of_frames(given.name):
        # The scene does not have it, nor weights of levels or links.
        if given.per is not None:
            raise InputError(f"parameter {given.name}: `per` is for weights only")
        return (), _frame_start(given)
    path = find_path(scene, given.name)
    return path, _start_values(given, path, scene)


def _frame_start(given: ParameterConfig) -> np.ndarray | np.generic:
    """Start values of a number of frames, which the scene does not have."""
    if given.name == REFLECTED:
        if given.start is None:
            raise InputError(f"parameter {given.name}: give a `start`, in kelvin")
        return np.asarray(value_in_si(given.start, given.name))[()]
    _, numbers = pose_numbers(given.name)
    if given.start is None:
        return np.zeros(len(numbers)) if len(numbers) > 1 else np.float64(0)
    is_list = isinstance(given.start, list)
    listed = given.start if is_list else [given.start]
    if len(listed) != len(numbers):
        raise InputError(f"parameter {given.name}: `start` has {len(numbers)} numbers")
    values = np.asarray([value_in_si(v, given.name) for v in listed])
    return values if len(numbers) > 1 else values[0]


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
    parameters: ParameterSet
    frames: Callable[[schema.CaseConfig], CaseFrames]
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
                case schema.SimulatedFrames() | schema.MeasuredFrames():
                    return self._compared(self.frames(self.case))

    def _surface(self, found: StoredSolution) -> AbstractTarget:
        check_surfaces(start_surfaces(self.scene), found.surfaces)
        return surface_target(found, jnp.dtype(self.scene.dtype))

    def _finer_surface(self) -> AbstractTarget:
        name = self.case.name
        assert self.config.truth is not None
        log = lambda stage: self.log(f"{name}: {stage}")
        found = refined_reference(self.given, self.config.truth, log)
        self.references[name] = found
        surface, unknown = found.read_at(start_surfaces(self.scene))
        return surface_target(surface, jnp.dtype(self.scene.dtype), unknown)

    def _compared(self, found: CaseFrames) -> FrameTarget:
        moving = None
        settings, parameters = found.settings, self.parameters
        if parameters.moves_cameras:
            start = np.zeros(parameters.size)
            poses = np.asarray(parameters.poses(start, len(found.views)), float)
            given = found.surfaces, self.scene.terms, poses
            moving = FitsPoses(*given, settings.margin)
        return frame_target(
            *(found.times, found.views, found.frames),
            *(settings.noise, settings.quantity, found.masks),
            *(jnp.dtype(self.scene.dtype), found.band),
            *(settings.reflected_temperature, moving),
        )
