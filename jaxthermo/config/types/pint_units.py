"""Units of all kinds by pint, read at the first unit that is not a common one."""

import re
from functools import cache

import pint

from ...errors import InputError


# A power on a power ("m^9^9^9") would be evaluated, and may never end.
_TOWER = re.compile(r"[\d)]\s*(?:\*\*|\^)")
# A longer text is no unit, and the parser's time grows steeply with it [characters].
_MAX_UNIT_LENGTH = 40


class UnknownUnitError(InputError):
    """A text is no unit."""


def converted(number: float, given: str, symbol: str, *, affine: bool) -> float:
    """The number in the unit of `symbol`.

    Args:
        number: in the unit given.
        given: the unit, as a user writes it.
        symbol: unit of the result.
        affine: a degree Celsius is a point of its scale, not a difference of 1 K.

    Raises:
        UnknownUnitError: if `given` is no unit.
        InputError: if it is one of another dimension.
    """
    registry = _registry()
    try:
        if len(given) > _MAX_UNIT_LENGTH or _TOWER.search(given):
            raise ValueError
        parsed = registry.parse_units(given, as_delta=not affine)
    except Exception as error:  # pint's parser raises many unrelated types
        raise UnknownUnitError(given) from error
    try:
        quantity = registry.Quantity(number, parsed)
        # For pint W/sr and W are one: 4 pi apart, they must not be mixed up.
        both = (quantity, registry.Quantity(1, symbol))
        if len({dict(one.unit_items()).get("steradian", 0) for one in both}) > 1:
            raise ValueError
        return float(quantity.to(symbol).magnitude)
    except (pint.PintError, ArithmeticError, ValueError) as error:
        raise InputError(given) from error


@cache
def _registry() -> pint.UnitRegistry:
    return pint.UnitRegistry(cache_folder=None)
