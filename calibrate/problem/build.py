"""From a config to a least-squares problem: scenes, data and parameters."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxthermo.accuracy.surface_error import check_surfaces
from jaxthermo.arrays import precision
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.config.types.quantities import NUMBER, to_si
from jaxthermo.errors import InputError, located
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.integrate.run.solution_file import load_solution
from jaxthermo.scene.dimensionless_groups import scene_numbers
from jaxthermo.scene.scene import Scene

from ..config import schema
from ..config.fit_record import Group
from ..config.frame_names import (
    REFLECTED,
    check_frame_names,
    is_of_camera,
    is_of_frames,
    pose_numbers,
)
from ..config.loader import scene_config
from ..config.scales import usable_start
from ..config.schema import (
    CalibrationConfig,
    FramesConfig,
    ParameterConfig,
    default_bounds,
    deviation_in_si,
    value_in_si,
)
from .aligned_cameras import align_cameras, started_at
from .alignment import Aligned
from .case_run import case_run
from .frame_data import FitsPoses, frame_target
from .frame_source import CaseFrames, case_frames, start_surfaces
from .parameters import (
    Parameter,
    ParameterSet,
    Path,
    Prior,
    Smoothness,
    find_paths,
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
    """The problem to fit, that of the validation, and their scenes and references."""

    parameters: ParameterSet
    configs: dict[str, SceneConfig]
    """Scene config of every case."""
    scenes: dict[str, Scene]
    train: Problem
    held_out: Problem | None
    references: dict[str, TruthReference]
    """Runs of finer voxels by the name of the case, where cases are fitted to them."""

    @property
    def problems(self) -> dict[Group, Problem]:
        """Problems by the group of their cases."""
        problems: dict[Group, Problem] = {"train": self.train}
        if self.held_out is not None:
            problems["held_out"] = self.held_out
        return problems

    def scene_at(self, name: str, z: Float[np.ndarray, " p"]) -> Scene:
        """Scene of a case with the values of the coordinates z."""
        with precision(self.train.dtype.name):
            values = jnp.asarray(z, self.train.dtype)
            return self.parameters.insert(self.scenes[name], values)

    def numbers(self, problem: Problem) -> list[dict[str, float]]:
        """Dimensionless numbers of a problem's cases."""
        ends = {name: config.time.last for name, config in self.configs.items()}
        return [scene_numbers(case.scene, ends[case.name]) for case in problem.cases]

    def without_cameras(self) -> Problem | None:
        """Problem of all other parameters with still cameras; None without any."""
        parameters = [p for p in self.parameters.parameters if not is_of_camera(p.name)]
        if not parameters:
            return None
        count = self.train.cases[0].target.camera_count
        poses = self.parameters.start_poses(count)
        cases = []
        for case in self.train.cases:
            assert isinstance(case.target, FrameTarget)
            still = case.target.without_moves(poses, case.scene.terms)
            cases.append(replace(case, target=still))
        return Problem(
            ParameterSet(tuple(parameters)),
            cases=tuple(cases),
            time_norm=self.train.time_norm,
        )

    def weighed(self, effect: float) -> "Calibration":
        """Calibration whose outlines count `effect` times as much.

        Residuals that are alike count as often as there are of them; independent data
        count that much more in return.
        """
        aligned = {n: a._replace(effect=effect) for n, a in self.train.aligned.items()}
        held_out = self.held_out
        if held_out is not None:
            held_out = replace(held_out, aligned=aligned)
        train = replace(self.train, aligned=aligned)
        return replace(self, train=train, held_out=held_out)


def build(config: CalibrationConfig, log: Log) -> Calibration:
    """Build scenes, data and parameters.

    Cameras whose poses are fitted are aligned with the outlines of bodies in the
    frames.
    """
    return _Builder(config, log).build()


