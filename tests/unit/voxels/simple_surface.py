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
        row_axis = (axis + 2) % 3
        column_axis = (axis + 1) % 3
        size = layers.height, layers.width, shape[axis] + 1
        change = np.zeros(size, int)
        sign = np.where(layers.entering, 1, -1)
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

    def distance(cell):
        return np.square(np.add(cell, 0.5) - position).sum()

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
    minimum = np.maximum(step / 6 * conductance, least_of_all)
    volume = np.where(solid, volume, 0.0)
    for _ in range(rounds):
        loss = np.zeros_like(volume)
        gained = np.zeros_like(volume)
        spare = np.where(solid, np.maximum(volume - 1.2 * minimum, 0), 0)
        for cell in np.argwhere(solid & (volume < minimum)).tolist():
            sides = np.array(cell) + np.concatenate([np.eye(3, dtype=int)] * 2)
            sides[3:] -= 2 * np.eye(3, dtype=int)
            sides = sides[((sides >= 0) & (sides < solid.shape)).all(1)]
            available = spare[tuple(sides.T)]
            needed = min(
                minimum[tuple(cell)] - volume[tuple(cell)], available.sum() / 4
            )
            gained[tuple(cell)] = needed
            loss[tuple(sides.T)] += available * needed / max(available.sum(), 1e-300)
        volume += gained - loss
    return volume


def dense_sides(cells, owner, count):
    """Flags, theta - 1/2 and normals of cells, [voxel, axis, below or above]."""
    has_cell = np.zeros((count, 3, 2), bool)
    excess = np.zeros((count, 3, 2))
    normal = np.zeros((count, 3, 2, 3))
    face = np.flatnonzero(cells.on_face)
    at = owner[face], cells.axis[face], cells.ahead[face].astype(int)
    has_cell[at] = True
    excess[at] = cells.excess[face]
    normal[at] = cells.normal[face]
    return has_cell, excess, normal


def _apart(first, second):
    return 1 - np.square((first * second).sum(-1))


def volumes(weight, normal):
    """Volume of each voxel from the weights of its sides [voxels]."""
    total = 1 + weight.sum((1, 2))
    for i in np.ndindex(2, 2, 2):
        w, n = ([v[:, a, i[a]] for a in range(3)] for v in (weight, normal))
        triple = np.square(np.linalg.det(np.stack(n, axis=1)))
        total += w[0] * w[1] * w[2] * triple
    for (a, b), (i, j) in product(combinations(range(3), 2), np.ndindex(2, 2)):
        weights = weight[:, a, i] * weight[:, b, j]
        total += weights * _apart(normal[:, a, i], normal[:, b, j])
    return total


def sections(weight, normal, along):
    """Open areas of each voxel across x, y and z."""
    totals = []
    for axis in range(3):
        b, c = (a for a in range(3) if a != axis)
        weight_along = weight * (1 - np.square(normal[..., axis])) ** along
        total = 1 + weight_along[:, [b, c]].sum((1, 2))
        for i, j in np.ndindex(2, 2):
            product = weight_along[:, b, i] * weight_along[:, c, j]
            total += product * _apart(normal[:, b, i], normal[:, c, j])
        totals.append(total)
    return np.stack(totals, axis=1)


def cell_shapes(cells, owner, weight, normal):
    """Factor and shift of each cell, before the limit of the factor."""
    factor = np.ones(len(owner))
    shift = np.zeros((len(owner), 3))
    for axis in range(3):
        on_axis = np.flatnonzero(cells.on_face & (cells.axis == axis))
        loss = weight[owner[on_axis]] * _apart(
            normal[owner[on_axis]], cells.normal[on_axis][:, None, None]
        )
        for across in set(range(3)) - {axis}:
            below, above = loss[:, across].T
            factor[on_axis] *= 1 + below + above
            shift[on_axis, across] = (above - below) / 2
    return factor, shift


def links(voxel, section, sides, solid, min_open, smooth):
    """Extra conductance of each link of cut voxels, by its two voxels."""
    has_cell, excess, normal = sides
    index = {tuple(v): m for m, v in enumerate(voxel.tolist())}
    padded = np.pad(solid, 1)
    unit = np.eye(3, dtype=int)
    extras = {}

    def is_solid(v):
        return bool(padded[tuple(np.add(v, 1))])

    def add(p, q, extra):
        ends = (min(p, q), max(p, q))
        extras[ends] = extras.get(ends, 0.0) + extra

    for v, m in index.items():
        for axis, sign in product(range(3), (-1, 1)):
            neighbour = tuple(int(x) for x in np.add(v, sign * unit[axis]))
            if not is_solid(neighbour) or (sign < 0 and neighbour in index):
                continue
            end = section[index[neighbour], axis] if neighbour in index else 1.0
            add(v, neighbour, (section[m, axis] + end) / 2 - 1)
    for (v, m), (a, b), (i, j) in product(
        index.items(), combinations(range(3), 2), np.ndindex(2, 2)
    ):
        third = tuple(int(x) for x in np.subtract(v, (2 * j - 1) * unit[b]))
        second = tuple(int(x) for x in np.add(third, (2 * i - 1) * unit[a]))
        n = index.get(second)
        if n is None or not (
            has_cell[m, a, i] and has_cell[n, b, j] and is_solid(third)
        ):
            continue
        if normal[m, a, i] @ normal[n, b, j] <= smooth:
            continue
        total = normal[m, a, i] + normal[n, b, j]
        mean = total / np.linalg.norm(total)
        n_a = abs(mean[a])
        n_b = abs(mean[b])
        width = (excess[m, a, i] * n_a + excess[n, b, j] * n_b) / 2 + (n_a + n_b) / 4
        scale = max(width, 0) * (n_a + n_b) / max(n_a**2 + n_b**2, 1e-12)
        add(v, second, scale * n_a * n_b)
        add(v, third, scale * n_a * (n_a - n_b))
        add(second, third, scale * n_b * (n_b - n_a))
    for ends, extra in extras.items():
        if np.abs(np.subtract(ends[0], ends[1])).sum() == 1:
            extras[ends] = max(1 + extra, min_open) - 1
    return {ends: extra for ends, extra in extras.items() if abs(extra) > 1e-12}


def areas_of_mesh(area, position, normal, pieces, spacing):
    """Areas of cells by hat functions at every point, node by node.

    Pieces are (points, normal, area) with each point an equal part of the area.
    """

    def shares(points, normals):
        position = points / spacing + 1
        first = np.floor(position).astype(int)
        for corner in np.ndindex(2, 2, 2):
            node = first + corner
            hat = np.prod(1 - np.abs(position - node), axis=1)
            for axis, along in enumerate(normals.T):
                side = 2 * axis + (along > 0)
                yield (*node.T, side), hat * np.square(along)

    nodes = np.ceil(position.max(0) / spacing).astype(int) + 4
    mesh_area, cell_area = np.zeros((2, *nodes, 6))
    for points, normals, area_of_piece in pieces:
        for corner in points:
            for index, weight in shares(corner, normals):
                near = (
                    np.array(index[:3]) < np.array(mesh_area.shape[:3])[:, None]
                ).all(0)
                nodes_near = tuple(i[near] for i in index)
                np.add.at(
                    mesh_area, nodes_near, (weight * area_of_piece / len(points))[near]
                )
    for index, weight in shares(position, normal):
        np.add.at(cell_area, index, weight * area)
    ratio = mesh_area / np.where(cell_area > 0, cell_area, 1)
    factor = sum(weight * ratio[index] for index, weight in shares(position, normal))
    return area * np.clip(factor, 0.5, 2.0)
