"""Random bodies with several levels, and the same structures found voxel by voxel."""

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jaxthermo.structures.structure import AbstractStructure


FACES = [s * e for s in (-1, 1) for e in np.eye(3, dtype=int)]


def solid_of(seed: int) -> np.ndarray:
    """Boxes and balls put together, some parts apart, and a few holes."""
    random = np.random.default_rng(seed)
    shape = random.integers(3, 19, 3)
    solid = np.zeros(tuple(shape), bool)
    position = np.moveaxis(np.indices(solid.shape), 0, -1)
    for _ in range(random.integers(1, 5)):
        middle = random.random(3) * shape
        radius = random.uniform(1, 10)
        order = random.choice([1.0, 2.0, np.inf])
        solid |= np.linalg.norm(position - middle, order, axis=-1) <= radius
    solid &= random.random(solid.shape) >= random.choice([0, 0, 0.002, 0.3])
    return solid


def steps_to_outside(solid: np.ndarray) -> np.ndarray:
    """Steps along the axes to the nearest empty voxel, or to the outside."""
    steps = ndimage.distance_transform_cdt(np.pad(solid, 1), "taxicab")
    return np.asarray(steps)[1:-1, 1:-1, 1:-1]


def cells_one_by_one(solid: np.ndarray) -> list[list[tuple[int, ...]]]:
    """For each level the lowest voxel of each cell, in lattice order."""
    depth = steps_to_outside(solid)
    levels = [[tuple(int(i) for i in c) for c in np.argwhere(depth == 1)]]
    size = 2
    while size <= depth.max():
        inside = set()
        for cell in np.ndindex(*(n // size + 2 for n in solid.shape)):
            low = np.array(cell) * size - 1
            middle = [low + size // 2 - 1 + np.array(o) for o in np.ndindex(2, 2, 2)]
            in_lattice = [
                m for m in middle if (m >= 0).all() and (m < solid.shape).all()
            ]
            if sum(depth[tuple(m)] >= size for m in in_lattice) >= 4:
                inside.add(cell)
        levels.append(
            [
                tuple(i * size - 1 for i in cell)
                for cell in sorted(inside)
                if not all(tuple(np.add(cell, f)) in inside for f in FACES)
            ]
        )
        size *= 2
    while len(levels) > 1 and not levels[-1]:
        levels.pop()
    return levels


def parts(structure: AbstractStructure) -> np.ndarray:
    """Number of the connected part of each node."""
    links = structure.links()
    count = structure.node_count
    graph = coo_array(
        (np.ones(len(links.src)), (links.src, links.dst)), shape=(count, count)
    )
    return connected_components(graph, directed=False)[1]


def solid_parts(solid: np.ndarray) -> np.ndarray:
    """Number of the connected part of each voxel, over faces; 0 where empty."""
    number = np.zeros(solid.shape, np.int32)
    ndimage.label(solid, output=number)
    return number
