"""Bodies of air in a scene: which they are, and what encloses them."""

from ..errors import InputError
from ..physics.convection.enclosed_air import EnclosedAir
from ..physics.convection.interior_air import InteriorAir
from ..structures.kinds.air import AirVolume
from .scene import Body, Scene


def bodies_with_surface(scene: Scene) -> tuple[Body, ...]:
    """The bodies that have a surface, whose numbers are the first ones."""
    pairs = zip(scene.bodies, scene.structures, strict=True)
    return tuple(body for body, s in pairs if not isinstance(s, AirVolume))


def bodies_around_air(scene: Scene) -> dict[int, int]:
    """Number of the body that encloses each body of air, by the number of the air."""
    pairs = [t.named_bodies for t in scene.terms if isinstance(t, EnclosedAir)]
    return {air: body for body, air in pairs}


def check_airs(scene: Scene) -> None:
    """Raise if bodies and terms of air do not belong together one by one."""
    count = len(bodies_with_surface(scene))
    if not count:
        raise InputError("Scene(bodies=): all are air: give a body that encloses it")
    enclosed: dict[int, int] = {}
    air_terms: dict[int, int] = {}
    for number, term in enumerate(scene.terms):
        if not isinstance(term, InteriorAir | EnclosedAir):
            continue
        body, *airs = term.named_bodies
        if body in enclosed:
            raise InputError(
                f"terms[{number}]: body {body} has the air of terms["
                f"{enclosed[body]}] already: give one of both"
            )
        enclosed[body] = number
        for air in airs:
            if not isinstance(scene.structures[air], AirVolume):
                raise InputError(
                    f"terms[{number}]: EnclosedAir(air={air}): body {air} is no "
                    "AirVolume: name the body of air"
                )
            if air in air_terms:
                raise InputError(
                    f"terms[{number}]: EnclosedAir(air={air}): the air of terms["
                    f"{air_terms[air]}]: give each its own AirVolume"
                )
            air_terms[air] = number
    for number, structure in enumerate(scene.structures):
        if not isinstance(structure, AirVolume):
            continue
        if number < count:
            raise InputError(
                f"bodies[{number}]: AirVolume: bodies of air come after all others: "
                "move it to the end"
            )
        if number not in air_terms:
            raise InputError(
                f"bodies[{number}]: AirVolume: no term joins it to walls: give "
                f"EnclosedAir(.., air={number})"
            )
