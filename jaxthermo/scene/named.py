"""Names in a scene: of its probes and its bodies."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError


class Probe(NamedTuple):
    """A virtual thermocouple, fixed to the body that it is in or on."""

    name: str
    position: tuple[float, float, float]
    """In the world, at the start of the run [m]."""


def as_probes(probes: Any) -> tuple[Probe, ...]:
    """Probes at points, which are a list or have names."""
    named = probes
    if not isinstance(probes, Mapping):
        # Points without names are numbered in their order.
        named = {str(number): point for number, point in enumerate(probes)}
    return tuple(
        point if isinstance(point, Probe) else Probe(str(name), _point(name, point))
        for name, point in named.items()
    )


def _point(name: object, point: Any) -> tuple[float, float, float]:
    try:
        x, y, z = (float(value) for value in point)
    except (TypeError, ValueError):
        raise InputError(
            f"Scene(probes=): probe {name} is {point!r}: give three numbers [m]"
        ) from None
    if not np.isfinite([x, y, z]).all():
        raise InputError(f"Scene(probes=): probe {name} is at no finite position")
    return x, y, z


def check_names(names: Sequence[str]) -> None:
    """Refuse two bodies of one name; an empty one is none.

    Raises:
        InputError: with the name and the numbers of the bodies.
    """
    for name, count in Counter(filter(None, names)).items():
        if count > 1:
            numbers = [number for number, other in enumerate(names) if other == name]
            raise InputError(
                f"Scene(bodies=): the bodies {numbers} have the name {name!r}: give "
                "each body a name of its own"
            )
