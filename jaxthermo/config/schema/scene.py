"""The config of a scene, complete, with the checks between its parts."""

import math
from collections.abc import Iterable, Iterator
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import Field, ValidationError
from typing_extensions import override

from ..types.files import FoundPath
from ..types.model import Location, Mistake, Model, build, field_parts, models_within
from ..types.quantities import Flag, NotEmpty, Position, PositiveTime, Unit, Whole
from ..types.varying import not_increasing
from .body import BodyConfig
from .image import CameraConfig, ImageConfig, PinholeConfig
from .outdoors import ALL_TERMS, OutdoorsConfig
from .solver import AutoSolver, SolverConfig
from .terms import TermConfig


if TYPE_CHECKING:
    from ...scene.scene import Scene

# With more saved times a run would fill the memory.
_MAX_SAVES = 100_000
# Both compute the whole emission of a surface: with two it would count twice.
_EMISSION = ("surroundings", "radiative_exchange")
AnyModel = TypeVar("AnyModel", bound=Model)


class TimeConfig(Model):
    """The end of the run, and the times at which its state is saved."""

    end: PositiveTime
    """End of the run [s]; it stops earlier if the last saved time is before."""
    save_at: Annotated[tuple[PositiveTime, ...], NotEmpty] | None = None
    """Times at which the state is saved [s]."""
    save_every: PositiveTime | None = None
    """Interval between saved times, instead of a list [s]."""

    exactly_one: ClassVar = (("save_at", "save_every"),)

    @override
    def mistakes(self) -> list[Mistake]:
        every, listed = self.save_every, self.save_at or ()
        times = [(("save_at", i), time) for i, time in enumerate(listed)]
        times += [] if every is None else [(("save_every",), every)]
        found = not_increasing(listed, "save_at", "s")
        found += [
            (where, f"{time:g} s is after the end, {self.end:g} s")
            for where, time in times
            if time > self.end
        ]
        if every is not None and self.end / every > _MAX_SAVES:
            found.append((("save_every",), f"would save more than {_MAX_SAVES} times"))
        return found

    @property
    def last(self) -> float:
        """Time at which the run stops [s]: later results would not be saved."""
        return self.save_times[-1]

    @property
    def save_times(self) -> tuple[float, ...]:
        """Times at which the state is saved [s]; with `save_every` also the end."""
        if self.save_every is None:
            return self.save_at or ()
        # An interval that rounding leaves before the end is not a step of its own.
        whole = round(self.end / self.save_every * (1.0 - 1e-9) - 0.5)
        return (*(self.save_every * (i + 1) for i in range(whole)), self.end)


class TruthConfig(Model):
    """Comparison of the run with a finer one of the same bodies."""

    reference: FoundPath
    """`solution.npz` of that run, with voxels at least twice as fine; it has to save
    all times that this one saves."""
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
    """Saved for every fragment besides its temperature."""
    bodies: Annotated[tuple[BodyConfig, ...], NotEmpty]
    terms: tuple[TermConfig, ...] = ()
    """All that heats and cools the bodies; mechanisms not listed are not computed."""
    outdoors: OutdoorsConfig | None = None
    """Sun, sky, ground and wind of a place and date, besides `terms`."""
    time: TimeConfig
    solver: SolverConfig = AutoSolver()
    """Time integration; chosen from the scene if not given."""
    truth: TruthConfig | None = None
    """Finer run to compare with; the error is in `summary.json`."""
    camera: CameraConfig = PinholeConfig()
    """Camera; what is not given is chosen to show all bodies."""
    image: ImageConfig = ImageConfig()

    def build(self, *args: Any) -> "Scene":
        """The scene, with its meshes loaded and voxelized.

        Raises:
            InputError: for a mesh, labels, mask or fit card that cannot be used.
        """
        bodies = build(self.bodies)
        return self.scene(bodies, self.build_terms())

    def build_terms(self) -> tuple[Any, ...]:
        """The terms, and after them those of `outdoors`.

        Raises:
            InputError: for weather that cannot be used, or without its extra.
        """
        outside = self.outdoors
        added = () if outside is None else outside.build(self.time.last)
        return (*build(self.terms), *added)

    def scene(self, bodies: tuple[Any, ...], terms: tuple[Any, ...]) -> "Scene":
        """A scene of these bodies and terms, with the options of this config."""
        return self.target()(
            bodies=bodies,
            terms=terms,
            dtype=self.dtype,
            allow_extreme_temperatures=self.allow_extreme_temperatures,
            probes=self.probes,
            surface_outputs=self.surface_outputs,
        )

    @classmethod
    @override
    def raw_mistakes(cls, data: dict[str, Any]) -> list[Mistake]:
        # Parts that do not fit together are reported even while others are wrong.
        return [
            *_missing_bodies(data),
            *_unsaved_frames(data),
            *_unseen_measurements(data),
            *_second_emission(data),
            *_second_occlusion(data),
        ]


def _missing_bodies(data: dict[str, Any]) -> list[Mistake]:
    bodies = data.get("bodies")
    count = len(bodies) if isinstance(bodies, list) else 0
    return [
        (("terms", i, *where), f"there is no body {body}; the last one is {count - 1}")
        for i, term in enumerate(_terms(data))
        for where, body in _named_bodies(term if isinstance(term, dict) else {})
        if type(body) is int and body >= count > 0
    ]


