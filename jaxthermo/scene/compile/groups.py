"""Groups of bodies that conduct as one network.

Bodies of one form are a group: their nodes are numbered through and their materials are
a table, so that a program has as many operations for many bodies as for a few. A body
that is alone in its form, or that a stencil conducts faster, is a group by itself.
"""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import numpy as np
from jaxtyping import Int

from ...arrays import is_traced, namespace
from ...material.material import Material
from ...memo.found import found
from ...memo.once import once
from ...network.group_order import GroupOrder, group_order
from ...structures.joined import JoinedStructure
from ...structures.kinds.full import FullVolume
from ...structures.kinds.sheet import Sheet
from ...structures.structure import AbstractStructure, AbstractVoxelStructure
from ...structures.weights import ConductionWeights
from ..body_materials import AbstractMaterials
from ..scene import Body, Scene


_LEAST_BODIES = 4
"""Number of bodies of one form that are joined: fewer compile fast one by one."""

_MOST_VOXELS = 16384
"""Voxels above which a stencil of its own may pay: below, the steps of one network with
others take no longer, and it compiles in half the time of four stencils."""

_MIN_SAVED = 2**25
"""Stages of single nodes that slow bodies must save in a run to be apart from fast
ones: less would not pay for the compilation of another network."""

_SLOWER = 16.0
"""Ratio of diffusion rates, of the fastest body to one that counts as slow: a step of
the slow one takes a quarter of the stages."""


@dataclass(frozen=True, eq=False)
class BodyGroup:
    """Bodies that conduct as one network."""

    numbers: tuple[int, ...]
    """Numbers of the bodies in the scene."""
    bodies: tuple[Body, ...]
    """The bodies, in the form in which they are joined."""
    structure: AbstractStructure
    """Nodes of all bodies, one body after the other."""

    @property
    def is_single(self) -> bool:
        """True for a body by itself."""
        return len(self.numbers) == 1

    @cached_property
    def nodes(self) -> list[Int[np.ndarray, " _"]]:
        """Nodes of each body among those of the structure, in the body's own order."""
        if isinstance(self.structure, JoinedStructure):
            return self.structure.nodes_of_parts()
        return [np.arange(self.structure.node_count, dtype=np.int32)]

    @cached_property
    def fragments(self) -> list[slice]:
        """Fragments of each body among those of the structure."""
        if isinstance(self.structure, JoinedStructure):
            return self.structure.fragment_slices
        return [slice(0, len(self.structure.grid.fragment_area))]

    @cached_property
    def member_of_node(self) -> Int[np.ndarray, " n"]:
        """Index of the body of each node in the group."""
        member = np.empty(self.structure.node_count, np.int32)
        for number, nodes in enumerate(self.nodes):
            member[nodes] = number
        return member

    @cached_property
    def member_of_fragment(self) -> Int[np.ndarray, " s"]:
        """Index of the body of each fragment in the group."""
        sizes = [fragments.stop - fragments.start for fragments in self.fragments]
        return np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)

    def on_nodes(self, values: Sequence[Any]) -> Any:
        """Values of all nodes, from those of each body, which may be one number."""
        xp = namespace(values)
        rows = [
            xp.broadcast_to(value, len(nodes))
            for value, nodes in zip(values, self.nodes, strict=True)
        ]
        order = np.concatenate(self.nodes)
        joined = xp.concatenate(rows)
        if np.array_equal(order, np.arange(len(order))):
            return joined
        return joined[np.argsort(order)]


def fragment_order(
    groups: tuple[BodyGroup, ...],
) -> tuple[Int[np.ndarray, " s"], GroupOrder | None]:
    """Fragment of the scene of each fragment of the groups, and their order."""
    numbers = [number for group in groups for number in group.numbers]
    counts = [c.stop - c.start for group in groups for c in group.fragments]
    return group_order(numbers, counts)


def body_groups(
    scene: Scene, classes: tuple[int, ...] | None = None
) -> tuple[BodyGroup, ...]:
    """Groups of the bodies of a scene, see `grouped_numbers`."""
    return tuple(
        _joined(scene, numbers) if len(numbers) > 1 else _single(scene, numbers[0])
        for numbers in grouped_numbers(scene, classes)
    )


def grouped_numbers(
    scene: Scene, classes: tuple[int, ...] | None = None
) -> list[list[int]]:
    """Numbers of the bodies of each group, in the order of the scene.

    Bodies of a group have one class, as those of `speed_classes`; by default, all do.
    """
    if len(scene.bodies) < _LEAST_BODIES:
        return [[number] for number in range(len(scene.bodies))]
    if classes is None:
        classes = (0,) * len(scene.bodies)
    return found(
        (scene,),
        by=("grouped numbers", classes),
        find=lambda: _grouped_numbers(scene, classes),
    )


