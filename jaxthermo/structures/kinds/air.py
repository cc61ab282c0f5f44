"""A volume of air of one temperature."""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Int
from typing_extensions import override

from ...arrays import Scalar, is_traced
from ...errors import InputError
from ...voxels.no_surface import NO_SURFACE, NoSurface
from ..structure import AbstractStructure, Links, Nodes
from ..weights import ConductionWeights


class AirVolume(AbstractStructure):
    """One node of air, which `EnclosedAir` joins to the walls around it.

    Its heat capacity is that of an ideal gas at the body's initial temperature and at
    101 325 Pa. It has no surface.

    Raises:
        InputError: unless the volume is positive.

    Example:
        >>> import jaxthermo as jt
        >>> steel = jt.Layer("steel", 0.8e-3)
        >>> van = jt.Sheet(jt.shapes.box((3.0, 2.0, 1.5)), (steel,), pitch=0.5)
        >>> air = jt.Body(jt.AirVolume.inside(van), temperature=293.0)
        >>> round(air.structure.volume, 9)
        9.0
    """

    air_volume: Any
    """V [m^3]."""
    grid: NoSurface = eqx.field(static=True)
    weights: ConductionWeights = ConductionWeights()

    def __init__(self, volume: Scalar):
        """Enclose a volume [m^3], which may be traced."""
        if not is_traced(volume):
            cubic_metres = float(volume)
            if not 0 < cubic_metres < np.inf:
                raise InputError(f"AirVolume({cubic_metres}): give a volume above 0")
        self.air_volume = volume
        self.grid = NO_SURFACE
        self.weights = ConductionWeights()

    @classmethod
    def inside(cls, structure: AbstractStructure) -> "AirVolume":
        """The volume of the closed cavities of a body, whatever else is in them.

        Raises:
            InputError: if there are none.
        """
        grid = structure.grid
        if grid.cavities is None:
            raise InputError(f"AirVolume: the body encloses no air; {grid.why_open}")
        return cls(grid.cavity_volume)

    @property
    @override
    def identity(self) -> tuple[object, ...]:
        return (self.grid,)

    @property
    @override
    def node_count(self) -> int:
        return 1

    @property
    @override
    def link_count(self) -> int:
        return 0

    @property
    @override
    def volume(self) -> float:
        return float(self.air_volume)

    @property
    @override
    def capacity_ratio(self) -> float:
        return 1.0

    @override
    def nodes(self) -> Nodes:
        # The capacity of the material is that of the whole volume.
        origin = np.zeros((1, 3))
        return Nodes(
            centre=origin, volume=np.ones(1), level=np.zeros(1, int), location=origin
        )

    @override
    def links(self) -> Links:
        none = np.zeros(0, np.int32)
        length = np.zeros(0)
        return Links(
            src=none,
            dst=none,
            area=length,
            distance_src=length,
            distance_dst=length,
        )

    @override
    def fragment_node(self) -> Int[np.ndarray, " s"]:
        return np.zeros(0, np.int32)