# The locations and numbers of bodies in a term as it is written.
def _named_bodies(term: dict[str, Any]) -> Iterator[tuple[Location, Any]]:
    for key in ("on", "within", "cylinders"):
        yield from _bodies_within((key,), term.get(key))
    for i, body in _items(term.get("bodies")):
        yield ("bodies", i), body


# Selections may be combinations of others, at any depth.
def _bodies_within(where: Location, given: Any) -> Iterator[tuple[Location, Any]]:
    for key, value in _items(given):
        if key == "body":
            yield (*where, key), value
        else:
            yield from _bodies_within((*where, key), value)


def _items(value: Any) -> Iterable[tuple[str | int, Any]]:
    if isinstance(value, dict):
        return value.items()
    return enumerate(value) if isinstance(value, list) else ()


def _second_emission(data: dict[str, Any]) -> list[Mistake]:
    terms = [term if isinstance(term, dict) else {} for term in _terms(data)]
    found = [i for i, term in enumerate(terms) if term.get("kind") in _EMISSION]
    outside = data.get("outdoors")
    if isinstance(outside, dict) and "sky" in (outside.get("terms") or ALL_TERMS):
        # That of `outdoors` is on all surfaces.
        return [
            (
                ("terms", i),
                f"{terms[i]['kind']} would count the emission twice, besides the sky "
                "of outdoors: remove it, or list `outdoors.terms` without sky",
            )
            for i in found
        ]
    # Parts of the surface may have surroundings of their own, but one exchange.
    if all(terms[i].get("on") is not None for i in found):
        exchange = [i for i in found if terms[i]["kind"] == "radiative_exchange"]
        return [
            (
                ("terms", i),
                "a second radiative_exchange would not see the surfaces of the one in "
                f"terms.{exchange[0]}: give one, with `on: {{any: [.., ..]}}`",
            )
            for i in exchange[1:]
        ]
    return [
        (
            ("terms", i),
            f"{terms[i]['kind']} would count the emission twice, after "
            f"{terms[found[0]]['kind']} in terms.{found[0]}: give one of them, or each "
            "its own `on`",
        )
        for i in found[1:]
    ]


def _second_occlusion(data: dict[str, Any]) -> list[Mistake]:
    image = data.get("image")
    if not isinstance(image, dict) or image.get("occlusion") in (None, "none"):
        return []
    detecting = [
        f"terms.{i}"
        for i, term in enumerate(_terms(data))
        if isinstance(term, dict)
        and (term.get("kind") == "radiative_exchange" or term.get("occlusion"))
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


def _terms(data: dict[str, Any]) -> list[Any]:
    terms = data.get("terms")
    return terms if isinstance(terms, list) else []


def _unsaved_frames(data: dict[str, Any]) -> list[Mistake]:
    time = _if_valid(TimeConfig, data.get("time"))
    image = data.get("image")
    frames = image.get("frames") if isinstance(image, dict) else None
    # The frames alone: the rest of the image may have mistakes of its own.
    image = _if_valid(ImageConfig, {"frames": frames})
    if time is None or image is None:
        return []
    return [
        (("image", "frames", i), f"{frame:g} s is not a saved time")
        for i, frame in enumerate(image.frames or ())
        if not any(math.isclose(frame, t, rel_tol=1e-9) for t in time.save_times)
    ]


def _unseen_measurements(data: dict[str, Any]) -> list[Mistake]:
    image, camera = data.get("image"), data.get("camera")
    given = image.get("measurements") if isinstance(image, dict) else None
    image = _if_valid(ImageConfig, {"measurements": given or []})
    # The size alone, whatever kind of camera it is.
    sizes = camera if isinstance(camera, dict) else {}
    size = {key: sizes[key] for key in ("width", "height") if key in sizes}
    view = _if_valid(PinholeConfig, {"kind": "pinhole", **size})
    if image is None or view is None:
        return []
    return [
        (("image", "measurements", k, *where), message)
        for k, each in enumerate(image.measurements)
        for where, message in each.outside(view.width, view.height)
    ]


def _if_valid(model: type[AnyModel], data: Any) -> AnyModel | None:
    try:
        return model.model_validate(data)
    except ValidationError:
        return None


@cache
def _units() -> dict[str, Unit]:
    # Keys that have several units, such as `length` of a wake, have none here.
    found: dict[str, set[Unit]] = {}
    for model in models_within(SceneConfig):
        for key in model.model_fields:
            given = {p for p in field_parts(model, key) if isinstance(p, Unit)}
            found.setdefault(key, set()).update(given)
    return {key: units.pop() for key, units in found.items() if len(units) == 1}


def unit_of(path: str) -> Unit | None:
    """The unit of a number of a scene; None for a key that has no unit of its own.

    Args:
        path: dotted, such as "terms.0.irradiance" or "material.conductivity"; the last
            key with a unit counts.
    """
    units = _units()
    return next((units[key] for key in reversed(path.split(".")) if key in units), None)
