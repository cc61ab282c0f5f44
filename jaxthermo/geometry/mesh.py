"""A triangle mesh and its verdict: is it closed, how large is it, what was mended."""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class Mesh:
    """Triangles in metres, z up, counter-clockwise seen from outside."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    name: str = "mesh"
    axes: tuple[str, str, str] = ("x", "y", "z")
    """What each of our axes was called in the file, e.g. ("x", "-z", "y") for y up."""
    repairs: dict[str, int] = field(default_factory=dict)
    """What the loader mended: kind of defect -> how many."""

    @property
    def triangles(self) -> Float[np.ndarray, "f 3 3"]:
        """Corner positions of each face [m]."""
        return self.vertices[self.faces]

    @property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of the bounding box [m]."""
        used = self.vertices[self.faces.reshape(-1)]
        return np.stack([used.min(0), used.max(0)])

    @property
    def area_vectors(self) -> Float[np.ndarray, "f 3"]:
        """Outward normal times area of each face [m^2]."""
        a, b, c = np.moveaxis(self.triangles, 1, 0)
        return 0.5 * np.cross(b - a, c - a)

    @property
    def area(self) -> float:
        """Surface area [m^2]."""
        return float(np.linalg.norm(self.area_vectors, axis=1).sum())

    @property
    def volume(self) -> float:
        """Enclosed volume by the divergence theorem [m^3]; meaningful if watertight."""
        centred = self.triangles - self.bounds.mean(0)
        return float((centred.mean(1) * self.area_vectors).sum() / 3.0)

    @property
    def is_watertight(self) -> bool:
        """Whether every edge is used as often one way as the other."""
        return self.open_edges == 0

    @property
    def open_edges(self) -> int:
        """Directed edges without a partner the other way."""
        start = self.faces.reshape(-1).astype(np.int64)
        end = np.roll(self.faces, -1, axis=1).reshape(-1).astype(np.int64)
        n = len(self.vertices)
        key = np.minimum(start, end) * n + np.maximum(start, end)
        balance = np.where(start < end, 1, -1)
        _, inverse = np.unique(key, return_inverse=True)
        return int(np.abs(np.bincount(inverse, weights=balance)).sum())

    def moved(self, offset: tuple[float, float, float] | np.ndarray) -> "Mesh":
        """The same mesh, translated by `offset` [m]."""
        return replace(self, vertices=self.vertices + np.asarray(offset, float))
