"""Units of the numbers in a scene's config, as its fields declare them."""

from functools import cache

from .schema.scene import SceneConfig
from .types.model import field_parts, models_within
from .types.quantities import Unit


@cache
def _units() -> dict[str, Unit]:
    """The unit of each key; without keys that have several, such as `length`."""
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
