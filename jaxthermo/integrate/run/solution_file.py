"""`solution.npz`: the part of a solution from which its images can be drawn again."""

from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...atomic import replacing
from ...errors import InputError
from ...geometry.mesh import Pose
from ...scene.motion import Motion, PoseTable
from ...scene.scene import BodyGeometry, SolvedSurface
from .solution import Solution


FORMAT_VERSION = 2
"""Version of the file's layout; version 1 did not store its version."""

# All but the pitch and the pose, which are not stored as they are.
_GEOMETRY_FIELDS = tuple(f.name for f in fields(BodyGeometry))[:5]


class StoredSolution(NamedTuple):
    """The part of a solution that a file stores."""

    times: Float[Array, " t"]
    """[s]"""
    surface_temperature: Float[Array, "t s"]
    """Temperature of every fragment, bodies one after the other [K]."""
    surfaces: tuple[SolvedSurface, ...]


def save_solution(path: Path, solution: Solution) -> None:
    """Write times, temperatures, energies and surfaces in one step."""
    arrays: dict[str, Any] = {
        "format_version": FORMAT_VERSION,
        "times": solution.times,
        "surface_temperature": solution.surface_temperature,
        "mean_temperature": solution.mean_temperature,
        "stored_J": solution.energy.stored_J,
    }
    for name, heat in solution.energy.mechanisms.items():
        arrays[f"energy_{name}_J"] = heat
    for b, surface in enumerate(solution.surfaces):
        geometry = surface.geometry
        for field in _GEOMETRY_FIELDS:
            arrays[f"body{b}_{field}"] = getattr(geometry, field)
        # One pose per saved time, or one for all if the body does not move.
        times = np.asarray(solution.times, float) if surface.moves else [0.0]
        poses = [geometry.pose.at(float(time)) for time in times]
        arrays[f"body{b}_pitch"] = geometry.pitch
        arrays[f"body{b}_translation"] = [pose.translation for pose in poses]
        arrays[f"body{b}_rotation"] = [pose.rotation for pose in poses]
        arrays[f"body{b}_emissivity"] = surface.emissivity
        arrays[f"body{b}_absorptivity"] = surface.absorptivity
    with replacing(path) as temporary, open(temporary, "wb") as file:
        plain: dict[str, Any] = {k: np.asarray(v) for k, v in arrays.items()}
        np.savez_compressed(file, **plain)


def load_solution(path: Path) -> StoredSolution:
    """Read a file of `save_solution`; an `InputError` says why it cannot be read."""
    try:
        # Opened here, since np.load leaves a damaged file that it opened itself open.
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as stored:
            _check_version(path, stored)
            # Each body stores one pitch.
            bodies = sum(name.endswith("_pitch") for name in stored.files)
            return StoredSolution(
                jnp.asarray(stored["times"]),
                jnp.asarray(stored["surface_temperature"]),
                tuple(_load_surface(stored, b) for b in range(bodies)),
            )
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(
            f"{path}: no such file; `jaxthermo simulate` makes it when a run is done"
        ) from None
    except Exception as error:
        # numpy and zipfile raise many types for a damaged file.
        raise InputError(
            f"{path}: not a solution of jaxthermo, or damaged "
            f"({type(error).__name__}); run the simulation again"
        ) from None


def _check_version(path: Path, stored: Any) -> None:
    # Compared as text: a foreign file may store anything under this name.
    has_version, found = "format_version" in stored.files, "not a solution of jaxthermo"
    version = str(stored["format_version"]) if has_version else "1"
    if version == str(FORMAT_VERSION):
        return
    if has_version or "surface_temperature" in stored.files:
        found = f"a solution of format version {version}"
    raise InputError(
        f"{path}: {found}, and this version of jaxthermo reads format version "
        f"{FORMAT_VERSION}; run the simulation again"
    )


def _load_surface(stored, b: int) -> SolvedSurface:
    get = lambda field: stored[f"body{b}_{field}"]
    row = lambda values: (float(values[0]), float(values[1]), float(values[2]))
    poses = tuple(
        Pose(row(shift), tuple(map(row, turn)))
        for shift, turn in zip(get("translation"), get("rotation"), strict=True)
    )
    # One pose stands for all times.
    times = tuple(stored["times"].tolist())
    pose = poses[0] if len(poses) == 1 else Motion(PoseTable(times, poses))
    shape = [get(field) for field in _GEOMETRY_FIELDS]
    geometry = BodyGeometry(*shape, pitch=float(get("pitch")), pose=pose)
    return SolvedSurface(
        geometry, jnp.asarray(get("emissivity")), jnp.asarray(get("absorptivity"))
    )
