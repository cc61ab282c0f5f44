"""`solution.npz`: what a finished run keeps, enough to draw it again from anywhere."""

from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...atomic import replacing
from ...errors import InputError
from ...geometry.pose import Pose
from ...scene.motion import Motion, PoseTable
from ...scene.solved_surface import BodyGeometry, SolvedSurface
from .solution import Solution


_GEOMETRY = (
    "vertices",
    "faces",
    "fragment_position",
    "fragment_normal",
    "fragment_area",
)


class StoredSolution(NamedTuple):
    """The part of a solution that can be drawn."""

    times: Float[Array, " t"]
    surface_temperature: Float[Array, "t s"]
    surfaces: tuple[SolvedSurface, ...]


def save_solution(path: Path, solution: Solution) -> None:
    """Write times, temperatures, energies and surfaces in one step."""
    arrays: dict[str, Any] = {
        "times": solution.times,
        "surface_temperature": solution.surface_temperature,
        "mean_temperature": solution.mean_temperature,
        "stored_J": solution.energy.stored_J,
    }
    for name, heat in solution.energy.mechanisms.items():
        arrays[f"energy_{name}_J"] = heat
    for b, surface in enumerate(solution.surfaces):
        geometry = surface.geometry
        for field in _GEOMETRY:
            arrays[f"body{b}_{field}"] = getattr(geometry, field)
        arrays[f"body{b}_pitch"] = np.array(geometry.pitch)
        poses = _poses(surface, solution)
        arrays[f"body{b}_translation"] = np.array([pose.translation for pose in poses])
        arrays[f"body{b}_rotation"] = np.array([pose.rotation for pose in poses])
        arrays[f"body{b}_emissivity"] = surface.emissivity
        arrays[f"body{b}_absorptivity"] = surface.absorptivity
    with replacing(path) as temporary, open(temporary, "wb") as file:
        kept: dict[str, Any] = {k: np.asarray(v) for k, v in arrays.items()}
        np.savez_compressed(file, **kept)


def _poses(surface: SolvedSurface, solution: Solution) -> list[Pose]:
    """Where a body stands at the saved times; once if it stays there."""
    times = np.asarray(solution.times, float) if surface.moves else [0.0]
    return [surface.geometry.pose.at(float(time)) for time in times]


def _pose(translation: np.ndarray, rotation: np.ndarray, times) -> Pose | Motion:
    poses = [
        Pose(_point(shift), tuple(map(_point, turn)))
        for shift, turn in zip(translation, rotation, strict=True)
    ]
    if len(poses) == 1:
        return poses[0]
    return Motion(PoseTable(tuple(times.tolist()), tuple(poses)))


def _point(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z


def _load_surface(kept, b: int) -> SolvedSurface:
    get = lambda field: kept[f"body{b}_{field}"]
    pose = _pose(get("translation"), get("rotation"), kept["times"])
    geometry = BodyGeometry(
        *(get(field) for field in _GEOMETRY), pitch=float(get("pitch")), pose=pose
    )
    return SolvedSurface(
        geometry, jnp.asarray(get("emissivity")), jnp.asarray(get("absorptivity"))
    )


def load_solution(path: Path) -> StoredSolution:
    """Read what `save_solution` wrote.

    Raises:
        InputError: if the file is missing or is not such a file.
    """
    try:
        # Opened here, since np.load leaves a damaged file that it opened itself open.
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as kept:
            bodies = sum(name.endswith("_pitch") for name in kept.files)
            return StoredSolution(
                jnp.asarray(kept["times"]),
                jnp.asarray(kept["surface_temperature"]),
                tuple(_load_surface(kept, b) for b in range(bodies)),
            )
    except FileNotFoundError:
        raise InputError(
            f"{path}: no such file; `jaxthermo simulate` makes it when a run is done"
        ) from None
    except Exception as error:
        raise InputError(
            f"{path}: not a solution of jaxthermo, or damaged "
            f"({type(error).__name__}); run the simulation again"
        ) from None
