"""Closed surfaces inside others: cavities, and those that are filled like the body."""

import numpy as np

from .mesh import (
    Mesh,
    edges_of,
    is_closed,
    part_labels,
    part_volumes,
    winding_number,
)
from .vectors import part_bounds


def filled_inner_surfaces(mesh: Mesh) -> int:
    """Number of closed surfaces that lie in another one and face outward like it.

    What they enclose is solid, as two parts that overlap are one body; a cavity faces
    inward. Surfaces that cross each other do not count.
    """
    labels = part_labels(mesh.faces)
    count = int(labels.max(initial=-1)) + 1
    if count < 2:
        return 0
    triangles = mesh.triangles
    lower, upper = part_bounds(triangles, labels, count)
    faces_outward = part_volumes(mesh, labels, count) > 0.0
    faces_outward &= is_closed(edges_of(mesh.faces), labels, count)
    number = 0
    for inner in np.flatnonzero(faces_outward):
        boxed = (lower < lower[inner]).all(axis=1) & (upper > upper[inner]).all(axis=1)
        point = triangles[np.argmax(labels == inner)].mean(axis=0)
        number += any(
            winding_number(triangles[labels == outer], point) > 0.5
            for outer in np.flatnonzero(boxed & faces_outward)
        )
    return number
