"""The config of a scene, complete, with the checks between its parts."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import Field, ValidationError
from typing_extensions import override

import jaxthermo

from ...errors import InputError, located
from ..types.files import FoundPath
from ..types.model import (
    Data,
    Location,
    Mistake,
    Model,
    build,
    field_parts,
    models_within,
)
from ..types.quantities import Flag, NotEmpty, Position, StartTemperature, Unit, Whole
from .assembly import AssemblyConfig, with_assembly
from .body import BodyConfig
from .image import CameraConfig, ImageConfig, PinholeConfig
from .joints import JointsConfig
from .named_bodies import equal_names, with_numbers
from .outdoors import ALL_TERMS, OutdoorsConfig
from .solver import AutoSolver, SolverConfig
from .terms import TermConfig
from .time import TimeConfig


if TYPE_CHECKING:
    from ...scene.scene import Scene

# Both compute the whole emission of a surface: with two it would count twice.
_EMISSION = ("surroundings", "radiative_exchange")
_AnyModel = TypeVar("_AnyModel", bound=Model)


class _TruthConfig(Model):
    """Comparison of the run with a finer one of the same bodies."""

    reference: FoundPath
    """`solution.npz` of a run with voxels at least twice as fine, which saved all times
    that this run saves."""
    points: Annotated[Whole, Field(ge=100, le=10_000_000)] = 10_000
    """Number of points on the meshes at which the temperatures are compared."""
    seed: Annotated[Whole, Field(ge=0)] = 0
    """Seed of the random points."""


class SceneConfig(Model, builds="Scene"):
    """A scene, its run and its images, in SI units."""

    name: Annotated[str, Field(min_length=1)] | None = None
    """Title of the frames; the file's name if not given."""
    allow_extreme_temperatures: Flag = False
    """Accept temperatures below 150 K, mostly mistaken Celsius, and above 6000 K."""
    dtype: Literal["float32", "float64"] = "float32"
    """Precision of the state."""
    probes: dict[Annotated[str, Field(min_length=1)], Position] = {}
    """Thermocouples by name: points in the world at the start [m], on or in a body,
    with which they move."""
    surface_outputs: tuple[Literal["heat_flux", "heat_transfer_coefficient"], ...] = ()
    """Quantities that are saved for every fragment, in addition to its temperature."""
    temperature: StartTemperature | None = None
    """Temperature at the start of the bodies that have none of their own [K]; `steady`
    for their steady state with the values of the start."""
    bodies: Annotated[tuple[BodyConfig, ...], NotEmpty] = ()
    assembly: AssemblyConfig | None = None
    """Further bodies, after `bodies`, from the parts of one file; a run has them in its
    `config.yaml` as bodies."""
    joints: JointsConfig | None = None
    """Conduction between bodies that touch, in addition to `terms`."""
    terms: tuple[TermConfig, ...] = ()
    """Everything that heats and cools the bodies; other mechanisms are not computed."""
    outdoors: OutdoorsConfig | None = None
    """Sun, sky, ground and wind of a place and date, in addition to `terms`."""
    time: TimeConfig
    solver: SolverConfig = AutoSolver()
    """Time integration, by default chosen from the scene."""
    truth: _TruthConfig | None = None
    """Finer run to compare with; the error is written to `summary.json`."""
    camera: CameraConfig = PinholeConfig()
    """Camera, by default chosen to show all bodies."""
    image: ImageConfig = ImageConfig()

    @classmethod
    @override
    def completed(cls, data: Data, context: Any) -> Data:
        if data.get("assembly") is not None:
            assembly = _with_start(data, data["assembly"])
            data = with_assembly({**data, "assembly": assembly}, context)
        bodies = data.get("bodies")
        if not isinstance(bodies, list):
            return data
        data = with_numbers(data)
        # The scene says where a skin is of use, and after which time.
        completed = [
            _with_start(data, _with_skin(data, number, body))
            if isinstance(body, dict)
            else body
            for number, body in enumerate(bodies)
        ]
        return {**data, "bodies": completed}

    def build(self, *args: Any) -> "Scene":
        """The scene, with its meshes loaded and voxelized.

        Raises:
            InputError: for a mesh, labels, mask or fit card that cannot be used.
        """
        structures: dict[str, object] = {}
        numbered = enumerate(self.bodies)
        bodies = tuple(body.build_sharing(structures, n) for n, body in numbered)
        return self.scene(bodies=self.with_air(bodies), terms=self.build_terms())

    def with_air(self, bodies: tuple[Any, ...]) -> tuple[Any, ...]:
        """The built bodies, followed by the air in those whose air is computed.

        Raises:
            InputError: for air in a body that has no cavity.
        """
        airs = [
            config.interior.build_air(body, number)
            for number, (config, body) in enumerate(
                zip(self.bodies, bodies, strict=True)
            )
            if config.interior is not None and config.air is not None
        ]
        return (*bodies, *airs)

    def build_terms(self) -> tuple[Any, ...]:
        """The terms, followed by those of the joints, the bodies, and of `outdoors`.

        Raises:
            InputError: for weather that cannot be used, or without its extra.
        """
        outside = ()
        if self.outdoors is not None:
            outside = self.outdoors.build(self.time.last)
        outer_air = next((t.temperature for t in outside if t.is_convective), None)
        # The bodies of air follow all others.
        air = itertools.count(len(self.bodies))
        of_bodies = [
            term
            for number, body in enumerate(self.bodies)
            for term in body.build_terms(
                number,
                air=None if body.air is None else next(air),
                outdoors=outer_air,
            )
        ]
        return (*build(self.terms), *self.build_joints(), *of_bodies, *outside)

    def build_joints(self) -> tuple[Any, ...]:
        """The terms of `joints`."""
        has_sheets = any(body.wall is not None for body in self.bodies)
        joints = self.joints or JointsConfig()
        return joints.build_terms(self._numbers, has_sheets)

    @property
    def _numbers(self) -> dict[str, int]:
        """Number of each body that has a name."""
        return {
            body.name: number
            for number, body in enumerate(self.bodies)
            if body.name is not None
        }

    def scene(self, bodies: tuple[Any, ...], terms: tuple[Any, ...]) -> "Scene":
        """A scene of these bodies and terms, with the options of this config.

        Raises:
            InputError: where bodies start at a steady state and there is none.
        """
        scene = self.target()(
            bodies=bodies,
            terms=terms,
            dtype=self.dtype,
            allow_extreme_temperatures=self.allow_extreme_temperatures,
            probes=self.probes,
            surface_outputs=self.surface_outputs,
        )
        steady = self.steady_bodies
        if not steady:
            return scene
        with located("temperature: steady"):
            try:
                return jaxthermo.start_steady(scene, steady)
            except RuntimeError as error:
                raise InputError(str(error)) from error

    @property
    def steady_bodies(self) -> tuple[int, ...]:
        """Numbers of the bodies that start at a steady state, and of air in them."""
        starts = [body.starts_steady for body in self.bodies]
        # The bodies of air follow all others.
        starts += [
            body.starts_steady and body.air.temperature is None
            for body in self.bodies
            if body.air is not None
        ]
        return tuple(number for number, is_steady in enumerate(starts) if is_steady)

    @classmethod
    @override
    def raw_mistakes(cls, data: Mapping[str, object]) -> list[Mistake]:
        # Sections that contradict each other are reported even if others are invalid.
        return [
            *_missing_bodies(data),
            *equal_names(data),
            *_unsaved_frames(data),
            *_unseen_measurements(data),
            *_second_emission(data),
            *_second_occlusion(data),
        ]

    @override
    def mistakes(self) -> list[Mistake]:
        joints = self.joints or JointsConfig()
        wrong = joints.wrong_names(self._numbers)
        mistakes = [(("joints", *where), line) for where, line in wrong]
        return [*mistakes, *self._missing_outer_air()]

    def _missing_outer_air(self) -> list[Mistake]:
        outdoors = () if self.outdoors is None else self.outdoors.terms
        if {"wind", "convection"} & {*outdoors}:
            return []
        message = "missing: give the temperature of the air that enters by `exchange`"
        return [
            (("bodies", number, "interior", "air", "outside"), message)
            for number, body in enumerate(self.bodies)
            if body.air is not None
            and body.air.is_exchanged
            and body.air.outside is None
        ]


