"""From a scene to the smallest program that does it.

A term that can do nothing is not bound, a body of one material gets no array of
conductivities, a scene without surface terms never touches its surface: what is left
out has no array and no operation in the program, and the receipt says why.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..array_types import Scalar
from ..constants import STEFAN_BOLTZMANN
from ..errors import InputError
from ..memory import require_memory
from ..network.network import AbstractNetwork, Address
from ..physics.balance import SurfaceTerms
from ..physics.conduction import assemble_mixed, assemble_uniform
from ..physics.term import Binding, LeftOut, Surface
from ..physics.values import is_unknown_function, knots
from ..structures.structure import AbstractStructure
from ..tracing import is_traced
from .program import (
    BodyProgram,
    Compiled,
    Program,
    SurfaceLoad,
    SurfaceReading,
)
from .receipt import Omission, Receipt
from .scene import Body, MaterialMap, Scene
from .surface import SolvedSurface, body_geometry


def mechanism_names(scene: Scene) -> tuple[str, ...]:
    """One name a term: its kind, numbered from the second of a kind on."""
    names: list[str] = []
    for term in scene.terms:
        count = sum(name.split("#")[0] == term.name for name in names) + 1
        names.append(term.name if count == 1 else f"{term.name}#{count}")
    return tuple(names)


def _properties(body: Body, dtype: Any) -> dict[str, Float[Array, "..."]]:
    """Conductivity, emissivity, absorptivity at the surface: numbers, or a fragment."""
    fields = ("conductivity", "emissivity", "absorptivity")
    material = body.material
    if not isinstance(material, MaterialMap):
        return {f: jnp.asarray(getattr(material, f), dtype) for f in fields}
    grid = body.structure.grid
    number = material.number(grid.lattice.centres(grid.fragment_voxel))
    return {f: material.table(f, dtype)[number] for f in fields}


def _network(body: Body, dtype: Any) -> AbstractNetwork:
    material = body.material
    if not isinstance(material, MaterialMap):
        return assemble_uniform(
            body.structure,
            material.conductivity,
            material.volumetric_heat_capacity,
            dtype,
        )
    number = material.number(body.structure.nodes().centre)
    return assemble_mixed(
        body.structure,
        number,
        material.table("conductivity", dtype),
        material.table("volumetric_heat_capacity", dtype),
    )


def _initial(body: Body, dtype: Any) -> tuple[Scalar, Float[Array, "..."]]:
    """The body's reference temperature [K] and its state at the start.

    The reference is the mean at the start. It is no variable: of a traced start only
    the state, which is 0 where the start is uniform, carries a derivative.
    """
    state = jnp.zeros(body.structure.state_shape, dtype)
    values: Any = body.temperature
    if callable(values):
        values = values(body.structure.nodes().centre)
    elif not is_traced(values):
        return float(values), state
    if is_traced(values):
        values = values.astype(dtype)
        reference = jax.lax.stop_gradient(values.mean())
    else:
        values = np.asarray(values, float)
        if not np.isfinite(values).all() or (values < 0).any():
            raise InputError(
                "Body(temperature=) gives values that are no temperatures in kelvin"
            )
        reference = float(values.mean())
    above = jnp.asarray(values - reference, dtype)
    return reference, state.at[body.structure.node_address()].set(above)


def _surface(
    index: int, body: Body, triangles: np.ndarray, dtype: Any
) -> tuple[Surface, SolvedSurface]:
    structure, properties = body.structure, _properties(body, dtype)
    grid = structure.grid
    area = jnp.asarray(grid.fragment_area, dtype)
    distance = jnp.asarray(structure.fragment_distance(), dtype)
    surface = Surface(
        body=index,
        pitch=grid.pitch,
        position=body.pose.place(grid.fragment_position),
        normal=body.pose.turn(grid.fragment_normal),
        area=area,
        own_position=grid.fragment_position,
        own_normal=grid.fragment_normal,
        free=np.ones(len(area), bool),
        half_cell=properties["conductivity"] * area / distance,
        emissivity=properties["emissivity"],
        absorptivity=properties["absorptivity"],
        scene_triangles=triangles,
        dtype=dtype,
    )
    solved = SolvedSurface(
        geometry=body_geometry(grid, body.pose),
        emissivity=properties["emissivity"],
        absorptivity=properties["absorptivity"],
    )
    return surface, solved


class _Bound(NamedTuple):
    """The terms on one body, and what was left out with the reason."""

    free: list[tuple[int, Binding]]
    held: list[tuple[int, Binding]]
    omitted: list[tuple[int, str]]
    surface: Surface


def _bind(scene: Scene, surface: Surface, reference: Scalar) -> _Bound:
    """What holds the surface first, the last of it before the others."""
    numbered = list(enumerate(scene.terms))
    holding = [(n, t) for n, t in numbered if t.holds(surface) is not None]
    rest = [(n, t) for n, t in numbered if t.holds(surface) is None]
    bound = _Bound([], [], [], surface)
    for number, term in holding[::-1]:
        result = term.bind(surface, reference)
        held = term.holds(surface)
        if isinstance(result, LeftOut) or held is None:
            bound.omitted.append((number, getattr(result, "why", "")))
        else:
            bound.held.insert(0, (number, result))
            surface = replace(surface, free=surface.free & ~held)
    for number, term in rest:
        result = term.bind(surface, reference)
        if isinstance(result, LeftOut):
            bound.omitted.append((number, result.why))
        else:
            bound.free.append((number, result))
    bound.omitted.sort()
    return bound._replace(surface=surface)


class _Prepared(NamedTuple):
    """One body, ready to be put into the program."""

    body: Body
    reference: Scalar
    state: Float[Array, "..."]
    bound: _Bound
    solved: SolvedSurface

    @property
    def numbers(self) -> set[int]:
        """Of the terms that act on it."""
        return {number for number, _ in (*self.bound.free, *self.bound.held)}


def _prepare(index: int, scene: Scene, triangles: np.ndarray, dtype: Any) -> _Prepared:
    body = scene.bodies[index]
    surface, solved = _surface(index, body, triangles, dtype)
    reference, state = _initial(body, dtype)
    return _Prepared(body, reference, state, _bind(scene, surface, reference), solved)


def _body_program(
    prepared: _Prepared, used: list[int], names: tuple[str, ...], dtype: Any
) -> BodyProgram:
    body, bound = prepared.body, prepared.bound
    renumber = lambda terms: tuple((used.index(n), b.term) for n, b in terms)
    half_cell = jnp.where(bound.surface.free, bound.surface.half_cell, 0)
    terms = SurfaceTerms(names, half_cell, renumber(bound.free), renumber(bound.held))
    network = _network(body, dtype)
    nodes, node = np.unique(body.structure.fragment_node(), return_inverse=True)
    return BodyProgram(
        network=network,
        reference=jnp.asarray(prepared.reference, dtype),
        load=_load(body.structure, network, terms, bound),
        reading=SurfaceReading(
            address=_address(body.structure, nodes),
            node=jnp.asarray(node.reshape(-1).astype(np.int32)),
            terms=terms,
            surface_map=body.surface_map.bind(body.structure, dtype),
        ),
    )


def _address(structure: AbstractStructure, nodes: Int[np.ndarray, " m"]) -> Address:
    return tuple(jnp.asarray(index[nodes]) for index in structure.node_address())


def _load(
    structure: AbstractStructure,
    network: AbstractNetwork,
    terms: SurfaceTerms,
    bound: _Bound,
) -> SurfaceLoad | None:
    """Fragments of one node with the same terms as one place."""
    acts = [binding.acts for _, binding in (*bound.free, *bound.held)]
    if not acts:
        return None
    signature = np.zeros(len(acts[0]), np.int64)
    for each in acts:
        # Counted anew each time, so that any number of terms fits.
        signature = np.unique(2 * signature + each, return_inverse=True)[1].reshape(-1)
    touched = np.flatnonzero(np.any(acts, axis=0))
    key = structure.fragment_node().astype(np.int64) * (signature.max() + 1) + signature
    places, inverse = np.unique(key[touched], return_inverse=True)
    place = np.full(len(key), -1, np.int32)
    place[touched] = inverse.reshape(-1)
    nodes, node = np.unique(places // (signature.max() + 1), return_inverse=True)
    node = node.reshape(-1).astype(np.int32)
    count = np.bincount(node)
    rank = np.arange(len(node)) - np.repeat(np.cumsum(count) - count, count)
    slots = np.full((count.max(), len(nodes)), len(places), np.int32)
    slots[rank, node] = np.arange(len(places))
    address, capacity = _address(structure, nodes), network.capacity()
    return SurfaceLoad(
        address=address,
        capacity=capacity[address] if capacity.ndim else capacity,
        node=jnp.asarray(node),
        slots=tuple(jnp.asarray(slot) for slot in slots),
        terms=terms.merged(place, len(places)),
    )


def _check_memory(scene: Scene, saves: int) -> int:
    """Forecast of the solver's peak memory [bytes], refused if there is not enough."""
    width = 8 if scene.dtype == "float64" else 4
    total = 0
    for body in scene.bodies:
        structure = body.structure
        cells = int(np.prod(structure.state_shape))
        fragments = len(structure.grid.fragment_area)
        copies = 4 if not isinstance(body.material, MaterialMap) else 12
        # Saved rows are held twice while the solution is put together.
        total += cells * (copies * width + 1) + fragments * (40 + 2 * saves) * width
        if len(structure.state_shape) == 1:
            # A link stands in two rows, with the neighbour's number and conductance.
            total += structure.link_count * (5 * width + 24)
    remedy = "use a coarser pitch, or save fewer times"
    require_memory(total, "simulating this scene", remedy)
    return total


