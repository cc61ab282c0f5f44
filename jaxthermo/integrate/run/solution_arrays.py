"""Arrays of `solution.npz`: those of a run, and those of the surface of each body."""

import json
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from ...errors import InputError
from ...geometry.mesh import Pose
from ...physics.flux_law import Values
from ...scene.motion import Motion, PoseTable
from ...scene.scene import BodyGeometry, SolvedSurface
from ..energy import Energy


FORMAT_VERSION = 6
"""Version of the file's layout; version 3 added the checksum, version 5 the radiation
that reaches surfaces, version 6 what surrounds them and the energies of each body."""

KIND = "solution"
"""Name of the file in messages."""


class RunArrays(NamedTuple):
    """Arrays that a file stores once."""

    times: Float[np.ndarray, " t"]
    surface_temperature: Float[np.ndarray, "t s"]
    mean_temperature: Float[np.ndarray, "t b"]
    irradiance: Float[np.ndarray, "t s"]
    irradiance_sources: Float[np.ndarray, "t q s"]
    source_spectrum: Float[np.ndarray, "t q"]
    # Terms that a camera sees, as JSON in UTF-8.
    terms: UInt8[np.ndarray, " j"]
    # Columns of the energies and their names as JSON in UTF-8, see `energy_columns`;
    # a steady state has none.
    energy: Float[np.ndarray, "t e"] | None = None
    energy_columns: UInt8[np.ndarray, " c"] | None = None
    # Optional outputs of the scene.
    heat_flux: Float[np.ndarray, "t s"] | None = None
    heat_transfer_coefficient: Float[np.ndarray, "t s"] | None = None
    probe_temperature: Float[np.ndarray, "t p"] | None = None
    probe_position: Float[np.ndarray, "p 3"] | None = None
    # Names of the probes, as JSON in UTF-8.
    probe_names: UInt8[np.ndarray, " k"] | None = None


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
        part_names = json_array(geometry.part_names)
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


def json_array(content: Any) -> UInt8[np.ndarray, " n"]:
    """Plain values as an array of the bytes of their JSON."""
    return _text_array(json.dumps(content))


def json_content(array: UInt8[np.ndarray, " n"], name: str) -> Any:
    """Plain values from an array of `json_array`.

    Raises:
        InputError: naming the array, if it is no JSON.
    """
    try:
        return json.loads(array.tobytes())
    except (ValueError, RecursionError) as error:
        raise InputError(f"{name} is no JSON") from error


_STORED = "stored"
_RESIDUAL = "residual"
_MECHANISM = "mechanism"
_CONTACT = "contact"


class EnergyColumn(NamedTuple):
    """One column of the energies in a file."""

    body: int
    """Number of the body; -1 for all together."""
    kind: str
    """"stored", "residual", "mechanism" or "contact"."""
    name: str
    """Name of the mechanism or of the contact; empty for the others."""


def energy_columns(
    energy: Energy, body: int = -1
) -> Iterator[tuple[EnergyColumn, Float[np.ndarray, " t"]]]:
    """Columns of the energies of all bodies together, then of each one [J]."""
    yield EnergyColumn(body, _STORED, ""), np.asarray(energy.stored_J)
    yield EnergyColumn(body, _RESIDUAL, ""), np.asarray(energy.residual_relative)
    for name, heat in energy.mechanisms.items():
        yield EnergyColumn(body, _MECHANISM, name), np.asarray(heat)
    for name, heat in energy.contacts.items():
        yield EnergyColumn(body, _CONTACT, name), np.asarray(heat)
    for number, of_body in enumerate(energy.bodies):
        yield from energy_columns(of_body, number)


def energy_of_columns(run: "RunArrays") -> Energy | None:
    """The energies of a run from their columns; None for a steady state.

    Raises:
        InputError: if columns are missing or have no name.
    """
    if run.energy is None or run.energy_columns is None:
        return None
    listed = json_content(run.energy_columns, "energy_columns")
    try:
        columns = [EnergyColumn(int(b), str(kind), str(n)) for b, kind, n in listed]
    except (TypeError, ValueError) as error:
        raise InputError("energy_columns is not a list of names") from error
    if len(columns) != run.energy.shape[1]:
        raise InputError(
            f"energy has {run.energy.shape[1]} columns, and {len(columns)} have a name"
        )
    heats = dict(zip(columns, run.energy.T, strict=True))

    def of_body(body: int, bodies: tuple[Energy, ...] = ()) -> Energy:
        def named(kind: str) -> dict[str, Values]:
            return {
                column.name: heat
                for column, heat in heats.items()
                if column[:2] == (body, kind)
            }

        try:
            return Energy(
                stored_J=heats[EnergyColumn(body, _STORED, "")],
                mechanisms=named(_MECHANISM),
                contacts=named(_CONTACT),
                bodies=bodies,
                residual_relative=heats[EnergyColumn(body, _RESIDUAL, "")],
            )
        except KeyError as error:
            raise InputError("energy lacks a column of a body") from error

    count = run.mean_temperature.shape[1]
    return of_body(-1, tuple(of_body(body) for body in range(count)))


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
