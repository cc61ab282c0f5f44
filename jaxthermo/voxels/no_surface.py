"""Surface of a body that has none: a volume of air."""

import numpy as np
from jaxtyping import Bool, Float
from typing_extensions import override

from ..geometry.mesh import Mesh
from .abstract_grid import AbstractGrid
from .lattice import Lattice


class NoSurface(AbstractGrid):
    """No triangles and no fragments: nothing sees the body, and nothing touches it."""

    def __init__(self):
        """Make all arrays empty."""
        self.mesh = Mesh(np.zeros((1, 3)), np.zeros((0, 3), int), "air")
        self.lattice = Lattice((1, 1, 1), origin=np.zeros(3), pitch=1.0)
        self.fragment_position = np.zeros((0, 3))
        self.fragment_normal = np.zeros((0, 3))
        self.fragment_area = np.zeros(0)
        self.fragment_depth = None
        self.unscaled_because = ""

    @property
    @override
    def fragment_foot(self) -> Float[np.ndarray, "s 3"]:
        return self.fragment_position

    @property
    @override
    def fragment_centre(self) -> Float[np.ndarray, "s 3"]:
        return self.fragment_position

    @override
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        return np.zeros(len(points), bool)


NO_SURFACE = NoSurface()
