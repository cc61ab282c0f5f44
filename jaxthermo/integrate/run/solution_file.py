"""`solution.npz`: the part of a solution from which its images can be drawn again."""

import json
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt8

from ...archive import read_archive, select_arrays
from ...errors import InputError
from ...geometry.mesh import Pose
from ...physics.radiation.irradiation import Irradiance
from ...scene.motion import Motion, PoseTable
from ...scene.scene import SURFACE_OUTPUTS, BodyGeometry, SolvedSurface


FORMAT_VERSION = 5
"""Version of the file's layout; version 3 added the checksum, version 5 the radiation
that reaches surfaces."""

KIND = "solution"
"""Name of the file in messages."""

_REMEDY = "run the simulation again"


class StoredSolution(NamedTuple):
    """The part of a solution that a file stores."""

    times: Float[Array | np.ndarray, " t"]
    """[s]"""
    surface_temperature: Float[Array | np.ndarray, "t s"]
    """Temperature of every fragment, bodies one after the other [K]."""
    surfaces: tuple[SolvedSurface, ...]
    irradiance: Irradiance | None = None
    """Radiation that reaches every fragment, with the times as its first axis; None
    where no image is drawn."""
    heat_flux: Float[Array | np.ndarray, "t s"] | None = None
    """Heat flux into every fragment [W/m^2], if the scene asks for it."""
    heat_transfer_coefficient: Float[Array | np.ndarray, "t s"] | None = None
    """Coefficient of every fragment [W/(m^2 K)], if the scene asks for it."""

    def at_times(self, times: tuple[float, ...], path: Path) -> "StoredSolution":
        """Reduce a user's reference, read from `path`, to the times of a run [s].

        Raises:
            InputError: if one of them is not saved there.
        """
        saved = np.asarray(self.times, float)
        # Files may hold float32 times.
        rows = [np.flatnonzero(np.isclose(saved, t, rtol=1e-5)) for t in times]
        missing = [t for t, row in zip(times, rows, strict=True) if not len(row)]
        if missing:
            listed = ", ".join(f"{t:g}" for t in missing[:5])
            raise InputError(
                f"{path}: nothing is saved at {listed} s there: the run and its "
                "reference need the same save times"
            )
        selected_rows = jnp.asarray([int(row[0]) for row in rows])
        surface = self.surface_temperature[selected_rows]
        return StoredSolution(jnp.asarray(times), surface, self.surfaces)


class RunArrays(NamedTuple):
    """Arrays that a file stores once, except for the energies of mechanisms."""

    times: Float[np.ndarray, " t"]
    surface_temperature: Float[np.ndarray, "t s"]
    mean_temperature: Float[np.ndarray, "t b"]
    stored_J: Float[np.ndarray, " t"]
    irradiance: Float[np.ndarray, "t s"]
    irradiance_sources: Float[np.ndarray, "t q s"]
    source_spectrum: Float[np.ndarray, "t q"]
    # Optional outputs of the scene.
    heat_flux: Float[np.ndarray, "t s"] | None = None
    heat_transfer_coefficient: Float[np.ndarray, "t s"] | None = None
    probe_temperature: Float[np.ndarray, "t p"] | None = None
    probe_position: Float[np.ndarray, "p 3"] | None = None


