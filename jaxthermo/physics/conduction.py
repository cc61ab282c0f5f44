"""Conduction between linked nodes (thesis eq. 4): q = G (T_j - T_i).

The operator follows from the structure and from the materials:

| structure | one material | several materials |
|---|---|---|
| full volume with `kernels="numba"` | `RunStencil` | refused |
| full volume | `Stencil` | `HeterogeneousStencil` |
| the same on several devices | `ShardedStencil` of these | `ShardedStencil` of these |
| with columns, in explicit steps | `ColumnNetwork` | `ColumnNetwork` |
| all others, and with weights | `RowNetwork` | `RowNetwork` |

Voxels that the surface cuts add a `CutStencil`, links that are not normal to their
faces `NonOrthogonal`. With a `Property` this is the operator at the reference
temperature, below `NonlinearNetwork` (Kirchhoff's transform) for one isotropic material
and below `VaryingLinks` for several or by axis.

Conductances are a pure function of a structure's geometry, its materials and weights.
The two halves of a link are in series, each with its length and conductivity,

    1 / G = (L_1 / k_1 + L_2 / k_2) / (w A).

The largest stable explicit step of a node is C / sum_j G_j (Fourier 1/6
for a voxel with six neighbours).

A material with a conductivity for each axis (diagonal K, in the body's frame) conducts
across a face of normal n with k = n . K n: the part of the flux -K grad T through the
face that depends on the temperatures of the two nodes at its sides alone.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..arrays import (
    Scalar,
    array_namespace,
    device_array,
    is_traced,
    namespace,
    stacked,
    typed_array,
)
from ..errors import InputError
from ..material.material import Material, Property
from ..network.link_operator import RowLayout, row_layout, row_network, series
from ..network.network import AbstractNetwork, precise_sum
from ..network.non_orthogonal import non_orthogonal
from ..network.nonlinear import NonlinearNetwork
from ..structures.kinds.full import FullVolume
from ..structures.partition.links import link_axes, non_orthogonal_links
from ..structures.structure import AbstractStructure
from ..structures.volumes import node_volumes
from .column_conduction import column_network
from .run_conduction import WITH_NUMBA, run_stencil
from .stencil_conduction import mixed_stencil, uniform_stencil
from .varying_conduction import transform_or_none, varying_links


_Values = Array | np.ndarray


def material_network(
    structure: AbstractStructure, material: Material, reference: Scalar, dtype: Any
) -> AbstractNetwork:
    """Network of a body of one material, with states relative to `reference` [K]."""
    constant = material.at(reference)
    network = assemble_uniform(
        structure,
        conductivity=constant.conductivity,
        volumetric_heat_capacity=constant.volumetric_heat_capacity,
        dtype=dtype,
    )
    if not material.varies:
        return network
    k = material.conductivity
    if isinstance(k, tuple) and any(isinstance(along, Property) for along in k):
        return varying_links(
            structure,
            base=network,
            number=np.zeros(structure.node_count, np.int32),
            materials=(material,),
            reference=reference,
            weights=_link_weights_or_none(structure, dtype),
        )
    return NonlinearNetwork(
        base=network,
        heat=transform_or_none(material.specific_heat, reference, dtype),
        conduction=transform_or_none(k, reference, dtype),
    )


def materials_network(
    structure: AbstractStructure,
    number: Int[np.ndarray, " n"],
    materials: Sequence[Material],
    reference: Scalar,
    dtype: Any,
) -> AbstractNetwork:
    """Network of a body of several materials, with states relative to `reference` [K].

    `number` is the index of each node's material.
    """
    k = conductivity_table(materials, reference, dtype)
    constant = [material.at(reference) for material in materials]
    heat = _heat_capacities(constant, dtype)
    network = _assemble_mixed(
        structure, material=number, conductivity=k, volumetric_heat_capacity=heat
    )
    if not any(material.varies for material in materials):
        return network
    return varying_links(
        structure,
        base=network,
        number=number,
        materials=materials,
        reference=reference,
        weights=_link_weights_or_none(structure, dtype),
    )


def _heat_capacities(materials: Sequence[Material], dtype: Any) -> Float[_Values, " c"]:
    """Heat capacity rho c_p of constant materials [J/(m^3 K)]."""
    density = [material.density for material in materials]
    specific_heat = [material.specific_heat for material in materials]
    if is_traced(density) and is_traced(specific_heat):
        return stacked(density, dtype) * stacked(specific_heat, dtype)
    return _table([m.volumetric_heat_capacity for m in materials], dtype)


def conductivity_table(
    materials: Sequence[Material], reference: Scalar, dtype: Any
) -> Float[_Values, " c"] | Float[_Values, "c 3"]:
    """Conductivities of several materials [W/(m K)], by axis if any is orthotropic.

    Those that vary are at the reference temperature [K]. The result is a numpy array
    unless a conductivity is traced.
    """
    constant = [material.at(reference) for material in materials]
    return _table([material.conductivity for material in constant], dtype)


def _table(numbers: Sequence[Any], dtype: Any) -> Float[_Values, "c *k"]:
    """Numbers, or three by axis, one row a material: on the host unless traced."""
    if not any(map(np.ndim, numbers)):
        return stacked(numbers, dtype)
    rows = [typed_array(number, dtype) for number in numbers]
    shape = max((row.shape for row in rows), key=len)
    xp = array_namespace(rows)
    return xp.stack([xp.broadcast_to(row, shape) for row in rows])


def conductivity_parts(
    materials: Sequence[Material],
    number: Int[np.ndarray, " s"],
    normal: Float[np.ndarray, "s 3"],
    reference: Scalar,
    dtype: Any,
) -> Float[Array, "q s"] | None:
    """Fractions of the conductivity normal to a surface, by material and axis [-].

    They are the argument of `relative_conductivity`. `number` is that of the material
    of every fragment; None is returned where no material varies with temperature, and
    for one isotropic material, whose conductivity varies as a whole.
    """
    varies = any(material.varies for material in materials)
    by_axis = any(isinstance(material.conductivity, tuple) for material in materials)
    if not varies or (len(materials) == 1 and not by_axis):
        return None
    table = conductivity_table(materials, reference, dtype)
    xp = array_namespace(table)
    squared = np.square(normal) if table.ndim == 2 else np.ones((len(normal), 1))
    columns = table if table.ndim == 2 else table[:, None]
    of_surface = normal_conductivity(table[number], normal)
    rows = []
    for c in range(len(materials)):
        squared_cosine = xp.asarray((number == c)[:, None] * squared, dtype)
        rows += list((squared_cosine * columns[c][None] / of_surface[:, None]).T)
    return device_array(xp.stack(rows))


def assemble_uniform(
    structure: AbstractStructure,
    conductivity: Any,
    volumetric_heat_capacity: Any,
    dtype: Any,
) -> AbstractNetwork:
    """Network of a body of one material, without an array of conductivities.

    The conductivity [W/(m K)] is one number, or three along x, y and z; the heat
    capacity rho c_p is in J/(m^3 K), and `dtype` is the type of the state.
    """
    k = typed_array(conductivity, dtype)
    heat = typed_array(volumetric_heat_capacity, dtype)
    return _ONE_MATERIAL[_form(structure)](structure, k, heat)


def _assemble_mixed(
    structure: AbstractStructure,
    material: Int[np.ndarray, " n"],
    conductivity: Float[_Values, " c"] | Float[_Values, "c 3"],
    volumetric_heat_capacity: Float[_Values, " c"],
) -> AbstractNetwork:
    """Network of a body of several materials, numbered by node.

    Conductivities [W/(m K)], one number or three by axis, and heat capacities rho c_p
    [J/(m^3 K)] have one row per material.
    """
    return _SEVERAL_MATERIALS[_form(structure)](
        structure, material, conductivity, volumetric_heat_capacity
    )


def _form(structure: AbstractStructure) -> str:
    """Form in which a structure conducts: "runs", "lattice" or "links"."""
    if not isinstance(structure, FullVolume):
        return "links"
    if structure.kernels == "numba":
        return "runs"
    return "lattice" if structure.runs_as_stencil else "links"


def _uniform_links(
    structure: AbstractStructure, k: Float[_Values, "*k"], heat: Float[_Values, ""]
) -> AbstractNetwork:
    # A single row of conductivities by axis stands for all nodes.
    return _assemble_links(structure, k[None] if k.ndim else k, heat)


def _mixed_links(
    structure: AbstractStructure,
    material: Int[np.ndarray, " n"],
    k: Float[_Values, "c *a"],
    heat: Float[_Values, " c"],
) -> AbstractNetwork:
    return _assemble_links(structure, k[material], heat[material])


def _refuse_mixed_runs(*_: Any) -> AbstractNetwork:
    raise InputError(f"{WITH_NUMBA} has one material: leave it out")


_ONE_MATERIAL: dict[str, Callable[..., AbstractNetwork]] = {
    "runs": run_stencil,
    "lattice": uniform_stencil,
    "links": _uniform_links,
}
_SEVERAL_MATERIALS: dict[str, Callable[..., AbstractNetwork]] = {
    "runs": _refuse_mixed_runs,
    "lattice": mixed_stencil,
    "links": _mixed_links,
}


def surface_conductivity(
    material: Material, normal: Float[np.ndarray, "s 3"], dtype: Any
) -> Float[_Values, "*s"]:
    """Conductivity k = n . K n normal to a surface [W/(m K)]; a number if k is one.

    The material must not vary with temperature (see `Material.at`). Normals are outward
    in the body's frame; the result is a numpy array unless k is traced.
    """
    by_axis = namespace(material.conductivity).asarray(material.conductivity, dtype)
    return normal_conductivity(by_axis[None], normal) if by_axis.ndim else by_axis


def normal_conductivity(
    conductivity: Float[_Values, " s"] | Float[_Values, "#s 3"],
    normal: Float[np.ndarray, "s 3"],
) -> Float[_Values, " s"]:
    """Conductivity k = n . K n normal to each surface [W/(m K)].

    Normals are outward in the body's frame.
    """
    if conductivity.ndim == 1:
        return conductivity
    return (conductivity * (normal * normal).astype(conductivity.dtype)).sum(axis=1)


def conductivity_at_ends(
    structure: AbstractStructure, k: Float[Any, "*k"]
) -> Sequence[Float[Any, "*#e"]]:
    """Conductivity along each link at both ends [W/(m K)]; one number if k is one.

    k is that of each node, along x, y, z if it has three columns; of all nodes if it
    has one row.
    """
    if not k.ndim:
        return k, k
    links = structure.links()
    if k.ndim == 1:
        return k[links.src], k[links.dst]
    xp = array_namespace(k)
    axes = xp.asarray(link_axes(structure), k.dtype)
    ends = [k[node] if len(k) > 1 else k for node in (links.src, links.dst)]
    return [(axes * by_axis).sum(axis=1) for by_axis in ends]


def _assemble_links(
    structure: AbstractStructure, k: Float[Any, "*k"], heat: Float[Any, "*n"]
) -> AbstractNetwork:
    links = structure.links()
    sizes = _LinkSizes(
        area=links.area,
        length_src=links.distance_src,
        length_dst=links.distance_dst,
        node_volume=structure.nodes().volume,
    )
    device_sizes = structure.found(
        ("link_sizes", k.dtype.name),
        lambda: jax.tree.map(lambda size: device_array(size, k.dtype), sizes),
    )
    k_src, k_dst = conductivity_at_ends(structure, k)
    columns = structure.columns
    if columns is not None:
        return column_network(
            structure,
            columns=columns,
            conductance=device_sizes.conductance(k_src, k_dst),
            capacity=heat * device_sizes.node_volume,
        )
    layout = structure.found(
        "row_layout",
        lambda: jax.tree.map(
            device_array, row_layout(len(sizes.node_volume), links.src, links.dst)
        ),
    )
    weights = structure.weights
    if weights.are_one and not weights.corrects_non_orthogonality:
        return _plain_network(
            layout, sizes=device_sizes, k_src=k_src, k_dst=k_dst, heat=heat
        )
    conductance = device_sizes.conductance(k_src, k_dst)
    capacity = heat * device_sizes.node_volume
    if not weights.are_one:
        conductance = conductance * _link_weights(structure, k.dtype)
        capacity = _weighted_capacity(structure, capacity)
    if not weights.corrects_non_orthogonality:
        return row_network(layout, conductance, capacity)
    return _corrected_network(
        structure, layout=layout, conductance=conductance, capacity=capacity
    )


class _LinkSizes(NamedTuple):
    """Geometry of the links and nodes of a structure."""

    area: Float[_Values, " e"]
    """Shared face of each link's nodes [m^2]."""
    length_src: Float[_Values, " e"]
    """Distance from the first node of each link to the face [m]."""
    length_dst: Float[_Values, " e"]
    """Distance from the second node of each link to the face [m]."""
    node_volume: Float[_Values, " n"]
    """Volume of each node [m^3]."""

    def conductance(self, k_src, k_dst) -> Float[Array, " e"]:
        """Conductances of the links [W/K], with the conductivities at both ends."""
        return series(
            self.area,
            length1=self.length_src,
            k1=k_src,
            length2=self.length_dst,
            k2=k_dst,
        )


