"""Small voxel bodies at random, and slow loops that say what is right."""

from collections import defaultdict
from itertools import product

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays


def solids(longest: int = 5):
    """Any volume with at least one solid voxel."""
    shape = st.tuples(*[st.integers(1, longest)] * 3)
    any_solid = shape.flatmap(lambda s: arrays(bool, s))
    return any_solid.filter(lambda solid: solid.any())


def labelled(longest: int = 4, kinds: int = 4):
    """Labels from -1 (none) upwards, with some left out."""
    shape = st.tuples(*[st.integers(1, longest)] * 3)
    labels = shape.flatmap(lambda s: arrays(int, s, elements=st.integers(-1, kinds)))
    return labels.filter(lambda each: (each >= 0).any())


def ball(radius: float, empty: float = 0.0) -> np.ndarray:
    """A ball of voxels, a little off the middle, hollow inside a radius of `empty`."""
    side = int(2 * radius) + 3
    place = np.indices((side, side, side + 1)) - side / 2 + 0.3
    square = (place**2).sum(0)
    return (square < radius**2) & (square >= empty**2)


def neighbours(cell, shape):
    """Cells that share a face with one, and the axis and sign of the step there."""
    for axis, sign in product(range(3), (-1, 1)):
        other = list(cell)
        other[axis] += sign
        if 0 <= other[axis] < shape[axis]:
            yield tuple(other), axis, sign


def parts_of(cells: set, shape) -> list[set]:
    """Sets of cells that hang together over faces."""
    left, found = set(cells), []
    while left:
        front = {min(left)}
        part = set()
        while front:
            part |= front
            around = {n for cell in front for n, _, _ in neighbours(cell, shape)}
            front = (around & left) - part
        left -= part
        found.append(part)
    return found


def members(labels) -> dict[int, list[tuple]]:
    """Cells of every label, in lattice order of the first."""
    groups = defaultdict(list)
    for cell in np.ndindex(labels.shape):
        if labels[cell] >= 0:
            groups[int(labels[cell])].append(cell)
    return groups


def links_of(labels, centre) -> dict[tuple[int, int], tuple[float, float, float]]:
    """Area and the two distances along the normal of every pair, in voxels.

    Args:
        labels: of the voxels.
        centre: of every label.
    """
    places = defaultdict(lambda: defaultdict(list))
    for cell in np.ndindex(labels.shape):
        for other, axis, sign in neighbours(cell, labels.shape):
            src, dst = labels[cell], labels[other]
            if 0 <= src < dst:
                place = cell[axis] + (sign + 1) / 2
                places[int(src), int(dst)][axis, sign].append(place)
    links = {}
    for (src, dst), sides in places.items():
        on_axis, to_src, to_dst = np.zeros(3), 0.0, 0.0
        for (axis, sign), found in sides.items():
            mean = np.mean(found)
            on_axis[axis] += len(found)
            to_src += len(found) * max(sign * (mean - centre[src][axis]), 0.25)
            to_dst += len(found) * max(sign * (centre[dst][axis] - mean), 0.25)
        area = np.sqrt((on_axis**2).sum())
        links[src, dst] = (area, to_src / area, to_dst / area)
    return links
