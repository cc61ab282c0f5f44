"""Heat released inside a body by Joule heating, chemistry or decay: Q = q''' V."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from ..arrays import TimeVarying
from ..errors import InputError
from ..structures.kinds.air import AirVolume
from ..structures.structure import AbstractStructure
from ..structures.volumes import node_volumes
from ..voxels.selection import AbstractSpace
from .surface import Omitted
from .term import AbstractVolumeTerm, OperatingPoint, Scale
from .time_varying import check_one_of, is_zero, largest_size


if TYPE_CHECKING:
    _Within = AbstractSpace | None
else:
    # The class itself checks the value and names the remedy.
    _Within = Any


class VolumeBinding(NamedTuple):
    """Heat source in the nodes of one body."""

    volume: Float[np.ndarray, " n"]
    """Heated volume of each node [m^3]."""
    heat_rate_density: Any = None
    """[W/m^3], a number or a function of time; None for a heat rate."""
    heat_rate: Any = None
    """Heat rate of the volumes of all bodies together [W], in place of the density."""


class HeatSource(AbstractVolumeTerm):
    """Heat rate Q = q''' V inside bodies; in all of every body without `within`.

    Give either the density or the heat rate, which the heated volumes of all bodies
    share evenly.

    Raises:
        InputError: for a value that is not finite, or a selection of surface alone.
    """

    name = "heat_source"

    # The heat is counted by voxels, so that the total is the same in every structure: a
    # node receives the heat of its voxels, and where a structure has no nodes inside,
    # the nearest node receives the heat of the inside.

    heat_rate_density: TimeVarying | None = None
    """q''' [W/m^3], positive into the body; a number or a function of time."""
    within: _Within = None
    """A `Region`, `Everything` or a combination of them; None for all bodies."""
    heat_rate: TimeVarying | None = None
    """Q [W], in place of the density; a number or a function of time."""

    def __check_init__(self):
        values = {
            "heat_rate_density [W/m^3]": self.heat_rate_density,
            "heat_rate [W]": self.heat_rate,
        }
        check_one_of("HeatSource", values)
        if self.within is not None and not isinstance(self.within, AbstractSpace):
            raise InputError(
                f"HeatSource(within={self.within!r}): it heats the inside: give a "
                "Region or Everything, or a combination of them"
            )

    @property
    @override
    def named_bodies(self) -> tuple[int, ...]:
        return () if self.within is None else self.within.bodies

    def _volume(self, body: int, structure: AbstractStructure) -> float:
        """Heated volume of a body [m^3]."""
        if isinstance(structure, AirVolume):
            return 0.0
        if self.within is None:
            return structure.volume
        space = self.within.on_body(body)
        if space is None:
            return 0.0
        assert isinstance(space, AbstractSpace)
        return float(node_volumes(structure, space).sum())

    @override
    def bind(self, structure: AbstractStructure, body: int) -> VolumeBinding | Omitted:
        if self.heat_rate_density is not None and is_zero(self.heat_rate_density):
            return Omitted("the heat rate density is 0")
        if self.heat_rate is not None and is_zero(self.heat_rate):
            return Omitted("the heat rate is 0")
        space = None
        if self.within is not None:
            space = self.within.on_body(body)
            if space is None:
                return Omitted("`within` is on another body")
        if isinstance(structure, AirVolume):
            if space is None:
                return Omitted("it is air")
            raise InputError(
                f"HeatSource(within={self.within!r}): body {body} is air: heat a body "
                "in it, which the air cools"
            )
        if space is not None:
            # Part of a space is a space.
            assert isinstance(space, AbstractSpace)
        volume = node_volumes(structure, space)
        if not volume.any():
            raise InputError(
                f"HeatSource(within={self.within!r}): no part of body {body} is in it; "
                "corners are metres in the body's own frame"
            )
        return VolumeBinding(
            volume=volume,
            heat_rate_density=self.heat_rate_density,
            heat_rate=self.heat_rate,
        )

    @override
    def scale(self, point: OperatingPoint) -> Scale:
        if self.heat_rate_density is not None:
            size = float(largest_size(self.heat_rate_density, point.end))
            return Scale(heat_rate_density=size)
        size = float(largest_size(self.heat_rate, point.end))
        volume = sum(map(self._volume, range(len(point.structures)), point.structures))
        return Scale(heat_rate_density=size / volume)
