"""Reference runs, computed once and stored in the user's cache.

They are runs of the full volume of the same voxels, and for truth errors runs of finer
voxels with an estimate of their own error from two coarser ones.
"""

import functools
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, NotRequired, TypedDict

import numpy as np
from jaxtyping import Bool, Float

from jaxthermo.accuracy.discretization_error import (
    DiscretizationError,
    discretization_error,
)
from jaxthermo.archive import text_hash
from jaxthermo.arrays import precision
from jaxthermo.config.loader import config_hash
from jaxthermo.config.schema.body import BodyConfig
from jaxthermo.config.schema.material import LabelledConfig
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.run.solution import RESULTS, Solution
from jaxthermo.integrate.run.solution_arrays import (
    BodyArrays,
    body_arrays,
    solved_surface,
)
from jaxthermo.integrate.run.surface_reading import surface_reading
from jaxthermo.integrate.solvers import ErrorControl, ForwardEuler
from jaxthermo.memo.content_hash import code_hash
from jaxthermo.memo.store import REFERENCE
from jaxthermo.memo.stored import stored
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.scene.scene import Scene, SolvedSurface

from ..config.schema import AbsoluteReference, RefinedReference
from .sheet_cells import resized_sheet, without_cells


Log = Callable[[str], None]
"""Called with a line before each slow stage."""

COARSENING = 2.0
"""Pitch of each coarser run, from which a reference's error follows, over the next."""

_FINER_THROUGH = 4.0
"""Widths of cells through the thickness of sheets by default, over those of a reference
whose pitch is given."""

_ERROR_OF_SHEETS = 1.6e-3
"""Error in time of a reference with sheets over the range of the surface, and over the
square of its step [-]."""

_CALIBRATE = Path(__file__).parents[1]


class RunCost(TypedDict):
    """Cost of a run, as plain values."""

    refinement: NotRequired[float]
    """Pitch of the judged scene over that of the run, if it was chosen by that [-]."""
    structure: str
    pitch_m: list[float]
    nodes: int
    steps: int
    time_error_kelvin: float | None
    memory_bytes: int
    run_time_s: float
    """Time when it was run."""
    warnings: list[str]
    cached: NotRequired[bool]


class TruthReference(NamedTuple):
    """A run of finer voxels, its own error and its cost."""

    solution: StoredSolution
    own_error: DiscretizationError
    costs: tuple[RunCost, ...]
    """Costs of the run and of the two coarser ones."""

    def read_at(
        self, surfaces: tuple[SolvedSurface, ...]
    ) -> tuple[StoredSolution, Bool[np.ndarray, " s"]]:
        """Temperatures at the fragments of other voxels, and where it has no surface.

        Fragments without a counterpart get the mean of the others.
        """
        rows = []
        lost = []
        first = 0
        temperature = np.asarray(self.solution.surface_temperature)
        for surface, finer in zip(surfaces, self.solution.surfaces, strict=True):
            body = surface.geometry
            finer_body = finer.geometry
            last = first + len(finer_body.fragment_area)
            reading = surface_reading(
                finer_body,
                points=body.fragment_position,
                normals=body.fragment_normal,
            )
            rows.append(reading.read(temperature[:, first:last]))
            lost.append(reading.is_lost)
            first = last
        temperatures = np.concatenate(rows, axis=1)
        is_lost = np.concatenate(lost)
        if is_lost.all():
            raise InputError("truth: the finer voxels have no surface in common")
        temperatures[:, is_lost] = temperatures[:, ~is_lost].mean(axis=1, keepdims=True)
        stored = StoredSolution(
            self.solution.times, surface_temperature=temperatures, surfaces=surfaces
        )
        return stored, is_lost


def program_hash(with_calibrate: bool = False) -> str:
    """Hash of the source code that runs scenes, and of the fits' where asked for."""
    return (code_hash(_CALIBRATE) if with_calibrate else code_hash())[:16]


def on_every_voxel(config: SceneConfig) -> SceneConfig:
    """Config with the full volume for all bodies, and defaults for what it ignores."""
    bodies = []
    for body in config.bodies:
        default = type(body).model_fields["structure"].default
        bodies.append(body.model_copy(update={"structure": default}))
    return _with_bodies(config, tuple(bodies))


def _with_bodies(config: SceneConfig, bodies: tuple[BodyConfig, ...]) -> SceneConfig:
    # Name, camera, image, solver and truth do not affect the reference and would only
    # spoil its place in the cache.
    fields = type(config).model_fields
    ignored = ("camera", "image", "solver", "truth")
    defaults = {key: fields[key].default for key in ignored}
    return config.model_copy(update={"bodies": bodies, "name": None, **defaults})


