"""Probes: temperatures at points in and on bodies, as weights on nodes and fragments.

A point x in the volume of node i, with the nearest fragment s, has

    T(x) = (1 - w) T_i + w T_s + g_i . (x - (1 - w) x_i - w x_s),

g the gradient at the node by least squares over its links, and w from 0 at the depth of
the fragment's node to 1 at the surface, where the temperature of the surface counts and
not that of its node. T(x) is exact where the temperature is linear, and of second order
in the pitch where it is smooth. A surface that is held at a temperature has it at all
of its points: there x_s is the point of the surface above x. T(x) is limited to the
range of its node, the nodes linked to it and the surface above it, see `surface_map`.
Next to another material a difference of two nodes is scaled to the gradient at the
node, by the conductivities at both ends of the link.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Bool, Float, Int
from scipy.spatial import KDTree

from ...arrays import Scalar, array_namespace, device_array, taken
from ...errors import InputError
from ...memo.found import digest, found
from ...network.network import Address
from ...physics.conduction import conductivity_at_ends, conductivity_table
from ...structures.partition.assignment import voxel_owner
from ...structures.structure import AbstractVoxelStructure
from ...structures.surface_map import Range, gradient_rows
from ...voxels.abstract_grid import AbstractGrid
from ...voxels.grid import VoxelGrid
from ..air import bodies_around_air, bodies_with_surface
from ..body_materials import AbstractMaterials
from ..named import Probe
from ..scene import Body, Scene
from .bodies import PreparedGroup


class BodyProbes(Module):
    """The probes of a group of bodies."""

    body: int = eqx.field(static=True)
    """Number of the group in the program."""
    number: tuple[int, ...] = eqx.field(static=True)
    """Numbers of the probes in the scene."""
    address: tuple[Int[Array, " q"], ...]
    """Position of each probe's node in the state."""
    neighbour: tuple[Int[Array, " r"], ...]
    """Position of the neighbours that the gradients use."""
    row: Int[Array, " r"]
    """Probe of each neighbour."""
    inside_weight: Float[Array, " r"]
    """Weight of each neighbour's temperature above that of the node [-], from the node
    to the point by the part 1 - w."""
    surface_weight: Float[Array, " r"]
    """The like from the fragment to the point by the part w."""
    fragment: Int[Array, " q"]
    """Nearest fragment of the group."""
    at_surface: Float[Array, " q"]
    """w [-]: 1 at the surface, 0 at the depth of a node."""

    def read(
        self,
        theta: Float[Array, "..."],
        surface: Float[Array, " s"],
        held: Bool[Array, " s"] | None,
    ) -> Float[Array, " q"]:
        """Temperatures of the probes, from those of the nodes and the fragments [K].

        All are above the reference of the body. Where fragments are `held`, their
        temperature is that of the whole surface; None for none.
        """
        node = taken(theta, self.address)
        if not len(surface):
            return node
        neighbour = taken(theta, self.neighbour)
        on_surface = self.surface_weight
        if held is not None:
            on_surface = jnp.where(held[self.fragment][self.row], 0, on_surface)
        weight = self.inside_weight + on_surface
        steps = weight * (neighbour - node[self.row])
        along = jnp.zeros_like(node).at[self.row].add(steps)
        return node + self.at_surface * (surface[self.fragment] - node) + along

    def limited(
        self,
        values: Float[Array, " q"],
        theta: Float[Array, "..."],
        around: Range,
        surface_node: Int[Array, " s"],
    ) -> Float[Array, " q"]:
        """Temperatures of the probes within the range of what surrounds them [K].

        `around` is the range of each node with surface and its fragments, and
        `surface_node` the index of each fragment's node among these.
        """
        if not len(surface_node):
            return values
        node = taken(theta, self.address)
        reached = Range(node, node)
        reached = reached.including_groups(taken(theta, self.neighbour), self.row)
        above = surface_node[self.fragment]
        is_near = self.at_surface > 0
        for ends in around:
            reached = reached.including(jnp.where(is_near, ends[above], node))
        return jnp.clip(values, reached.lowest, reached.highest)


# Distance within which a point is on a sheet, not behind it [m].
_ON_SURFACE = 1e-9


