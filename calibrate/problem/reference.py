"""Full-volume runs that fits are compared with: computed once and cached."""

import contextlib
import functools
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import jaxthermo
from jaxthermo.arrays import precision
from jaxthermo.atomic import remove_leftovers
from jaxthermo.config.loader import config_hash
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.run.solution import RESULTS
from jaxthermo.integrate.run.solution_file import (
    StoredSolution,
    load_solution,
    save_solution,
)
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.structures.cache import cache_folder


Log = Callable[[str], None]
"""Called with a line before each slow stage."""


@functools.cache
def program_hash(with_calibrate: bool = False) -> str:
    """Hash of the source code that runs scenes, and of the fits' where asked for."""
    # A reference is computed again when the code that made it has changed.
    folders = [Path(jaxthermo.__file__).parent]
    if with_calibrate:
        folders.append(Path(__file__).parents[1])
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(folder.rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def on_every_voxel(config: SceneConfig) -> SceneConfig:
    """Config with the full volume for all bodies, and defaults for what it ignores."""
    default = lambda model, key: {key: type(model).model_fields[key].default}
    bodies = (b.model_copy(update=default(b, "structure")) for b in config.bodies)
    changes: dict[str, Any] = {"bodies": tuple(bodies), "name": None}
    # Name, camera, image, solver and truth do not affect the reference and would only
    # spoil its place in the cache.
    for key in ("camera", "image", "solver", "truth"):
        changes |= default(config, key)
    return config.model_copy(update=changes)


def full_volume_run(config: SceneConfig, step: float, log: Log) -> StoredSolution:
    """Run a scene on every voxel, or load the run from the cache."""
    config, folder, path = on_every_voxel(config), cache_folder(), None
    if folder is not None:
        text = f"{config_hash(config)} {step!r} {program_hash()}"
        name = hashlib.sha256(text.encode()).hexdigest()[:32]
        path = folder.parent / "references" / f"{name}.npz"
        # A file of the cache that cannot be read is written anew.
        if path.is_file():
            with contextlib.suppress(InputError):
                return load_solution(path)
    log("running the full volume")
    scene = config.build()
    end, saves = config.time.end, config.time.save_times
    with precision(config.dtype):
        stable = float(compile_scene(scene, len(saves), end).stable_step)
    # A scene without any stability limit takes the solver's default.
    dt = step * stable if np.isfinite(stable) else None
    found = simulate(scene, end, saves, solver=ForwardEuler(dt=dt), throw=False)
    if found.result != RESULTS.successful:
        raise InputError(f"the reference: {RESULTS[found.result]}")
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        remove_leftovers(path.parent)
        save_solution(path, found)
    return StoredSolution(found.times, found.surface_temperature, found.surfaces)