def _with_start(data: Mapping[str, Any], body: Any) -> Any:
    """A body or assembly with the temperature of the scene, where it has none."""
    start = data.get("temperature")
    if start is None or not isinstance(body, dict):
        return body
    if body.get("temperature") is not None:
        return body
    return {**body, "temperature": start}


# Terms that act inside bodies, or between two.
_NOT_ON_SURFACES = {"heat_source", "contact", "seam"}


def _with_skin(
    data: Mapping[str, Any], number: int, body: Mapping[str, Any]
) -> Mapping[str, Any]:
    """A body whose skin has the values that the scene gives it, where it has none."""
    skin = body.get("skin")
    if skin is None:
        return body
    if not isinstance(skin, dict):
        skin = {"cells": skin}
    defaults = {}
    time = data.get("time")
    if isinstance(time, dict):
        saved = time.get("save_at")
        first = saved[0] if isinstance(saved, list) and saved else None
        defaults["shortest_time"] = time.get("save_every", first)
    defaults["on"] = _surface_of_terms(data, number)
    from_scene = {key: value for key, value in defaults.items() if value is not None}
    return {**body, "skin": {**from_scene, **skin}}


def _surface_of_terms(data: Mapping[str, Any], number: int) -> Mapping[str, Any] | None:
    """Part of a body on which terms act; None for all of its surface."""
    areas = []
    terms = [term for term in _terms(data) if term.get("kind") not in _NOT_ON_SURFACES]
    for term in terms:
        on = term.get("on")
        if not isinstance(on, dict) or not on.keys() <= {"side", "region", "fragments"}:
            return None
        bodies = {body for _, body in _bodies_within((), on)} or {0}
        if number in bodies:
            areas.append(on)
    return {"any": areas} if areas and not data.get("outdoors") else None


