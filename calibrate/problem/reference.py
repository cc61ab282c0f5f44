"""Full-volume runs that fits are held against: made once, and kept."""

import functools
import hashlib
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np

import jaxthermo
from jaxthermo.arrays import precision
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


Doing = Callable[[str], None]
"""Told what takes a while."""


@functools.cache
def program_hash(fits: bool = False) -> str:
    """Of the code that runs scenes: an edited one makes its references anew.

    Args:
        fits: whether the code of calibrations counts too.
    """
    folders = [Path(jaxthermo.__file__).parent]
    if fits:
        folders.append(Path(__file__).parents[1])
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(folder.rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def reference_name(config: SceneConfig, step: float) -> str:
    """Of the file of a reference.

    Args:
        config: of the scene.
        step: share of the stable one.
    """
    text = f"{config_hash(config)} {step!r} {program_hash()}"
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def on_every_voxel(config: SceneConfig) -> SceneConfig:
    """The scene with full volumes for all bodies, and nothing that a run ignores."""
    from_start = SceneConfig.model_fields
    bodies = tuple(
        body.model_copy(
            update={"structure": type(body).model_fields["structure"].default}
        )
        for body in config.bodies
    )
    update = {
        "bodies": bodies,
        "name": None,
        "camera": from_start["camera"].default,
        "image": from_start["image"].default,
        "solver": from_start["solver"].default,
    }
    return config.model_copy(update=update)


def full_volume_run(config: SceneConfig, step: float, doing: Doing) -> StoredSolution:
    """The scene on every voxel at a share of the stable step, from disk if it is there.

    Args:
        config: of the scene, whatever its structures.
        step: share of the stable step.
        doing: is told if it has to be run.
    """
    config = on_every_voxel(config)
    folder = cache_folder()
    path = None
    if folder is not None:
        path = folder.parent / "references" / f"{reference_name(config, step)}.npz"
        if path.is_file():
            return load_solution(path)
    doing("running the full volume")
    found = _run(config, step)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        save_solution(path, found)
    return StoredSolution(found.times, found.surface_temperature, found.surfaces)


def _run(config: SceneConfig, step: float):
    scene = config.build()
    end, saves = config.time.end, config.time.save_times
    with precision(config.dtype):
        stable = float(compile_scene(scene, len(saves), end).stable_step)
    dt = step * stable if np.isfinite(stable) else None
    found = simulate(scene, end, saves, solver=ForwardEuler(dt=dt), throw=False)
    if found.result != RESULTS.successful:
        raise InputError(f"the reference: {RESULTS[found.result]}")
    return found


def check_reference(
    found: StoredSolution, times: tuple[float, ...], path: Path
) -> StoredSolution:
    """A user's own reference, if it is of the case's times.

    Args:
        found: from a file.
        times: that the case saves [s].
        path: of the file.

    Raises:
        InputError: if it is of other times.
    """
    saved = np.asarray(found.times, float)
    rows = [np.flatnonzero(np.isclose(saved, t, rtol=1e-5)) for t in times]
    missing = [t for t, row in zip(times, rows, strict=True) if not len(row)]
    if missing:
        listed = ", ".join(f"{t:g}" for t in missing[:5])
        raise InputError(
            f"{path}: nothing is saved at {listed} s there: the case and its reference "
            "need the same save times"
        )
    chosen = jnp.asarray([int(row[0]) for row in rows])
    return StoredSolution(
        jnp.asarray(times), found.surface_temperature[chosen], found.surfaces
    )