def compile_scene(scene: Scene, saves: int = 1) -> Compiled:
    """Bind every term to every body it acts on; drop what does nothing.

    Args:
        scene: bodies and terms.
        saves: how many times will be kept, for the forecast of memory.

    Raises:
        InputError: if the program would not fit into memory.
    """
    memory, dtype = _check_memory(scene, saves), jnp.dtype(scene.dtype)
    names = mechanism_names(scene)
    triangles = np.concatenate(
        [b.pose.place(b.structure.grid.mesh.triangles) for b in scene.bodies]
    )
    prepared = [
        _prepare(index, scene, triangles, dtype) for index in range(len(scene.bodies))
    ]
    used = sorted(set().union(*(one.numbers for one in prepared)))
    mechanisms = tuple(names[n] for n in used)
    bodies = tuple(_body_program(one, used, mechanisms, dtype) for one in prepared)
    values = [value for n in used for value in scene.terms[n].values]
    states = tuple(one.state for one in prepared)
    structures = [body.structure for body in scene.bodies]
    return Compiled(
        program=Program(
            bodies=bodies,
            mechanisms=mechanisms,
            knots=tuple(sorted({k for value in values for k in knots(value)})),
            sampled=any(is_unknown_function(value) for value in values),
        ),
        state=states,
        surfaces=tuple(one.solved for one in prepared),
        hottest=lambda end: _hottest(scene, states, bodies, end),
        receipt=Receipt(
            included=("conduction", *mechanisms),
            left_out=tuple(_omissions(scene, prepared, names)),
            nodes=sum(s.node_count for s in structures),
            links=sum(s.link_count for s in structures),
            fragments=sum(len(s.grid.fragment_area) for s in structures),
            capacity_ratios=tuple(s.capacity_ratio for s in structures),
            dtype=scene.dtype,
            memory_bytes=memory,
        ),
    )