class _Member(NamedTuple):
    """A body of a group, with its place in the group."""

    number: int
    """Number of the body in the scene."""
    body: Body
    reference: Scalar
    """Temperature from which its state counts [K]."""
    group: PreparedGroup
    nodes: Int[np.ndarray, " n"]
    """Its nodes among those of the group."""
    first_fragment: int

    def address_of(self, nodes: Int[np.ndarray, " m"]) -> Address:
        """Position of some of its nodes in the state of the group."""
        return self.group.address_of(self.nodes[nodes])


def _members(prepared: tuple[PreparedGroup, ...]) -> list[_Member]:
    """All bodies, in the order of the scene."""
    bodies = [
        _Member(
            number=number,
            body=body,
            reference=reference,
            group=group,
            nodes=nodes,
            first_fragment=fragments.start,
        )
        for group in prepared
        for number, body, reference, nodes, fragments in zip(
            group.group.numbers,
            group.group.bodies,
            group.references,
            group.group.nodes,
            group.group.fragments,
            strict=True,
        )
    ]
    return sorted(bodies, key=lambda member: member.number)


_ON_WALL = 0.1
"""Height above a surface, over the edge of its cells, up to which a probe in a cavity
is on the surface and not in the air."""


class _Located(NamedTuple):
    """Points relative to one body."""

    inside: Bool[np.ndarray, " p"]
    """True where the point is in a solid voxel."""
    voxel: Int[np.ndarray, "p 3"]
    """Voxel that contains the point, or the nearest voxel of the surface."""
    gap: Float[np.ndarray, " p"]
    """Distance from the point to that voxel [m]."""


def bind_probes(
    scene: Scene, prepared: tuple[PreparedGroup, ...], dtype: Any
) -> tuple[BodyProbes, ...]:
    """Bind the probes of a scene to the bodies that they are in or on.

    If several bodies contain a point, the first counts. A point in a cavity, farther
    from all surfaces than a tenth of a cell, reads the air there if that is a body.

    Raises:
        InputError: for a point farther than a voxel from every body, or inside a body
            whose structure has no nodes there.
    """
    positions = np.array([probe.position for probe in scene.probes])
    bodies = _members(prepared)
    surfaced = bodies[: len(bodies_with_surface(scene))]
    points = [member.body.pose.at(0.0).to_body(positions) for member in surfaced]
    located = [
        _located(member.body.structure.grid, body_points)
        for member, body_points in zip(surfaced, points, strict=True)
    ]
    gap = np.stack([body_located.gap for body_located in located])
    nearest = gap.argmin(axis=0)
    pitch = np.array([member.body.structure.grid.pitch for member in surfaced])
    is_far = gap.min(axis=0) > pitch[nearest]
    air = _air_around(scene, surfaced, points, gap)
    nearest = np.where(air < 0, nearest, air)
    is_far &= air < 0
    bound = {
        bodies[number].group.number: [
            _in_air(bodies[number], np.flatnonzero(air == number), dtype)
        ]
        for number in np.unique(air[air >= 0]).tolist()
    }
    for n, probe in enumerate(scene.probes):
        if is_far[n]:
            raise InputError(
                f"probe {_at(probe)} is in no body: the nearest, body {nearest[n]}, "
                f"is {gap[nearest[n], n]:.3g} m away; give points in the world, where "
                "the bodies are at the start"
            )
    for body, body_points, body_located in zip(surfaced, points, located, strict=True):
        number = np.flatnonzero(nearest == body.number)
        if len(number):
            body_located = _Located._make(column[number] for column in body_located)
            probes = [scene.probes[n] for n in number]
            bound.setdefault(body.group.number, []).append(
                _bind(
                    body,
                    probes=probes,
                    number=number,
                    points=body_points[number],
                    located=body_located,
                    dtype=dtype,
                )
            )
    return tuple(_joined(bound[group]) for group in sorted(bound))


