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
from ..energy import Energy, HeatRates


FORMAT_VERSION = 7
"""Version of the file's layout; version 3 added the checksum, version 5 the radiation
that reaches surfaces, version 6 what surrounds them and the energies of each body,
version 7 the receipt, the summary of the run, and the heat rates of a steady state."""

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
    # Columns of the energies of a run, or of the heat rates of a steady state, and
    # their names as JSON in UTF-8, see `balance_columns`.
    energy: Float[np.ndarray, "t e"] | None = None
    heat_rates: Float[np.ndarray, "1 e"] | None = None
    balance_columns: UInt8[np.ndarray, " c"] | None = None
    # `Receipt` and `RunSummary` as JSON in UTF-8.
    receipt: UInt8[np.ndarray, " m"] | None = None
    run: UInt8[np.ndarray, " n"] | None = None
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


class BalanceColumn(NamedTuple):
    """One column of the energies or heat rates in a file."""

    body: int
    """Number of the body; -1 for all together."""
    kind: str
    """"stored", "residual", "mechanism" or "contact"."""
    name: str
    """Name of the mechanism or of the contact; empty for the others."""


def balance_columns(
    balance: Energy | HeatRates, body: int = -1
) -> Iterator[tuple[BalanceColumn, Float[np.ndarray, "*t"]]]:
    """Columns of the energies [J] or heat rates [W] of all bodies, then of each."""
    if isinstance(balance, Energy):
        yield BalanceColumn(body, _STORED, ""), np.asarray(balance.stored_J)
    yield BalanceColumn(body, _RESIDUAL, ""), np.asarray(balance.residual_relative)
    for name, heat in balance.mechanisms.items():
        yield BalanceColumn(body, _MECHANISM, name), np.asarray(heat)
    for name, heat in balance.contacts.items():
        yield BalanceColumn(body, _CONTACT, name), np.asarray(heat)
    for number, of_body in enumerate(balance.bodies):
        yield from balance_columns(of_body, number)


class _HeatColumns(NamedTuple):
    """Columns of energies or heat rates by body and kind, and by their names."""

    values: dict[tuple[int, str], dict[str, Values]]

    def value(self, body: int, kind: str) -> Values:
        """The one column of a kind of a body.

        Raises:
            InputError: if it is missing.
        """
        try:
            return self.values[body, kind][""]
        except KeyError as error:
            raise InputError(f"the column {kind!r} of a body is missing") from error

    def named(self, body: int, kind: str) -> dict[str, Values]:
        """Columns of a kind of a body by their names."""
        return self.values.get((body, kind), {})


def _heat_columns(values: Float[np.ndarray, "t e"], run: RunArrays) -> _HeatColumns:
    if run.balance_columns is None:
        raise InputError("energies or heat rates have no names")
    listed = json_content(run.balance_columns, "balance_columns")
    try:
        columns = [BalanceColumn(int(b), str(kind), str(n)) for b, kind, n in listed]
    except (TypeError, ValueError) as error:
        raise InputError("balance_columns is not a list of names") from error
    if len(columns) != values.shape[1]:
        raise InputError(
            f"{values.shape[1]} columns of a balance, and {len(columns)} have a name"
        )
    by_body: dict[tuple[int, str], dict[str, Values]] = {}
    for (body, kind, name), heat in zip(columns, values.T, strict=True):
        by_body.setdefault((body, kind), {})[name] = heat
    return _HeatColumns(by_body)


def stored_energy(run: RunArrays) -> Energy | None:
    """The energies of a run from their columns; None for a steady state.

    Raises:
        InputError: if columns are missing or have no name.
    """
    if run.energy is None:
        return None
    columns = _heat_columns(run.energy, run)

    def of_body(body: int, bodies: tuple[Energy, ...] = ()) -> Energy:
        return Energy(
            stored_J=columns.value(body, _STORED),
            mechanisms=columns.named(body, _MECHANISM),
            contacts=columns.named(body, _CONTACT),
            bodies=bodies,
            residual_relative=columns.value(body, _RESIDUAL),
        )

    count = run.mean_temperature.shape[1]
    return of_body(-1, tuple(of_body(body) for body in range(count)))


def stored_heat_rates(run: RunArrays) -> HeatRates | None:
    """The heat rates of a steady state from their columns; None for a run.

    Raises:
        InputError: if columns are missing or have no name.
    """
    if run.heat_rates is None:
        return None
    columns = _heat_columns(run.heat_rates, run)

    def of_body(body: int, bodies: tuple[HeatRates, ...] = ()) -> HeatRates:
        return HeatRates(
            mechanisms=_only_rows(columns.named(body, _MECHANISM)),
            contacts=_only_rows(columns.named(body, _CONTACT)),
            bodies=bodies,
            residual_relative=columns.value(body, _RESIDUAL).reshape(()),
        )

    count = run.mean_temperature.shape[1]
    return of_body(-1, tuple(of_body(body) for body in range(count)))


def _only_rows(heats: dict[str, Values]) -> dict[str, Values]:
    return {name: heat.reshape(()) for name, heat in heats.items()}


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
