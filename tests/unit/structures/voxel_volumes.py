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


def labelled(longest: int = 4, label_count: int = 4):
    """Labels from -1 (none) upwards, with some left out."""
    shape = st.tuples(*[st.integers(1, longest)] * 3)
    labels = shape.flatmap(
        lambda s: arrays(int, s, elements=st.integers(-1, label_count))
    )
    return labels.filter(lambda labels_array: (labels_array >= 0).any())


def ball(radius: float, empty: float = 0.0) -> np.ndarray:
    """A ball of voxels, a little off the middle, hollow inside a radius of `empty`."""
    side = int(2 * radius) + 3
    position = np.indices((side, side, side + 1)) - side / 2 + 0.3
    square = (position**2).sum(0)
    return (square < radius**2) & (square >= empty**2)


def neighbours(cell, shape):
    """Cells that share a face with one, and the axis and sign of the step there."""
    for axis, sign in product(range(3), (-1, 1)):
        neighbour = list(cell)
        neighbour[axis] += sign
        if 0 <= neighbour[axis] < shape[axis]:
            yield tuple(neighbour), axis, sign


def parts_of(cells: set, shape) -> list[set]:
    """Sets of cells that hang together over faces."""
    left = set(cells)
    components = []
    while left:
        front = {min(left)}
        component = set()
        while front:
            component |= front
            around = {n for cell in front for n, _, _ in neighbours(cell, shape)}
            front = (around & left) - component
        left -= component
        components.append(component)
    return components


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
        for neighbour, axis, sign in neighbours(cell, labels.shape):
            src = labels[cell]
            dst = labels[neighbour]
            if 0 <= src < dst:
                plane = cell[axis] + (sign + 1) / 2
                places[int(src), int(dst)][axis, sign].append(plane)
    links = {}
    for (src, dst), sides in places.items():
        on_axis = np.zeros(3)
        to_src = 0.0
        to_dst = 0.0
        for (axis, sign), planes in sides.items():
            mean = np.mean(planes)
            on_axis[axis] += len(planes)
            to_src += len(planes) * max(sign * (mean - centre[src][axis]), 0.25)
            to_dst += len(planes) * max(sign * (centre[dst][axis] - mean), 0.25)
        area = np.sqrt((on_axis**2).sum())
        links[src, dst] = (area, to_src / area, to_dst / area)
    return links


def assert_links(structure, expected, rtol: float = 0.0) -> None:
    """Links of two structures agree, exactly unless a tolerance is given."""
    for actual, reference in zip(structure.links(), expected.links(), strict=True):
        np.testing.assert_allclose(actual, reference, rtol=rtol, atol=0)


def conductance_sums(structure) -> np.ndarray:
    """Sum of A / L over the links of each node [m]."""
    links = structure.links()
    conductance = links.area / (links.distance_src + links.distance_dst)
    ends = np.concatenate([links.src, links.dst])
    return np.bincount(ends, np.tile(conductance, 2), structure.node_count)