def _air_around(
    scene: Scene,
    surfaced: list[_Member],
    points: list[Float[np.ndarray, "p 3"]],
    gap: Float[np.ndarray, "b p"],
) -> Int[np.ndarray, " p"]:
    """Number of the body of air that each probe is in; -1 for none.

    Args:
        scene: with its bodies of air.
        surfaced: bodies that have a surface.
        points: the probes in the frame of each of them [m].
        gap: distance of the probes from each of them [m].
    """
    air = np.full(gap.shape[1], -1)
    around_air = bodies_around_air(scene)
    if not around_air:
        return air
    grids = [member.body.structure.grid for member in surfaced]
    is_clear = np.ones(len(air), bool)
    for grid, body_points, body_gap in zip(grids, points, gap, strict=True):
        height = body_gap
        if not isinstance(grid, VoxelGrid):
            # Cells of a wall are wide, and a point in front of one is not on it.
            distance, fragment = KDTree(grid.fragment_position).query(body_points)
            away = body_points - grid.fragment_position[fragment]
            above = np.abs((away * grid.fragment_normal[fragment]).sum(axis=1))
            height = np.where(distance > grid.pitch, distance, above)
        is_clear &= height > _ON_WALL * grid.pitch
    # The innermost cavity counts, whose body is the smallest.
    numbers = sorted(around_air, key=lambda n: -grids[around_air[n]].cavity_volume)
    for number in numbers:
        cavities = grids[around_air[number]].cavities
        if cavities is not None:
            air[is_clear & (cavities.at(points[around_air[number]]) > 0)] = number
    return air


def _joined(probes: list[BodyProbes]) -> BodyProbes:
    """Probes of several bodies of one group."""
    if len(probes) == 1:
        return probes[0]
    starts = np.cumsum([0, *(len(of_body.number) for of_body in probes)])[:-1]
    rows = [
        replace(of_body, number=(), body=0, row=of_body.row + np.int32(start))
        for of_body, start in zip(probes, starts, strict=True)
    ]
    joined = jax.tree.map(lambda *parts: jnp.concatenate(parts), *rows)
    number = sum((of_body.number for of_body in probes), ())
    return replace(joined, number=number, body=probes[0].body)


def _in_air(air: _Member, number: Int[np.ndarray, " q"], dtype: Any) -> BodyProbes:
    """Probes with these numbers in a body of air, which has one temperature."""
    node = np.zeros(len(number), np.int32)
    none = device_array(np.zeros(0, np.int32))
    no_weight = device_array(np.zeros(0), dtype)
    return BodyProbes(
        body=air.group.number,
        number=tuple(number.tolist()),
        address=air.address_of(node),
        neighbour=(none,),
        row=none,
        inside_weight=no_weight,
        surface_weight=no_weight,
        fragment=device_array(node),
        at_surface=device_array(np.zeros(len(number)), dtype),
    )


def _at(probe: Probe) -> str:
    x, y, z = probe.position
    return f"{probe.name} at ({x:g}, {y:g}, {z:g}) m"


def _located(grid: AbstractGrid, points: Float[np.ndarray, "p 3"]) -> _Located:
    return found(
        (grid,), ("points_in_voxels", digest(points)), lambda: _locate(grid, points)
    )


def _locate(grid: AbstractGrid, points: Float[np.ndarray, "p 3"]) -> _Located:
    if not isinstance(grid, VoxelGrid):
        distance, fragment = KDTree(grid.fragment_foot).query(points)
        return _Located(
            inside=np.zeros(len(points), bool),
            voxel=np.zeros((len(points), 3), int),
            gap=np.maximum(distance - grid.pitch, 0.0),
        )
    cell = np.floor(grid.lattice.to_cells(points))
    inside = grid.contains(points)
    centres = grid.fragment_centre
    _, fragment = KDTree(centres).query(points)
    beyond = np.abs(points - centres[fragment]) - grid.pitch / 2
    gap = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    voxel = np.where(inside[:, None], cell.astype(int), grid.fragment_voxel[fragment])
    return _Located(inside, voxel, np.where(inside, 0.0, gap))