class BodyArrays(NamedTuple):
    """Arrays that a file stores for each body, with its number as a prefix."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    fragment_position: Float[np.ndarray, "s 3"]
    fragment_normal: Float[np.ndarray, "s 3"]
    fragment_area: Float[np.ndarray, " s"]
    pitch: Float[np.ndarray, ""]
    # One pose for each saved time, or one for all if the body does not move.
    translation: Float[np.ndarray, "p 3"]
    rotation: Float[np.ndarray, "p 3 3"]
    # One number for one material.
    emissivity: Float[np.ndarray, ""] | Float[np.ndarray, " s"]
    absorptivity: Float[np.ndarray, ""] | Float[np.ndarray, " s"]
    # Of bodies with parts: their names as JSON in UTF-8.
    fragment_part: Int[np.ndarray, " s"] | None = None
    part_names: UInt8[np.ndarray, " n"] | None = None
    # Of a thin wall: 1, both sides of its triangles are surfaces.
    is_two_sided: UInt8[np.ndarray, ""] | None = None
    # Of a body with cavities: fragments that nothing from outside reaches.
    is_enclosed: Bool[np.ndarray, " s"] | None = None
    # Name of the body in UTF-8.
    name: UInt8[np.ndarray, " m"] | None = None

    def present(self) -> dict[str, np.ndarray]:
        """Return the arrays by name, without those that the body does not have."""
        fields = self._asdict().items()
        return {name: array for name, array in fields if array is not None}


_GEOMETRY_FIELDS = BodyArrays._fields[:5]


def body_arrays(surface: SolvedSurface, saved: Float[np.ndarray, " t"]) -> BodyArrays:
    """The surface of a body as arrays; with a pose for each saved time if it moves."""
    geometry = surface.geometry
    times = saved if surface.moves else [0.0]
    poses = [geometry.pose.at(float(time)) for time in times]
    part_names = None
    if geometry.fragment_part is not None:
        part_names = _text_array(json.dumps(geometry.part_names))
    return BodyArrays(
        *(np.asarray(getattr(geometry, field)) for field in _GEOMETRY_FIELDS),
        pitch=np.asarray(geometry.pitch, float),
        translation=np.asarray([pose.translation for pose in poses], float),
        rotation=np.asarray([pose.rotation for pose in poses], float),
        emissivity=np.asarray(surface.emissivity),
        absorptivity=np.asarray(surface.absorptivity),
        fragment_part=geometry.fragment_part,
        part_names=part_names,
        is_two_sided=np.asarray(1, np.uint8) if geometry.is_two_sided else None,
        is_enclosed=geometry.is_enclosed,
        name=_text_array(geometry.name) if geometry.name else None,
    )


def _text_array(text: str) -> UInt8[np.ndarray, " n"]:
    return np.frombuffer(text.encode(), np.uint8)


def load_solution(path: Path) -> StoredSolution:
    """Read a file that `save_solution` wrote.

    Raises:
        InputError: if it is missing, damaged, or of another version.
    """
    if not path.exists():
        raise InputError(
            f"{path}: no such file; `jaxthermo simulate` makes it when a run is done"
        )
    arrays = read_archive(
        path, format_name=KIND, version=FORMAT_VERSION, remedy=_REMEDY
    )
    try:
        return _stored_solution(arrays)
    except InputError as error:
        raise InputError(f"{path}: {error}; {_REMEDY}") from error


def _stored_solution(arrays: dict[str, np.ndarray]) -> StoredSolution:
    run = select_arrays(RunArrays, arrays)
    # Each body stores one pitch.
    count = sum(name.endswith("_pitch") for name in arrays)
    bodies = [select_arrays(BodyArrays, arrays, f"body{b}_") for b in range(count)]
    _check_energies(arrays, run, count)
    fragments = sum(len(body.fragment_area) for body in bodies)
    if run.surface_temperature.shape[1] != fragments:
        raise InputError(
            f"surface_temperature has {run.surface_temperature.shape[1]} columns, and "
            f"its bodies have {fragments} fragments"
        )
    if not len(run.times) or (np.diff(run.times) <= 0).any():
        raise InputError("times do not increase")
    surfaces = tuple(solved_surface(body, run.times) for body in bodies)
    return StoredSolution(
        times=run.times,
        surface_temperature=run.surface_temperature,
        surfaces=surfaces,
        irradiance=Irradiance(
            run.irradiance, run.irradiance_sources, run.source_spectrum
        ),
        **{name: getattr(run, name) for name in SURFACE_OUTPUTS},
    )


def _check_energies(arrays: dict[str, np.ndarray], run: RunArrays, bodies: int) -> None:
    # The energies have the names of the scene's mechanisms; nothing else is left.
    expected_names = set(RunArrays._fields)
    expected_names |= {
        f"body{b}_{name}" for b in range(bodies) for name in BodyArrays._fields
    }
    for name in arrays.keys() - expected_names:
        if not (name.startswith("energy_") and name.endswith("_J")):
            raise InputError(f"{name} is no part of a solution")
        heat = arrays[name]
        if heat.shape != run.times.shape or heat.dtype.kind != "f":
            raise InputError(f"{name} is not one number for each of the times")
        if not np.isfinite(heat).all():
            raise InputError(f"{name} has values that are not finite")


def _check_ranges(body: BodyArrays) -> None:

    def is_fraction(values):
        return (values >= 0) & (values <= 1)

    valid = {
        "pitch": body.pitch > 0,
        "fragment_area": body.fragment_area > 0,
        "emissivity": is_fraction(body.emissivity),
        "absorptivity": is_fraction(body.absorptivity),
    }
    for name, is_valid in valid.items():
        if not is_valid.all():
            raise InputError(f"{name} of a body is out of its range")


def _part_names(body: BodyArrays) -> tuple[str, ...]:
    if body.fragment_part is None or body.part_names is None:
        return ()
    try:
        names = tuple(map(str, json.loads(body.part_names.tobytes())))
    except (ValueError, TypeError) as error:
        raise InputError("part_names of a body is not a list of names") from error
    if not -1 <= body.fragment_part.min() <= body.fragment_part.max() < len(names):
        raise InputError("fragment_part of a body has numbers without a name")
    return names


def _name(body: BodyArrays) -> str:
    if body.name is None:
        return ""
    try:
        return body.name.tobytes().decode()
    except UnicodeDecodeError as error:
        raise InputError("name of a body is no text") from error


def solved_surface(body: BodyArrays, times: Float[np.ndarray, " t"]) -> SolvedSurface:
    """The surface of a body from its arrays.

    Raises:
        InputError: if they contradict each other.
    """
    _check_ranges(body)
    first = body.faces.min(initial=0)
    last = body.faces.max(initial=0)
    if not 0 <= first <= last < len(body.vertices):
        raise InputError("a face has a vertex that does not exist")
    poses = tuple(
        Pose(tuple(shift), tuple(map(tuple, turn)))
        for shift, turn in zip(
            body.translation.tolist(), body.rotation.tolist(), strict=True
        )
    )
    if len(poses) not in (1, len(times)):
        raise InputError(f"{len(poses)} poses are stored at {len(times)} times")
    # One pose stands for all times.
    pose: Pose | Motion = poses[0]
    if len(poses) > 1:
        pose = Motion(PoseTable(tuple(times.tolist()), poses))
    shape = (getattr(body, field) for field in _GEOMETRY_FIELDS)
    geometry = BodyGeometry(
        *shape,
        pitch=float(body.pitch),
        pose=pose,
        fragment_part=body.fragment_part,
        part_names=_part_names(body),
        is_two_sided=body.is_two_sided is not None and bool(body.is_two_sided),
        is_enclosed=body.is_enclosed,
        name=_name(body),
    )
    return SolvedSurface(
        geometry, jnp.asarray(body.emissivity), jnp.asarray(body.absorptivity)
    )
