"""Units of all kinds by pint, read at the first unit that is not a common one."""

import re
from functools import cache
from typing import Any

import pint

from ...errors import InputError


# A power on a power ("m^9^9^9") would be evaluated, and may never end.
_TOWER = re.compile(r"[\d)]\s*(?:\*\*|\^)")
# A longer text is no unit, and the parser's time grows steeply with it [characters].
_MAX_UNIT_LENGTH = 40


class UnknownUnitError(InputError):
    """A text is no unit."""


def converted(number: float, unit_text: str, symbol: str, *, affine: bool) -> float:
    """The number in the unit of `symbol`.

    Args:
        number: value in the unit of `unit_text`.
        unit_text: unit as a user writes it.
        symbol: unit of the result.
        affine: True if a degree Celsius is a point of its scale, not 1 K.

    Raises:
        UnknownUnitError: if `unit_text` is no unit.
        InputError: if it is a unit of another dimension.
    """
    registry = _registry()
    try:
        if len(unit_text) > _MAX_UNIT_LENGTH or _TOWER.search(unit_text):
            raise ValueError
        parsed = registry.parse_units(unit_text, as_delta=not affine)
    except Exception as error:  # pint's parser raises many unrelated types
        raise UnknownUnitError(unit_text) from error
    try:
        quantity = registry.Quantity(number, parsed)
        # For pint W/sr and W are one: 4 pi apart, they must not be mixed up.
        if _steradians(quantity) != _steradians(registry.Quantity(1, symbol)):
            raise ValueError
        converted_number = float(quantity.to(symbol).magnitude)
        # A difference of temperatures has no zero point.
        zero = 0.0 if affine else registry.Quantity(0.0, parsed).to(symbol).magnitude
        return converted_number - float(zero)
    except (pint.PintError, ArithmeticError, ValueError) as error:
        raise InputError(unit_text) from error


def _steradians(quantity: Any) -> float | int:
    """Power of the steradian in the unit of a quantity."""
    return dict(quantity.unit_items()).get("steradian", 0)


@cache
def _registry() -> pint.UnitRegistry:
    return pint.UnitRegistry(cache_folder=None)
