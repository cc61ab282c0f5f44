"""The config of a scene, complete."""

import math
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, ValidationError

from .fields import Auto, Flag, NotEmpty, PositiveTime
from .model import Mistake, Model
from .schema_geometry import BodyConfig
from .schema_image import CameraConfig, ImageConfig, PinholeConfig
from .schema_terms import TermConfig
from .schema_time import TimeConfig


class SolverConfig(Model):
    """How time is stepped; without `dt`, at the step that the terms state as stable."""

    kind: Literal["forward_euler"] = "forward_euler"
    dt: Annotated[PositiveTime | None, Auto] = None


class SceneConfig(Model):
    """A scene, its run and its images, in SI units."""

    name: Annotated[str, Field(min_length=1)] | None = None
    allow_extreme_temperatures: Flag = False
    dtype: Literal["float32", "float64"] = "float32"
    bodies: Annotated[tuple[BodyConfig, ...], NotEmpty]
    terms: tuple[TermConfig, ...] = ()
    time: TimeConfig
    solver: SolverConfig = SolverConfig()
    camera: CameraConfig = PinholeConfig()
    image: ImageConfig = ImageConfig()

    @classmethod
    def raw_mistakes(cls, data: dict[str, Any]) -> list[Mistake]:
        """Parts that do not fit together, even while other parts are wrong."""
        return [*_no_such_body(data), *_not_saved(data), *_twice_surrounded(data)]


def _no_such_body(data: dict[str, Any]) -> list[Mistake]:
    bodies, terms = data.get("bodies"), data.get("terms")
    if not isinstance(bodies, list) or not isinstance(terms, list):
        return []
    found: list[Mistake] = []
    for i, term in enumerate(terms):
        on = term.get("on") if isinstance(term, dict) else None
        for key, place in on.items() if isinstance(on, dict) else ():
            body = place.get("body", 0) if isinstance(place, dict) else 0
            if type(body) is int and body >= len(bodies) > 0:
                message = f"there is no body {body}; the last one is {len(bodies) - 1}"
                found.append((("terms", i, "on", key, "body"), message))
    return found


def _twice_surrounded(data: dict[str, Any]) -> list[Mistake]:
    terms = data.get("terms")
    kinds = [
        term.get("kind") if isinstance(term, dict) else None
        for term in (terms if isinstance(terms, list) else [])
    ]
    found = [i for i, kind in enumerate(kinds) if kind == "surroundings"]
    message = "a second surroundings would count the emission twice; give one"
    return [(("terms", i), message) for i in found[1:]]


def _not_saved(data: dict[str, Any]) -> list[Mistake]:
    time = _if_valid(TimeConfig, data.get("time"))
    image = data.get("image")
    frames = image.get("frames") if isinstance(image, dict) else None
    image = _if_valid(ImageConfig, {"frames": frames})
    if time is None or image is None:
        return []
    return [
        (("image", "frames", i), f"{frame:g} s is not a saved time")
        for i, frame in enumerate(image.frames or ())
        if not any(math.isclose(frame, t, rel_tol=1e-9) for t in time.save_times)
    ]


AnyModel = TypeVar("AnyModel", bound=Model)


def _if_valid(kind: type[AnyModel], data: Any) -> AnyModel | None:
    try:
        return kind.model_validate(data)
    except ValidationError:
        return None
