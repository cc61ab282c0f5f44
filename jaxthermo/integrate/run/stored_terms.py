"""Terms of a scene as its camera sees them: sky, ground, air and sources."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ...errors import InputError
from ...physics.boundary import Convection
from ...physics.convection.free_convection import FreeConvection
from ...physics.convection.wind import Wind
from ...physics.radiation.area_source import AreaSource
from ...physics.radiation.diffuse_sky import DiffuseSky
from ...physics.radiation.emission import AbstractSurroundings, Surroundings
from ...physics.radiation.source import AbstractSource, PointSource, Sun
from ...physics.term import AbstractTerm
from .plain_values import built_value


def seen_terms(terms: Sequence[AbstractTerm]) -> tuple[AbstractTerm, ...]:
    """The terms that a camera sees, with the values that it needs.

    Surroundings have their temperatures alone, and air is a convection without a
    coefficient. A source of another class, which a file cannot have, is a warning.
    """
    seen: list[AbstractTerm] = []
    for term in terms:
        match term:
            case AbstractSurroundings():
                seen.append(Surroundings(term.temperature, term.ground))
            case Convection() | Wind() | FreeConvection() if term.on is None:
                seen.append(Convection(0.0, term.temperature))
            case Sun() | PointSource() | AreaSource() | DiffuseSky():
                seen.append(replace(term, on=None))
            case AbstractSource():
                warnings.warn(
                    f"a file has no {type(term).__name__}: images of the stored run "
                    "are drawn without it",
                    stacklevel=2,
                )
    return tuple(seen)


def stored_terms(plain: Any) -> tuple[AbstractTerm, ...]:
    """The terms from their plain values.

    Raises:
        InputError: if they are none.
    """
    if not isinstance(plain, list):
        raise InputError("terms is not a list")
    terms = built_value(plain, "terms")
    if not all(isinstance(term, AbstractTerm) for term in terms):
        raise InputError("terms has an entry that is no term")
    return terms