def _missing_bodies(data: Mapping[str, object]) -> list[Mistake]:
    count = len(list(_items(data.get("bodies"))))
    named = [*_bodies_within(("outdoors",), data.get("outdoors"))]
    for i, term in enumerate(_terms(data)):
        named += [(("terms", i, *where), body) for where, body in _named_bodies(term)]
    return [
        (location, f"there is no body {body}; the last one is {count - 1}")
        for location, body in named
        if type(body) is int and body >= count > 0
    ]


# The locations and numbers of bodies in a term that is not validated yet.
def _named_bodies(term: Mapping[str, object]) -> Iterator[tuple[Location, object]]:
    for key in ("on", "within", "cylinders"):
        yield from _bodies_within((key,), term.get(key))
    for i, body in _items(term.get("bodies")):
        yield ("bodies", i), body


# Selections may be combinations of others, at any depth.
def _bodies_within(
    location: Location, selection: object
) -> Iterator[tuple[Location, object]]:
    for key, value in _items(selection):
        if key == "body":
            yield (*location, key), value
        else:
            yield from _bodies_within((*location, key), value)


def _items(value: object) -> Iterable[tuple[str | int, object]]:
    if isinstance(value, dict):
        return value.items()
    return enumerate(value) if isinstance(value, list) else ()


def _second_emission(data: Mapping[str, object]) -> list[Mistake]:
    terms = _terms(data)
    emitting = [i for i, term in enumerate(terms) if term.get("kind") in _EMISSION]
    outside = data.get("outdoors")
    if isinstance(outside, dict) and "sky" in (outside.get("terms") or ALL_TERMS):
        # The sky of `outdoors` is on all surfaces.
        return [
            (
                ("terms", i),
                f"{terms[i]['kind']} would count the emission twice, besides the sky "
                "of outdoors: remove it, or list `outdoors.terms` without sky",
            )
            for i in emitting
        ]
    # Parts of the surface may have different surroundings, but only one exchange.
    if all(terms[i].get("on") is not None for i in emitting):
        exchange = [i for i in emitting if terms[i]["kind"] == "radiative_exchange"]
        return [
            (
                ("terms", i),
                "a second radiative_exchange would not see the surfaces of the one in "
                f"terms.{exchange[0]}: give one, with `on: {{any: [.., ..]}}`",
            )
            for i in exchange[1:]
        ]
    first, *second = emitting
    return [
        (
            ("terms", i),
            f"{terms[i]['kind']} would count the emission twice, after "
            f"{terms[first]['kind']} in terms.{first}: give one of them, or each "
            "its own `on`",
        )
        for i in second
    ]


