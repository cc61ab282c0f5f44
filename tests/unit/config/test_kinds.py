"""Every model of a config against the class that it builds: keys, defaults, limits."""

import inspect
from typing import Any

import numpy as np
import pytest

from jaxthermo.config.schema.scene import SceneConfig, unit_of
from jaxthermo.config.types.model import Model, build, field_parts, models_within
from jaxthermo.errors import InputError
from tests.bodies import blocks


def name_of(model: type[Model]) -> str:
    return model.__name__.lstrip("_")


MODELS = sorted(
    (m for m in models_within(SceneConfig) if m.builds and m is not SceneConfig),
    key=lambda model: name_of(model),
)
# Keys from which `build` makes arguments of other names.
CONVERTED = {
    "Aggregate": {"nodes", "size"},
    "BandConfig": {"name"},
    "BodyConfig": {
        *("mesh", "shape", "solid", "pitch", "voxels_high", "surface_cells"),
        *("structure", "regions", "sheet", "skin", "interior"),
    },
    # The scene replaces names of bodies by numbers.
    **{
        f"{kind}Config": {"part"}
        for kind in ("Cylinder", "Face", "Fragments", "Region", "Side")
    },
    "MeshConfig": {"part"},
    "AirConfig": {"exchange", "outside", "temperature"},
    "CoatingConfig": {"finish"},
    "DirectionTable": {"values"},
    "InteriorConfig": {"air"},
    "LabelledConfig": {"materials"},
    "MaterialConfig": {"name"},
    "MotionConfig": {"times", "poses"},
    "OutdoorsConfig": {"north", "clear_sky"},
    "PinholeConfig": {"K", "world_to_camera"},
    "PositionTable": {"values"},
    "WeightsConfig": {"card"},
}
# Structures are built on a voxel grid, cameras to fit the scene, weather for a run.
FILLED_IN = {"duration", "grid", "position", "look_at", "view_height"}
MADE_OF_CONVERTED = {"structure", "points", "directions", "given", "path"}


def parameters(model: type[Model]) -> dict[str, inspect.Parameter]:
    return dict(inspect.signature(model.target()).parameters)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: name_of(model))
def test_keys_and_defaults_are_those_of_the_class(model):
    of_class = parameters(model)
    converted = CONVERTED.get(name_of(model), set())
    for key in set(model.model_fields) - {"kind", "until"} - converted:
        field = model.model_fields[key]
        default = of_class[key].default
        # None leaves the value to the class.
        if not field.is_required() and field.default not in (None, ()):
            assert build(field.default) == default, key


@pytest.mark.parametrize("model", MODELS, ids=lambda model: name_of(model))
def test_what_the_class_needs_is_a_key(model):
    needed = {k for k, p in parameters(model).items() if p.default is p.empty}
    missing = needed - set(model.model_fields)
    assert missing <= FILLED_IN | MADE_OF_CONVERTED


GIVEN: dict[str, dict[str, Any]] = {
    "SunConfig": {"direction": [0, 0, 1], "irradiance": 1},
    "PointSourceConfig": {"position": [0, 0, 1], "radiant_intensity": 1},
    "AreaSourceConfig": {
        "centre": [0, 0, 1],
        "normal": [0, 0, 1],
        "size": [1, 1],
        "temperature": 300,
    },
    "SurroundingsConfig": {"temperature": 300},
    "RadiativeExchangeConfig": {"temperature": 300},
    "ConvectionConfig": {"heat_transfer_coefficient": 1, "temperature": 300},
    "LinearWindConfig": {"speed": 1, "temperature": 300},
    "CylinderConfig": {"axis_point": [0, 0, 0], "axis": [0, 0, 1], "diameter": 1},
    "WakeDeficitConfig": {},
    "FreeConvectionConfig": {"temperature": 300},
    "ContactConfig": {"conductance": 1},
    "SideConfig": {"normal": [0, 0, 1]},
    "MaterialConfig": {"conductivity": 1, "density": 1, "specific_heat": 1},
    "WeightsConfig": {},
    "Aggregate": {"factor": 2},
    "MultiLevel": {},
    "ShellOverCore": {"factor": 2},
    "SuperTimeStepping": {},
    "BackwardEuler": {},
    "TRBDF2": {},
    "ErrorControl": {},
    "Sphere": {"radius": 1},
    "Slab": {"thickness": 1, "width": 1, "length": 1},
}
# Limits of the config alone: beyond them a class works, but a scene is not meant.
CONFIG_ONLY = {
    ("CylinderConfig", "body"),
    ("RadiativeExchangeConfig", "directions"),
    ("RadiativeExchangeConfig", "max_patches"),
    ("SideConfig", "body"),
}
UPPER = (64, 4096, 100_000, 1e9)


def limits() -> list[tuple[str, str, float, float]]:
    """Model, key, the limit and the nearest number beyond it."""
    limits = []
    for model in (m for m in MODELS if name_of(m) in GIVEN):
        for key in model.model_fields:
            is_integer = int in field_parts(model, key)
            for marker in field_parts(model, key):
                for name, way in (("gt", 0), ("ge", -1), ("lt", 0), ("le", 1)):
                    if (limit := getattr(marker, name, None)) is not None:
                        limit = limit if is_integer else float(limit)
                        step = 1 if is_integer else 1e-3 * max(abs(limit), 1.0)
                        limits.append((name_of(model), key, limit, limit + way * step))
    return sorted(set(limits))


BY_NAME = {name_of(model): model for model in MODELS}


def made(name: str, key: str, value: float) -> Any:
    model = BY_NAME[name]
    data = model.model_validate(GIVEN[name]).model_copy(update={key: value})
    is_structure = "grid" in parameters(model)
    return data.build(*[blocks(np.ones((6, 6, 6), bool))] * is_structure)


@pytest.mark.parametrize(("name", "key", "limit", "beyond"), limits())
def test_limits_are_those_of_the_class(name, key, limit, beyond):
    if beyond != limit:
        made(name, key, limit)
    if (name, key) in CONFIG_ONLY or limit in UPPER:
        made(name, key, beyond)
        return
    with pytest.raises(InputError):
        made(name, key, beyond)


@pytest.mark.parametrize(
    ("path", "symbol"),
    [
        ("terms.0.irradiance", "W/m^2"),
        ("sun.irradiance", "W/m^2"),
        ("material.conductivity.2", "W/(m K)"),
        ("bodies.0.temperature", "K"),
        ("contact.conductance", "W/(m^2 K)"),
        ("weights.within", ""),
        ("weights.links", None),
        ("length", None),
    ],
)
def test_the_unit_of_a_number(path, symbol):
    unit = unit_of(path)
    assert (unit and unit.symbol) == symbol if symbol else not (unit and unit.symbol)
