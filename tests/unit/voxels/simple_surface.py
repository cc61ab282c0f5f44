"""Simple versions of what the voxelizer does fast: all sides of all voxels, one by one.

Written as the equations in the package's docstrings, over dense arrays and whole
lattices; the package finds the same from the few sides that have a cell.
"""

from itertools import combinations, product

import numpy as np


def exposed_faces(solid, axis, row_axis, column_axis):
    """Pixel, link and direction of every exposed face, sorted by ray and place."""
    along = solid.transpose(row_axis, column_axis, axis)
    along = np.pad(along, [(0, 0), (0, 0), (1, 1)])
    step = np.diff(along.astype(int), axis=2)
    row, column, link = np.nonzero(step)
    return row * along.shape[1] + column, link, step[row, column, link] > 0


def solid_by_vote(views, shape):
    """Solid voxels from all winding numbers along each axis, on rays that close."""
    votes, cast = np.zeros((2, *shape), int)
    for axis, layers in enumerate(views):
        row_axis, column_axis = (axis + 2) % 3, (axis + 1) % 3
        size = layers.height, layers.width, shape[axis] + 1
        change, sign = np.zeros(size, int), np.where(layers.entering, 1, -1)
        behind = np.clip(np.ceil(layers.depth - 0.5).astype(int), 0, shape[axis])
        np.add.at(change, (*np.divmod(layers.pixel, layers.width), behind), sign)
        winding = np.cumsum(change, axis=2)
        closes = np.repeat(winding[..., -1:] == 0, shape[axis], axis=2)
        order = np.argsort([row_axis, column_axis, axis])
        cast += closes.transpose(order)
        votes += ((winding[..., :-1] != 0) & closes).transpose(order)
    return 2 * votes > cast


def nearest_solid(solid, position, start):
    """Nearest solid voxel within two cells of a start; None if there is none."""
    within = [
        cell
        for offset in product(range(-2, 3), repeat=3)
        for cell in [tuple(np.add(start, offset).tolist())]
        if all(0 <= c < n for c, n in zip(cell, solid.shape, strict=True))
        and solid[cell]
    ]
    distance = lambda cell: np.square(np.add(cell, 0.5) - position).sum()
    return min(within, key=distance, default=None)


def limited(volume, solid, links, step, least_of_all, rounds):
    """Volumes of all voxels after small ones took from their neighbours."""
    conductance = np.zeros(np.add(solid.shape, 2))
    padded = np.pad(solid, 1)
    for axis, ahead in product(range(3), (-1, 1)):
        conductance += padded & np.roll(padded, ahead, axis)
    conductance = conductance[1:-1, 1:-1, 1:-1].copy()
    for first, jump, extra in zip(links.voxel, links.step, links.extra, strict=True):
        conductance[tuple(first)] += extra
        conductance[tuple(first + jump)] += extra
    least = np.maximum(step / 6 * conductance, least_of_all)
    volume = np.where(solid, volume, 0.0)
    for _ in range(rounds):
        taken, given = np.zeros_like(volume), np.zeros_like(volume)
        spare = np.where(solid, np.maximum(volume - 1.2 * least, 0), 0)
        for cell in np.argwhere(solid & (volume < least)).tolist():
            sides = np.array(cell) + np.concatenate([np.eye(3, dtype=int)] * 2)
            sides[3:] -= 2 * np.eye(3, dtype=int)
            sides = sides[((sides >= 0) & (sides < solid.shape)).all(1)]
            own = spare[tuple(sides.T)]
            gain = min(least[tuple(cell)] - volume[tuple(cell)], own.sum() / 4)
            given[tuple(cell)] = gain
            taken[tuple(sides.T)] += own * gain / max(own.sum(), 1e-300)
        volume += given - taken
    return volume


def dense_sides(found, owner, count):
    """Flags, theta - 1/2 and normals of cells, [voxel, axis, below or above]."""
    there, excess = np.zeros((count, 3, 2), bool), np.zeros((count, 3, 2))
    normal = np.zeros((count, 3, 2, 3))
    face = np.flatnonzero(found.on_face)
    at = owner[face], found.axis[face], found.ahead[face].astype(int)
    there[at], excess[at], normal[at] = True, found.excess[face], found.normal[face]
    return there, excess, normal


def _apart(one, other):
    return 1 - np.square((one * other).sum(-1))


def volumes(weight, normal):
    """Volume of each voxel from the weights of its sides [voxels]."""
    total = 1 + weight.sum((1, 2))
    for i in np.ndindex(2, 2, 2):
        w, n = ([v[:, a, i[a]] for a in range(3)] for v in (weight, normal))
        triple = np.square(np.linalg.det(np.stack(n, axis=1)))
        total += w[0] * w[1] * w[2] * triple
    for (a, b), (i, j) in product(combinations(range(3), 2), np.ndindex(2, 2)):
        both = weight[:, a, i] * weight[:, b, j]
        total += both * _apart(normal[:, a, i], normal[:, b, j])
    return total


