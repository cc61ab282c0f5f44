"""The literal types that editors show have the values that the functions accept."""

import ast
import inspect
from typing import get_args

from jaxthermo import choices
from jaxthermo.config.schema.outdoors import OutdoorsConfig
from jaxthermo.image.colour.palette import palette_names
from jaxthermo.physics.convection.nusselt import AVERAGES
from jaxthermo.scene.surface_outputs import SURFACE_OUTPUTS
from jaxthermo.weather.outdoors import _TERMS, ALL_TERMS


def literals() -> dict[str, tuple[str, ...]]:
    """Values of each literal type, which is `str` at run time."""
    values = {}
    for node in ast.walk(ast.parse(inspect.getsource(choices))):
        if not isinstance(node, ast.Assign) or not isinstance(
            node.value, ast.Subscript
        ):
            continue
        (target,) = node.targets
        assert isinstance(target, ast.Name)
        listed = ast.literal_eval(node.value.slice)
        values[target.id] = listed if isinstance(listed, tuple) else (listed,)
    return values


def test_literal_types_have_the_values_that_are_accepted():
    accepted = literals()
    assert accepted["Palette"] == palette_names()
    assert accepted["SurfaceOutput"] == SURFACE_OUTPUTS
    assert accepted["CylinderAverage"] == tuple(average.name for average in AVERAGES)
    assert accepted["OutdoorTerm"] == _TERMS and {*ALL_TERMS} < {*_TERMS}
    terms, _ = get_args(OutdoorsConfig.model_fields["terms"].annotation)
    assert accepted["OutdoorTerm"] == get_args(terms)
    assert accepted["Dtype"] == ("float32", "float64")