def _bind(
    body: _Member,
    probes: list[Probe],
    number: Int[np.ndarray, " q"],
    points: Float[np.ndarray, "q 3"],
    located: _Located,
    dtype: Any,
) -> BodyProbes:
    structure = body.body.structure
    grid = structure.grid
    location = structure.nodes().location
    fragment = found(
        (grid,),
        ("points_on_surface", digest(points)),
        lambda: _nearest_fragment(grid, points),
    )
    surface = grid.fragment_foot[fragment]
    depth = ((surface - points) * grid.fragment_normal[fragment]).sum(axis=1)
    at_surface = np.clip(1 - depth / structure.fragment_distance[fragment], 0, 1)
    # A fragment around a corner or across a gap says nothing about this point.
    far = np.linalg.norm(surface - points, axis=1) > 2 * grid.pitch + np.abs(depth)
    at_surface[far] = 0.0
    node = _nodes(
        body,
        probes=probes,
        located=located,
        at_surface=at_surface,
        fragment=fragment,
    )
    node = structure.node_at_depth(
        node, fragment=fragment, depth=np.where(far, np.inf, depth)
    )
    from_node = (1 - at_surface)[:, None] * (points - location[node])
    from_fragment = at_surface[:, None] * (points - surface)
    gradient_nodes, index = np.unique(node, return_inverse=True)
    rows = gradient_rows(structure, gradient_nodes)
    start = np.searchsorted(rows.node, index)
    count = np.searchsorted(rows.node, index, side="right") - start
    row = np.repeat(np.arange(len(node)), count)
    within = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    entry = start[row] + within
    inside_weight, surface_weight = (
        (rows.weight[entry] * offset[row]).sum(axis=1)
        for offset in (from_node, from_fragment)
    )
    ratio = _slope_ratio(
        body, link=rows.link[entry], is_src=rows.is_src[entry], dtype=dtype
    )
    return BodyProbes(
        body=body.group.number,
        number=tuple(number.tolist()),
        address=body.address_of(node),
        neighbour=body.address_of(rows.neighbour[entry]),
        row=device_array(row.astype(np.int32)),
        inside_weight=device_array(inside_weight, dtype) * ratio,
        surface_weight=device_array(surface_weight, dtype) * ratio,
        fragment=device_array((fragment + body.first_fragment).astype(np.int32)),
        at_surface=device_array(at_surface, dtype),
    )


def _nearest_fragment(
    grid: AbstractGrid, points: Float[np.ndarray, "q 3"]
) -> Int[np.ndarray, " q"]:
    if grid.fragment_face is None:
        _, fragment = KDTree(grid.fragment_foot).query(points)
        return np.asarray(fragment)
    # Both faces of a sheet are at one place: a point behind it is on its back.
    front = np.flatnonzero(grid.fragment_face == 0)
    _, nearest = KDTree(grid.fragment_position[front]).query(points)
    away = points - grid.fragment_position[nearest]
    is_behind = (away * grid.fragment_normal[nearest]).sum(axis=1) < -_ON_SURFACE
    return np.where(is_behind, nearest + len(front), nearest)


def _nodes(
    body: _Member,
    probes: list[Probe],
    located: _Located,
    at_surface: Float[np.ndarray, " q"],
    fragment: Int[np.ndarray, " q"],
) -> Int[np.ndarray, " q"]:
    """Node of the voxel of each probe, or of its cell of a sheet."""
    structure = body.body.structure
    if not isinstance(structure, AbstractVoxelStructure):
        return structure.fragment_node()[fragment]
    solid = structure.grid.solid
    order = np.full(solid.shape, -1)
    order[solid] = np.arange(structure.grid.solid_count)
    voxel = order[tuple(located.voxel.T)]
    voxel_node = structure.voxel_node()[voxel]
    nearest = voxel_owner(structure)[voxel]
    # Next to the surface the nearest node stands for a voxel that has none.
    for n in np.flatnonzero((voxel_node < 0) & ((at_surface <= 0) | (nearest < 0))):
        raise InputError(
            f"probe {_at(probes[n])} is inside body {body.number}, where a "
            f"{type(structure).__name__} has no nodes: give the body a structure that "
            "fills it, or a point on its surface"
        )
    return np.where(voxel_node < 0, nearest, voxel_node)


def _slope_ratio(
    body: _Member,
    link: Int[np.ndarray, " r"],
    is_src: Bool[np.ndarray, " r"],
    dtype: Any,
) -> Float[Array, "*r"]:
    """Slope at the node itself over the mean slope of each of these links [-]."""
    # The flux is the same in both halves: k_1 s_1 = k_2 s_2, and the mean slope is that
    # over both lengths. The ratio is 1 for a single material.
    structure = body.body.structure
    material = body.body.material
    if not isinstance(material, AbstractMaterials):
        return jnp.ones((), dtype)
    table = conductivity_table(material.materials, body.reference, dtype)
    k = table[material.of_nodes(structure)]
    links = structure.links()
    src_k, dst_k = conductivity_at_ends(structure, k)
    k1 = src_k[link]
    k2 = dst_k[link]
    xp = array_namespace(k)
    d1 = xp.asarray(links.distance_src[link], dtype)
    d2 = xp.asarray(links.distance_dst[link], dtype)
    far_k = xp.where(is_src, k2, k1)
    return device_array((d1 + d2) * far_k / (d1 * k2 + d2 * k1))