def sections(weight, normal, along):
    """Open areas of each voxel across x, y and z."""
    found = []
    for axis in range(3):
        one, two = (a for a in range(3) if a != axis)
        own = weight * (1 - np.square(normal[..., axis])) ** along
        total = 1 + own[:, [one, two]].sum((1, 2))
        for i, j in np.ndindex(2, 2):
            both = own[:, one, i] * own[:, two, j]
            total += both * _apart(normal[:, one, i], normal[:, two, j])
        found.append(total)
    return np.stack(found, axis=1)


def cell_shapes(found, owner, weight, normal):
    """Factor and shift of each cell, before the limit of the factor."""
    factor, shift = np.ones(len(owner)), np.zeros((len(owner), 3))
    for axis in range(3):
        own = np.flatnonzero(found.on_face & (found.axis == axis))
        here = weight[owner[own]] * _apart(
            normal[owner[own]], found.normal[own][:, None, None]
        )
        for other in set(range(3)) - {axis}:
            below, above = here[:, other].T
            factor[own] *= 1 + below + above
            shift[own, other] = (above - below) / 2
    return factor, shift


def links(voxel, section, sides, solid, min_open, smooth):
    """Extra conductance of each link of cut voxels, by its two voxels."""
    there, excess, normal = sides
    own = {tuple(v): m for m, v in enumerate(voxel.tolist())}
    padded = np.pad(solid, 1)
    unit = np.eye(3, dtype=int)
    is_solid = lambda v: bool(padded[tuple(np.add(v, 1))])
    found = {}
    add = lambda p, q, x: found.__setitem__(
        (min(p, q), max(p, q)), found.get((min(p, q), max(p, q)), 0.0) + x
    )
    for v, m in own.items():
        for axis, sign in product(range(3), (-1, 1)):
            other = tuple(int(x) for x in np.add(v, sign * unit[axis]))
            if not is_solid(other) or (sign < 0 and other in own):
                continue
            end = section[own[other], axis] if other in own else 1.0
            add(v, other, (section[m, axis] + end) / 2 - 1)
    for (v, m), (a, b), (i, j) in product(
        own.items(), combinations(range(3), 2), np.ndindex(2, 2)
    ):
        third = tuple(int(x) for x in np.subtract(v, (2 * j - 1) * unit[b]))
        second = tuple(int(x) for x in np.add(third, (2 * i - 1) * unit[a]))
        n = own.get(second)
        if n is None or not (there[m, a, i] and there[n, b, j] and is_solid(third)):
            continue
        normals = normal[m, a, i], normal[n, b, j]
        if normals[0] @ normals[1] <= smooth:
            continue
        total = np.add(*normals)
        mean = total / np.linalg.norm(total)
        n_a, n_b = abs(mean[a]), abs(mean[b])
        width = (excess[m, a, i] * n_a + excess[n, b, j] * n_b) / 2 + (n_a + n_b) / 4
        scale = max(width, 0) * (n_a + n_b) / max(n_a**2 + n_b**2, 1e-12)
        add(v, second, scale * n_a * n_b)
        add(v, third, scale * n_a * (n_a - n_b))
        add(second, third, scale * n_b * (n_b - n_a))
    for ends, extra in found.items():
        if np.abs(np.subtract(*ends)).sum() == 1:
            found[ends] = max(1 + extra, min_open) - 1
    return {ends: extra for ends, extra in found.items() if abs(extra) > 1e-12}


def areas_of_mesh(area, position, normal, pieces, spacing):
    """Areas of cells by hat functions at every point, node by node.

    Pieces are (points, normal, area) with each point an equal part of the area.
    """

    def shares(points, normals):
        place = points / spacing + 1
        first = np.floor(place).astype(int)
        for corner in np.ndindex(2, 2, 2):
            node = first + corner
            hat = np.prod(1 - np.abs(place - node), axis=1)
            for axis, along in enumerate(normals.T):
                side = 2 * axis + (along > 0)
                yield (*node.T, side), hat * np.square(along)

    nodes = np.ceil(position.max(0) / spacing).astype(int) + 4
    true, found = np.zeros((2, *nodes, 6))
    for points, normals, own in pieces:
        for each in points:
            for index, weight in shares(each, normals):
                near = (np.array(index[:3]) < np.array(true.shape[:3])[:, None]).all(0)
                kept = tuple(i[near] for i in index)
                np.add.at(true, kept, (weight * own / len(points))[near])
    for index, weight in shares(position, normal):
        np.add.at(found, index, weight * area)
    ratio = true / np.where(found > 0, found, 1)
    factor = sum(weight * ratio[index] for index, weight in shares(position, normal))
    return area * np.clip(factor, 0.5, 2.0)
