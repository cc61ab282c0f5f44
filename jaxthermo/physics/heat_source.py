"""Heat released inside a body by Joule heating, chemistry or decay: Q = q''' V."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from ..arrays import TimeVarying
from ..errors import InputError
from ..structures.partition.assignment import volume_within
from ..structures.structure import AbstractStructure
from ..voxels.selection import AbstractSpace
from .surface import Omitted
from .term import AbstractVolumeTerm
from .time_varying import check_value, is_zero


if TYPE_CHECKING:
    _Within = AbstractSpace | None
else:
    # The class itself checks the value and names the remedy.
    _Within = Any


class VolumeBinding(NamedTuple):
    """Heat source in the nodes of one body."""

    volume: Float[np.ndarray, " n"]
    """Heated volume of each node [m^3]."""
    heat_rate_density: Any
    """[W/m^3], a number or a function of time."""


class HeatSource(AbstractVolumeTerm):
    """Heat rate Q = q''' V inside bodies; in all of every body without `within`.

    Raises:
        InputError: for a value that is not finite, or a selection of surface alone.
    """

    name = "heat_source"

    # The heat is counted by the centres of voxels, so that the total is the same in
    # every structure: a node receives the heat of its voxels, and where a structure has
    # no nodes inside, the nearest node receives the heat of the inside.

    heat_rate_density: TimeVarying
    """q''' [W/m^3], positive into the body; a number or a function of time."""
    within: _Within = None
    """A `Region`, `Everything` or a combination of them; None for all bodies."""

    def __check_init__(self):
        check_value(self.heat_rate_density, "HeatSource(heat_rate_density [W/m^3])")
        if self.within is not None and not isinstance(self.within, AbstractSpace):
            raise InputError(
                f"HeatSource(within={self.within!r}): it heats the inside: give a "
                "Region or Everything, or a combination of them"
            )

    @property
    @override
    def named_bodies(self) -> tuple[int, ...]:
        return () if self.within is None else self.within.bodies

    @override
    def bind(self, structure: AbstractStructure, body: int) -> VolumeBinding | Omitted:
        if is_zero(self.heat_rate_density):
            return Omitted("the heat rate density is 0")
        grid = structure.grid
        heated = np.ones(grid.solid_count, bool)
        if self.within is not None:
            space = self.within.on_body(body)
            if space is None:
                return Omitted("`within` is on another body")
            # Part of a space is a space.
            assert isinstance(space, AbstractSpace)
            heated = space.contains(grid.lattice.centres(np.argwhere(grid.solid)))
        if not heated.any():
            raise InputError(
                f"HeatSource(within={self.within!r}): no voxel of body {body} has its "
                "centre in it; corners are metres in the body's own frame, and a "
                f"voxel has {grid.pitch:g} m"
            )
        return VolumeBinding(volume_within(structure, heated), self.heat_rate_density)