class _Builder:
    # Frames, references and the run of a case are made once, at their first use.
    def __init__(self, config: CalibrationConfig, log: Log):
        cases = (*config.train, *config.held_out, *config.candidates)
        self.config = config
        self.log = log
        self.configs = {case.name: scene_config(config, case.set) for case in cases}
        log("building the scenes")
        self.scenes = _build_scenes(self.configs)
        if isinstance(config.reference, schema.TruthRuns):
            # Finer voxels have their nodes elsewhere: only the surface is common.
            self.scenes = {n: read_at_surface(s) for n, s in self.scenes.items()}
        self.parameters = _build_parameters(config, self.scenes[config.train[0].name])
        # Values and bounds come from the first case, but every case needs the paths.
        for scene in self.scenes.values():
            self.parameters.check(scene)
        self.references: dict[str, TruthReference] = {}
        self.read_frames: dict[str, CaseFrames] = {}
        self.runs: dict[str, ParametricRun] = {}

    def build(self) -> Calibration:
        config = self.config
        aligned = self.align()
        self.parameters = started_at(self.parameters, aligned)
        train = self.problem(config.train, aligned)
        held_out = self.problem(config.held_out, aligned) if config.held_out else None
        return Calibration(
            parameters=self.parameters,
            configs=self.configs,
            scenes=self.scenes,
            train=train,
            held_out=held_out,
            references=self.references,
        )

    def align(self) -> dict[int, Aligned]:
        """Poses of cameras by the frames of the first case."""
        reference = self.config.reference
        case = self.config.train[0]
        has_frames = isinstance(reference, FramesConfig)
        if not (self.parameters.moves_cameras and has_frames and reference.align):
            return {}
        frames = self.frames(case)
        check_frame_names(self.parameters.paths, len(frames.views))
        self.log("aligning the cameras")
        return align_cameras(
            frames,
            scene=self.scenes[case.name],
            run=self.run(case),
            parameters=self.parameters,
        )

    def problem(
        self, cases: tuple[schema.CaseConfig, ...], aligned: Mapping[int, Aligned]
    ) -> Problem:
        built_cases = [
            Case(
                name=case.name,
                scene=self.scenes[case.name],
                run=self.run(case),
                target=self.target(case),
            )
            for case in cases
        ]
        return Problem(
            parameters=self.parameters,
            cases=tuple(built_cases),
            time_norm=self.config.fit.time_norm,
            aligned=aligned,
        )

    def run(self, case: schema.CaseConfig) -> ParametricRun:
        name = case.name
        if name not in self.runs:
            self.runs[name] = case_run(self.configs[name], self.scenes[name])
        return self.runs[name]

    def frames(self, case: schema.CaseConfig) -> CaseFrames:
        if case.name not in self.read_frames:
            self.read_frames[case.name] = case_frames(
                self.config,
                case=case,
                case_scene=self.configs[case.name],
                scene=self.scenes[case.name],
                log=self.log,
            )
        return self.read_frames[case.name]

    def target(self, case: schema.CaseConfig) -> AbstractTarget:
        """Data of a case, from the reference that the config names."""
        config = self.configs[case.name]
        scene = self.scenes[case.name]

        def announce(stage: str) -> None:
            self.log(f"{case.name}: {stage}")

        with precision(scene.dtype):
            match self.config.reference:
                case schema.FullVolumeReference() as reference:
                    truth = scene_config(self.config, case.set, reference.set)
                    solution = full_volume_run(truth, step=reference.step, log=announce)
                    return _surface(scene, solution)
                case schema.TruthRuns():
                    assert self.config.truth is not None
                    finer = refined_reference(
                        config, settings=self.config.truth, log=announce
                    )
                    self.references[case.name] = finer
                    solution, unknown = finer.read_at(start_surfaces(scene))
                    dtype = jnp.dtype(scene.dtype)
                    return surface_target(solution, dtype=dtype, unknown=unknown)
                case schema.SolutionReference(files=files):
                    if case.name not in files:
                        text = "reference: files: there is none for the case"
                        raise InputError(f"{text} {case.name}")
                    path = files[case.name]
                    stored = load_solution(path)
                    times = config.time.save_times
                    return _surface(scene, stored.at_times(times, path))
                case schema.SimulatedFrames() | schema.MeasuredFrames():
                    with located(case.name):
                        return self.compared(self.frames(case), scene)

    def compared(self, frames: CaseFrames, scene: Scene) -> FrameTarget:
        """Frames as data, away from outlines where poses are fitted."""
        moving = None
        settings = frames.settings
        if self.parameters.moves_cameras:
            moving = FitsPoses(
                surfaces=frames.surfaces,
                terms=scene.terms,
                poses=self.parameters.start_poses(len(frames.views)),
                margin=settings.margin,
            )
        return frame_target(
            frames.times,
            views=frames.views,
            frames=frames.frames,
            noise=settings.noise,
            frame_quantity=frames.frame_quantity,
            masks=frames.masks,
            dtype=jnp.dtype(scene.dtype),
            limits=frames.limits,
            moving=moving,
        )


def _surface(scene: Scene, reference: StoredSolution) -> AbstractTarget:
    check_surfaces(start_surfaces(scene), reference.surfaces)
    return surface_target(reference, jnp.dtype(scene.dtype))


def _build_scenes(configs: Mapping[str, SceneConfig]) -> dict[str, Scene]:
    scenes: dict[str, Scene] = {}
    for name, config in configs.items():
        if config.steady_bodies:
            raise InputError(
                f"{name}: body {config.steady_bodies[0]} has `temperature: steady`, "
                "and a start does not follow the fitted values: give a number"
            )
        # Voxelize bodies that are the same in several cases once.
        same = (built for built in scenes if configs[built].bodies == config.bodies)
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