@partial(jax.jit, inline=True)
def _plain_network(
    layout: RowLayout, sizes: _LinkSizes, k_src, k_dst, heat
) -> AbstractNetwork:
    """Network without weights, in one program."""
    conductance = sizes.conductance(k_src, k_dst)
    return row_network(layout, conductance, heat * sizes.node_volume)


def _corrected_network(structure, layout, conductance, capacity) -> AbstractNetwork:
    """Network with a correction for links that are not normal to their faces."""
    skewed = non_orthogonal_links(structure)
    if not len(skewed.link):
        return row_network(layout, conductance, capacity)
    weight = jnp.asarray(structure.weights.non_orthogonal, conductance.dtype)
    excess = device_array(skewed.length_ratio - 1, conductance.dtype)
    conductance = conductance * (1 + weight * excess)
    return non_orthogonal(
        row_network(layout, conductance, capacity),
        structure=structure,
        skewed=skewed,
        conductance=weight * conductance[skewed.link],
    )


def _link_weights_or_none(structure: AbstractStructure, dtype: Any):
    return None if structure.weights.are_one else _link_weights(structure, dtype)


def _link_weights(structure: AbstractStructure, dtype: Any) -> Float[Array, " e"]:
    """Weight of every link [-], from its level and position.

    Raises:
        InputError: if the weights are for another number of levels or links.
    """
    weights = structure.weights
    links = structure.links()
    level = structure.nodes().level
    low = np.minimum(level[links.src], level[links.dst])
    crosses = level[links.src] != level[links.dst]
    levels = int(level.max()) + 1
    within = _by_level(
        weights.within, levels=levels, level=low, name="within", dtype=dtype
    )
    between = _by_level(
        weights.between, levels=levels - 1, level=low, name="between", dtype=dtype
    )
    outside = np.zeros(len(level), bool)
    outside[structure.fragment_node()] = True
    touches = outside[links.src] | outside[links.dst]
    surface = jnp.where(touches, jnp.asarray(weights.surface, dtype), 1)
    factors = jnp.asarray(weights.links, dtype)
    if factors.ndim and len(factors) != structure.link_count:
        raise InputError(
            f"weights: links has {len(factors)} values and the structure has "
            f"{structure.link_count} links: they were fitted to another body or pitch"
        )
    return jnp.where(crosses, between, within) * surface * factors