def full_volume_run(config: SceneConfig, step: float, log: Log) -> StoredSolution:
    """Run a scene on every voxel, or load the run from the cache.

    Args:
        config: of the scene.
        step: over the largest stable one [-]; with a sheet the error in time is
            controlled to 0.16 % of the range times its square.
        log: called before the run.
    """
    solution, cost = _stored_run(
        on_every_voxel(config), step=step, log=lambda: log("running the full volume")
    )
    for text in cost["warnings"]:
        warnings.warn(text, stacklevel=2)
    return solution


def refined_reference(
    config: SceneConfig, settings: RefinedReference | AbsoluteReference, log: Log
) -> TruthReference:
    """Run a scene in finer voxels and in two coarser ones, or load the runs.

    Temperatures are those of the surface itself, and the error in time is controlled.
    An absolute reference is equal for all scenes that differ in voxels, structure,
    surface map, precision and solver only.

    Raises:
        InputError: if the scene has no finer voxels, or a run fails.
    """
    runs = _runs(
        config,
        settings=settings,
        log=log,
        factors=(1.0, COARSENING, COARSENING**2),
    )
    solutions, costs = zip(*runs, strict=True)
    error = discretization_error(*solutions, count=settings.points, seed=settings.seed)
    return TruthReference(solution=solutions[0], own_error=error, costs=costs)


def refined_run(
    config: SceneConfig, settings: RefinedReference, log: Log
) -> tuple[StoredSolution, RunCost]:
    """Run a scene in finer voxels, or load the run, without coarser ones.

    Errors and remarks are those of `refined_reference`.
    """
    (run,) = _runs(config, settings=settings, log=log, factors=(1.0,))
    return run


def reference_key(config: SceneConfig, settings: AbsoluteReference) -> str:
    """Hash that scenes with one absolute reference have in common."""
    typed = config.model_copy(update={"dtype": settings.dtype})
    # The pitch follows from the mesh and the settings: no mesh is loaded for a key.
    pitches = (1.0,) * len(typed.bodies)
    same = _with_pitches(typed, pitches=pitches, settings=settings, size=1.0)
    text = f"{config_hash(same)} {settings.model_dump_json()} {program_hash()}"
    return text_hash(text)


def _absolute_pitches(
    config: SceneConfig, settings: AbsoluteReference
) -> tuple[float, ...]:
    pitch = settings.pitch
    for number, body in enumerate(config.bodies):
        _check_refinable(number, body)
    if pitch is None:
        height = float(np.ptp(config.bodies[0].build_mesh().bounds[:, 2]))
        if not height:
            raise InputError(
                "truth: voxels_high: body 0 is flat: give the `pitch` instead"
            )
        pitch = height / float(settings.voxels_high or 1)
    return (pitch,) * len(config.bodies)


def voxel_pitch(number: int, body: BodyConfig) -> float:
    """Edge of a body's voxels, or of a sheet's cells [m], also where it is not given.

    Raises:
        InputError: for the body of that number if it has no finer voxels.
    """
    _check_refinable(number, body)
    if body.wall is not None:
        return body.wall.pitch_on(body.build_mesh().bounds)
    if body.pitch is not None:
        return body.pitch
    height = float(np.ptp(body.build_mesh().bounds[:, 2]))
    return height / float(body.voxels_high or 1)


def _runs(
    config: SceneConfig,
    settings: RefinedReference | AbsoluteReference,
    log: Log,
    factors: tuple[float, ...],
) -> list[tuple[StoredSolution, RunCost]]:
    """Runs in voxels whose edges are those of the settings times each factor."""
    refinement = None
    if isinstance(settings, AbsoluteReference):
        pitches = _absolute_pitches(config, settings)
        config = config.model_copy(update={"dtype": settings.dtype})
    else:
        refinement = settings.refinement
        pitches = [
            voxel_pitch(n, body) / refinement for n, body in enumerate(config.bodies)
        ]
    runs = []
    for factor in factors:
        pitches_m = tuple(pitch * factor for pitch in pitches)
        finer = None if refinement is None else refinement / factor
        millimetres = f"{1e3 * pitches_m[0]:.3g} mm"
        name = f"voxels of {millimetres}"
        if finer is not None:
            name = f"voxels {finer:.3g} times as fine"
        try:
            refined_config = _with_pitches(
                config,
                pitches=pitches_m,
                settings=settings,
                size=factor / (refinement or _FINER_THROUGH),
            )
            structure = _structure_kind(refined_config.bodies[0]).replace("_", " ")
            announce = functools.partial(log, f"running {structure} of {millimetres}")
            solution, cost = _stored_run(refined_config, step=None, log=announce)
            if finer is not None:
                cost = {"refinement": finer, **cost}
            runs.append((solution, cost))
        except InputError as error:
            raise InputError(f"truth: in {name}: {error}") from error
    return runs


