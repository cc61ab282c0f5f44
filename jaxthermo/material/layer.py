"""Layers of a thin wall."""

from typing import Any

import equinox as eqx
from equinox import Module

from ..arrays import Scalar, is_traced
from ..errors import InputError, require
from .material import Material, Property
from .table import materials


def _as_material(material: Any) -> Any:
    return materials[material] if isinstance(material, str) else material


class Layer(Module):
    """A layer of a sheet: its material and thickness.

    A stack is a tuple of layers, from the front, the side of the normals, to the back.

    Raises:
        InputError: for a thickness that is no positive length, a material that is none,
            or one whose properties depend on the temperature or on the axis.

    Example:
        >>> import jaxthermo as jt
        >>> glass = jt.Layer(jt.Material(1.0, 2500.0, specific_heat=840.0), 4e-3)
        >>> glass.thickness
        0.004
    """

    material: Material = eqx.field(converter=_as_material)
    """A material, or its name in the table."""
    thickness: Scalar
    """[m]"""

    def __check_init__(self):
        require(
            self.material,
            classes=Material,
            argument="Layer(material=)",
            give='a material or the name of one: "copper"',
        )
        if self.material.varies or isinstance(self.material.conductivity, tuple):
            raise InputError(
                "Layer(material=): its conductivity and specific heat must be numbers, "
                "the same along all axes and at all temperatures: give "
                "material.at(kelvin), and one conductivity"
            )
        _check_thickness(self.thickness)

    @property
    def resistance(self) -> Scalar:
        """Thermal resistance through the layer, d / k [m^2 K/W]."""
        return self.thickness / self.conductivity

    @property
    def conductivity(self) -> Scalar:
        """Conductivity k [W/(m K)]."""
        k = self.material.conductivity
        assert not isinstance(k, Property | tuple)
        return k

    @property
    def capacity(self) -> Scalar:
        """Heat capacity of its area, rho c_p d [J/(m^2 K)]."""
        return self.material.volumetric_heat_capacity * self.thickness


def _check_thickness(thickness: Any) -> None:
    if is_traced(thickness):
        return
    try:
        metres = float(thickness)
    except (TypeError, ValueError):
        metres = float("nan")
    # Negated, so that NaN is refused too.
    if not 0 < metres < float("inf"):
        raise InputError(f"Layer(thickness={thickness!r}): give a positive length [m]")