def _second_occlusion(data: Mapping[str, object]) -> list[Mistake]:
    image = data.get("image")
    if not isinstance(image, dict) or image.get("occlusion") in (None, "none"):
        return []
    detecting = [
        f"terms.{i}"
        for i, term in enumerate(_terms(data))
        if term.get("kind") == "radiative_exchange" or term.get("occlusion")
    ]
    outdoors = data.get("outdoors")
    if isinstance(outdoors, dict) and outdoors.get("occlusion"):
        detecting.append("outdoors")
    return [
        (
            ("image", "occlusion"),
            f"would hide the surroundings twice, after {name}, which detects "
            "occlusion in the heat balance: leave out one of them",
        )
        for name in detecting
    ]


# Terms that are no mappings count as empty: their own mistakes are reported elsewhere.
def _terms(data: Mapping[str, object]) -> list[Mapping[str, Any]]:
    terms = data.get("terms")
    if not isinstance(terms, list):
        return []
    return [term if isinstance(term, dict) else {} for term in terms]


def _unsaved_frames(data: Mapping[str, object]) -> list[Mistake]:
    time = _if_valid(TimeConfig, data.get("time"))
    image = data.get("image")
    frames = image.get("frames") if isinstance(image, dict) else None
    # The frames alone: other values of the image may have mistakes of their own.
    image = _if_valid(ImageConfig, {"frames": frames})
    if time is None or image is None:
        return []
    return [
        (("image", "frames", i), f"{frame:g} s is not a saved time")
        for i, frame in enumerate(image.frames or ())
        if not _is_among(frame, time.save_times)
    ]


def _is_among(time: float, save_times: tuple[float, ...]) -> bool:
    return any(math.isclose(time, saved, rel_tol=1e-9) for saved in save_times)


def _unseen_measurements(data: Mapping[str, object]) -> list[Mistake]:
    image = data.get("image")
    camera = data.get("camera")
    measurements = image.get("measurements") if isinstance(image, dict) else None
    image = _if_valid(ImageConfig, {"measurements": measurements or []})
    # The size alone: it means the same for all kinds of cameras.
    sizes = camera if isinstance(camera, dict) else {}
    size = {key: sizes[key] for key in ("width", "height") if key in sizes}
    view = _if_valid(PinholeConfig, {"kind": "pinhole", **size})
    if image is None or view is None:
        return []
    return [
        (("image", "measurements", k, *location), message)
        for k, measurement in enumerate(image.measurements)
        for location, message in measurement.outside(view.width, view.height)
    ]


def _if_valid(model: type[_AnyModel], data: Any) -> _AnyModel | None:
    try:
        return model.model_validate(data)
    except ValidationError:
        return None


@cache
def _units() -> dict[str, Unit]:
    # Keys with several units, such as `length`, are left out.
    units_by_key: dict[str, set[Unit]] = {}
    for model in models_within(SceneConfig):
        for key in model.model_fields:
            markers = field_parts(model, key)
            field_units = {marker for marker in markers if isinstance(marker, Unit)}
            units_by_key.setdefault(key, set()).update(field_units)
    return {key: units.pop() for key, units in units_by_key.items() if len(units) == 1}


@cache
def _lowest() -> dict[str, float]:
    # The lowest value that all fields of a key allow; minus infinity for any.
    lowest: dict[str, float] = {}
    for model in models_within(SceneConfig):
        for key in model.model_fields:
            bounds = [
                float(bound)
                for marker in field_parts(model, key)
                for limit in (marker, *getattr(marker, "metadata", ()))
                for bound in (getattr(limit, "ge", None), getattr(limit, "gt", None))
                if isinstance(bound, int | float)
            ]
            lowest_of_field = max(bounds, default=-math.inf)
            lowest[key] = min(lowest.get(key, math.inf), lowest_of_field)
    return lowest


def lowest_of(path: str) -> float | None:
    """The lowest value of a number of a scene by its definition.

    Minus infinity for a number of either sign, None for a path without a unit; `path`
    is as in `unit_of`.
    """
    key = _last_key_with_unit(path)
    return None if key is None else _lowest()[key]


def unit_of(path: str) -> Unit | None:
    """The unit of a number of a scene; None for a path without a unit.

    Args:
        path: dotted, such as "terms.0.irradiance" or "material.conductivity"; the last
            key with a unit counts.
    """
    key = _last_key_with_unit(path)
    return None if key is None else _units()[key]


def _last_key_with_unit(path: str) -> str | None:
    units = _units()
    return next((key for key in reversed(path.split(".")) if key in units), None)