def _weighted_capacity(
    structure: AbstractStructure, capacity: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Capacities [J/K] with the weights of their levels and of the nearest voxels.

    Raises:
        InputError: if the weights are for another number of levels.
    """
    # The total is conserved; with `nearest_capacity` it goes from that of the nodes to
    # that of the body.
    weights = structure.weights
    nodes = structure.nodes()
    dtype = capacity.dtype
    factor = _by_level(
        weights.capacity,
        levels=int(nodes.level.max()) + 1,
        level=nodes.level,
        name="capacity",
        dtype=dtype,
    )
    shifted = capacity * factor
    total = precise_sum(capacity)
    if weights.uses_nearest_capacity:
        nearest = _nearest_volume(structure) / nodes.volume
        exponent = jnp.asarray(weights.nearest_capacity, dtype)
        shifted = shifted * jnp.exp(exponent * jnp.asarray(np.log(nearest), dtype))
        # The nodes may have less capacity than the body; with weight 1 they have all.
        body_total = precise_sum(capacity * jnp.asarray(nearest, dtype))
        total = total * jnp.exp(exponent * jnp.log(body_total / total))
    return shifted * (total / precise_sum(shifted))


def _by_level(value, levels: int, level, name: str, dtype) -> Float[Array, " m"]:
    numbers = jnp.asarray(value, dtype)
    if numbers.ndim == 0:
        return jnp.broadcast_to(numbers, level.shape)
    if len(numbers) != levels:
        raise InputError(
            f"weights: {name} has {len(numbers)} values and the structure needs "
            f"{levels}; give one number, or one a level"
        )
    return numbers[np.minimum(level, max(levels - 1, 0))] if levels else numbers[level]


# Smallest nearest volume relative to the node's own: an edge node with a tenth would
# make the explicit step ten times as short.
_MIN_NEAREST_FRACTION = 0.5


def _nearest_volume(structure: AbstractStructure) -> Float[np.ndarray, " n"]:
    """Volume of all solid voxels nearest to each node [m^3], for `nearest_capacity`."""
    minimum = _MIN_NEAREST_FRACTION * structure.nodes().volume
    return np.maximum(node_volumes(structure), minimum)