def _omissions(scene: Scene, prepared: list[_Prepared], names) -> list[Omission]:
    omissions = []
    for index, one in enumerate(prepared):
        where = f" on body {index}" if len(prepared) > 1 else ""
        omissions += [Omission(names[n] + where, why) for n, why in one.bound.omitted]
        if not isinstance(one.body.material, MaterialMap):
            omissions.append(
                Omission(f"per-node conductivity{where}", "the material is uniform")
            )
    return omissions + _absent(scene)


ABSENT = {
    "sun": "the scene has no source",
    "convection": "the scene has no moving air or coefficient",
    "emission": "the scene has no surroundings",
}
"""Why a mechanism of most scenes is not in this one."""


def _absent(scene: Scene) -> list[Omission]:
    """Mechanisms that one might look for and that nothing in the scene asks for."""
    present = {term.name for term in scene.terms}
    one = "there is one body" if len(scene.bodies) == 1 else "no term joins the bodies"
    missing = [
        Omission(name, why) for name, why in ABSENT.items() if name not in present
    ]
    return [*missing, Omission("contact", one)]


def _hottest(scene, states, bodies, end: float) -> Float[Array, ""]:
    """An upper bound of temperatures up to `end` [K] where surfaces emit.

    Without imposed fluxes nothing gets hotter than the start or what terms pull to (the
    maximum principle). With them a surface that sheds the flux by emission alone does;
    where nothing emits there is no bound, and none is needed.
    """
    start = [b.reference + s.max() for b, s in zip(bodies, states, strict=True)]
    drives = [term.drive(end) for term in scene.terms]
    pulls = [drive.temperature for drive in drives]
    pushed = sum(jnp.maximum(drive.heat_flux, 0.0) for drive in drives)
    bound = jnp.stack([jnp.asarray(v, float) for v in (*start, *pulls)]).max()
    least = jnp.stack(
        [jnp.min(jnp.asarray(_least_emissivity(b), float)) for b in scene.bodies]
    ).min()
    shed = pushed / (STEFAN_BOLTZMANN * jnp.maximum(least, 1e-3))
    return (bound**4 + shed) ** 0.25


def _least_emissivity(body: Body) -> Any:
    if isinstance(body.material, MaterialMap):
        return body.material.table("emissivity", float)
    return body.material.emissivity