def read_at_surface(scene: Scene) -> Scene:
    """Scene whose temperatures are those of the surface, not half a voxel below."""
    bodies = []
    for body in scene.bodies:
        read = body.surface_map
        if getattr(read, "at", "surface") != "surface":
            body = replace(body, surface_map=replace(read, at="surface"))
        bodies.append(body)
    return replace(scene, bodies=tuple(bodies))


def _structure_kind(body: BodyConfig) -> str:
    """Kind of the structure of a body, which may be a sheet."""
    return body.structure.kind if body.wall is None else "sheet"


def _check_refinable(number: int, body: BodyConfig) -> None:
    if body.solid is not None or isinstance(body.material, LabelledConfig):
        raise InputError(
            f"truth: body {number} is given by its voxels, which cannot be refined: "
            "give a mesh or a shape, and materials by `parts` or `regions`"
        )


def _with_pitches(
    config: SceneConfig,
    pitches: tuple[float, ...],
    settings: RefinedReference | AbsoluteReference,
    size: float,
) -> SceneConfig:
    """Config with voxels of these edges [m] as a reference, read at the surface.

    Cells of sheets are as large as blocks of voxels; `size` is that of the voxels over
    those of the config [-].
    """
    bodies = []
    blocks = int(getattr(settings.structure, "factor", 1))
    for n, (body, pitch) in enumerate(zip(config.bodies, pitches, strict=True)):
        _check_refinable(n, body)
        if body.wall is not None:
            if isinstance(settings, AbsoluteReference):
                body = without_cells(body)
            bodies.append(resized_sheet(body, blocks * pitch, size))
            continue
        surface_map = type(body).model_fields["surface_map"].default
        changes = {"structure": settings.structure, "surface_map": surface_map}
        changes["surface_cells"] = settings.surface_cells
        changes |= {"pitch": pitch, "voxels_high": None}
        bodies.append(body.model_copy(update=changes))
    return _with_bodies(config, tuple(bodies))


class _ReferenceRun(NamedTuple):
    """A run as it is stored."""

    times: Float[np.ndarray, " t"]
    surface_temperature: Float[np.ndarray, "t s"]
    bodies: tuple[BodyArrays, ...]
    cost: RunCost


def _stored_run(
    config: SceneConfig, step: float | None, log: Callable[[], None]
) -> tuple[StoredSolution, RunCost]:
    """A run and its cost, from the cache if it is there.

    Explicit steps of `step` times the stable one, or with a controlled error in time.
    """
    is_cached = True

    def compute() -> _ReferenceRun:
        nonlocal is_cached
        is_cached = False
        log()
        return _run_with_cost(config, step)

    run = stored(
        REFERENCE,
        inputs=(config_hash(config), step),
        compute=compute,
        types=(_ReferenceRun, BodyArrays),
    )
    solution = StoredSolution(
        run.times,
        surface_temperature=run.surface_temperature,
        surfaces=tuple(solved_surface(body, run.times) for body in run.bodies),
    )
    return solution, {**run.cost, "cached": is_cached}


def _run_with_cost(config: SceneConfig, step: float | None) -> _ReferenceRun:
    clock = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        solution = _run(config, step)
    cost: RunCost = {
        "structure": _structure_kind(config.bodies[0]),
        "pitch_m": [surface.geometry.pitch for surface in solution.surfaces],
        "nodes": solution.receipt.nodes,
        "steps": solution.run.steps,
        "time_error_kelvin": solution.run.time_error,
        "memory_bytes": solution.receipt.memory_bytes,
        "run_time_s": time.perf_counter() - clock,
        # Those of coarser voxels are no warnings of the run that is judged.
        "warnings": list(dict.fromkeys(str(warning.message) for warning in caught)),
    }
    times = np.asarray(solution.times)
    return _ReferenceRun(
        times=times,
        surface_temperature=np.asarray(solution.surface_temperature),
        bodies=tuple(body_arrays(surface, times) for surface in solution.surfaces),
        cost=cost,
    )


def _run(config: SceneConfig, step: float | None) -> Solution:
    scene = config.build()
    end = config.time.end
    saves = config.time.save_times
    solver = config.solver.build()
    if step is not None and any(body.wall is not None for body in config.bodies):
        # The stable step of a wall may be as long as the time in which it warms.
        solver = ErrorControl(relative_error=_ERROR_OF_SHEETS * step**2)
    elif step is not None:
        with precision(config.dtype):
            stable = float(compile_scene(scene, len(saves), end).stable_step)
        # A scene without any stability limit takes the solver's default.
        solver = ForwardEuler(dt=step * stable if np.isfinite(stable) else None)
    solution = simulate(scene, t1=end, save_at=saves, solver=solver, throw=False)
    if solution.result != RESULTS.successful:
        raise InputError(f"the reference: {RESULTS[solution.result]}")
    return solution