def _parameter(config: ParameterConfig, scene: Scene) -> Parameter:
    path, values = _path_and_start(config, scene)
    start = tuple(float(v) for v in np.atleast_1d(values))
    lower, upper = default_bounds(
        config.name, start[0], scene.allow_extreme_temperatures
    )
    if config.bounds is None:
        start = tuple(usable_start(config.name, v, lower) for v in start)
    else:
        lower, upper = (value_in_si(v, config.name) for v in config.bounds)
    prior = None if config.prior is None else _prior(config.prior, config.name)
    smoothness = None
    if config.per == "link":
        links = scene.bodies[int(path[1])].structure.links()
        sd = config.smoothness or _DEFAULT_SMOOTHNESS
        smoothness = Smoothness(links.src, links.dst, sd)
    is_capacity = config.per == "level" and path[-1] == "capacity"
    return Parameter(
        name=config.name,
        start=start,
        lower=lower,
        upper=upper,
        tied=config.tied,
        prior=prior,
        softplus=config.bijection == "softplus",
        is_scalar=values.ndim == 0,
        # The body's total capacity is conserved, so that only ratios matter.
        first_is_fixed=is_capacity and len(start) > 1,
        smoothness=smoothness,
    )


def _path_and_start(
    config: ParameterConfig, scene: Scene
) -> tuple[Path, np.ndarray | np.generic]:
    if is_of_frames(config.name):
        # The scene does not have it, nor weights of levels or links.
        if config.per is not None:
            raise InputError(f"parameter {config.name}: `per` is for weights only")
        return (), _frame_start(config)
    paths = find_paths(scene, config.name)
    values = [value_at(scene, path) for path in paths]
    if config.start is None and any(value != values[0] for value in values[1:]):
        raise InputError(
            f"parameter {config.name}: its parts have several values: name one of "
            "them, as in sheet.layers.roof.0.thickness, or give a `start`"
        )
    return paths[0], _start_values(config, paths[0], scene)


def _frame_start(config: ParameterConfig) -> np.ndarray | np.generic:
    """Start values of a number of frames, which the scene does not have."""
    if config.name == REFLECTED:
        if config.start is None:
            raise InputError(f"parameter {config.name}: give a `start`, in kelvin")
        return np.asarray(value_in_si(config.start, config.name))[()]
    _, numbers = pose_numbers(config.name)
    if config.start is None:
        return np.zeros(len(numbers)) if len(numbers) > 1 else np.float64(0)
    is_list = isinstance(config.start, list)
    listed = config.start if is_list else [config.start]
    if len(listed) != len(numbers):
        raise InputError(f"parameter {config.name}: `start` has {len(numbers)} numbers")
    values = np.asarray([value_in_si(v, config.name) for v in listed])
    return values if len(numbers) > 1 else values[0]


def _prior(config: schema.PriorConfig, name: str) -> Prior:
    mean = value_in_si(config.mean, name)
    # The logarithm has no unit.
    if config.log_normal:
        sd = to_si(config.sd, NUMBER)
    else:
        sd = deviation_in_si(config.sd, name)
    with located(f"parameter {name}"):
        return Prior(mean=mean, sd=sd, log_normal=config.log_normal)


def _start_values(
    config: ParameterConfig, path: Path, scene: Scene
) -> np.ndarray | np.generic:
    value = value_at(scene, path)
    if value is None or callable(value):
        raise InputError(
            f"parameter {config.name}: the scene has no number there, but {value!r}: "
            "name a part of it, or give it a number"
        )
    values = np.asarray(value, float)
    if config.start is not None:
        is_list = isinstance(config.start, list)
        listed = config.start if is_list else [config.start]
        values = np.asarray([value_in_si(v, config.name) for v in listed])
        values = values if is_list else values[0]
    if config.per is not None:
        # A scalar becomes one equal value per level or link.
        values = np.broadcast_to(values, (_value_count(config, path, scene),))
    return values


def _value_count(config: ParameterConfig, path: Path, scene: Scene) -> int:
    if path[:1] != ("bodies",) or path[2:4] != ("structure", "weights"):
        raise InputError(
            f"parameter {config.name}: `per: {config.per}` is for weights only"
        )
    structure = scene.bodies[int(path[1])].structure
    if config.per == "link":
        return structure.link_count
    # Links between levels have one value for each pair of neighbouring levels.
    levels = int(structure.nodes().level.max()) + 1
    return max(levels - 1, 1) if path[-1] == "between" else levels