def _grouped_numbers(scene: Scene, classes: tuple[int, ...]) -> list[list[int]]:
    forms: dict[Hashable, list[int]] = {}
    # Most bodies share one map.
    flattened = once(jax.tree.flatten)
    for number, (body, form) in enumerate(
        zip(scene.bodies, _body_forms(scene), strict=True)
    ):
        if form is None:
            forms[number] = [number]
            continue
        leaves, outline = flattened(body.surface_map)
        map_form = id(body.surface_map) if leaves else outline
        forms.setdefault((form, map_form, classes[number]), []).append(number)
    groups = []
    for numbers in forms.values():
        if len(numbers) >= _LEAST_BODIES:
            groups.append(numbers)
        else:
            groups += [[number] for number in numbers]
    return sorted(groups)


def speed_classes(scene: Scene, end: float) -> tuple[int, ...]:
    """Class of each body in a run up to `end` [s]: 1 for slow ones, 0 for all others.

    Apart from a fast body, slow ones take few stages in a step, see `part_stepper`:
    that saves a long run much, and a short one less than it costs.
    """
    # Many bodies share a material.
    largest_diffusivity = once(_largest_diffusivity)
    rates = [
        0.0
        if form is None or isinstance(body.structure, Sheet)
        else largest_diffusivity(body.material) / body.structure.grid.pitch**2
        for body, form in zip(scene.bodies, _body_forms(scene), strict=True)
    ]
    fastest = max(rates, default=0.0)
    is_slow = [0 < rate < fastest / _SLOWER for rate in rates]
    nodes = sum(
        body.structure.node_count
        for body, is_one in zip(scene.bodies, is_slow, strict=True)
        if is_one
    )
    # Those of one step as long as the run, by the stable step 1 / (6 rate): a run of n
    # steps takes sqrt(n) times as many.
    stages = 2 * math.sqrt(6 * fastest * end)
    pays = nodes * stages >= _MIN_SAVED
    return tuple(int(is_one and pays) for is_one in is_slow)


def _largest_diffusivity(solid: Material | AbstractMaterials | None) -> float:
    """Largest diffusivity of constant materials [m^2/s]; 0 where it is not known."""
    if is_traced(solid):
        return 0.0
    diffusivities = [
        np.max(material.conductivity) / (material.density * material.specific_heat)
        for material in _materials(solid)
    ]
    return float(max(diffusivities))


def _materials(solid: Any) -> tuple:
    return solid.materials if isinstance(solid, AbstractMaterials) else (solid,)


def _single(scene: Scene, number: int) -> BodyGroup:
    body = scene.bodies[number]
    return BodyGroup((number,), (body,), body.structure)


def _joined(scene: Scene, numbers: list[int]) -> BodyGroup:
    bodies = tuple(_as_links(scene.bodies[number]) for number in numbers)
    structure = JoinedStructure.of(tuple(body.structure for body in bodies))
    return BodyGroup(tuple(numbers), bodies, structure)


def _as_links(body: Body) -> Body:
    structure = as_links(body.structure)
    return body if structure is body.structure else replace(body, structure=structure)


def as_links(structure: AbstractStructure) -> AbstractStructure:
    """The form of a structure in which it is joined to others."""
    return structure.as_links if isinstance(structure, FullVolume) else structure


def _body_forms(scene: Scene) -> tuple[Hashable | None, ...]:
    """The same value for bodies that may be joined; None for one by itself."""

    def find() -> tuple[Hashable | None, ...]:
        structure_forms = found(
            scene.structures,
            by="forms of structures",
            find=lambda: tuple(map(once(_structure_form), scene.structures)),
        )
        # Many bodies share a material.
        is_varying = once(_is_varying)
        return tuple(
            None if is_varying(body.material) else form
            for body, form in zip(scene.bodies, structure_forms, strict=True)
        )

    return found((scene,), by="forms of bodies", find=find)


def _structure_form(structure: AbstractStructure) -> Hashable | None:
    """The same value for structures that may be joined; None for one by itself."""
    if structure.device_count > 1 or not structure.identity:
        return None
    columns = structure.columns
    layers = 0 if columns is None else len(columns.link)
    if isinstance(structure, Sheet):
        return Sheet, layers
    is_voxels = isinstance(structure, AbstractVoxelStructure)
    if not is_voxels or not _has_no_effect(structure.weights):
        return None
    if isinstance(structure, FullVolume) and (
        structure.kernels is not None or structure.node_count > _MOST_VOXELS
    ):
        return None
    return AbstractVoxelStructure, layers


def _is_varying(solid: Material | AbstractMaterials | None) -> bool:
    """True if a material of a solid body varies with temperature."""
    # The layers of a sheet have its materials.
    if solid is None:
        return False
    return any(material.varies for material in _materials(solid))


def _has_no_effect(weights: ConductionWeights) -> bool:
    ones = (
        weights.within,
        weights.between,
        weights.surface,
        weights.capacity,
        weights.links,
        weights.surface_distance,
    )
    zeros = weights.nearest_capacity, weights.non_orthogonal
    return all(_is(value, 1) for value in ones) and all(_is(v, 0) for v in zeros)


def _is(value: Any, number: int) -> bool:
    return isinstance(value, float | int) and value == number
