"""From a scene to the smallest program that does it.

A term that can do nothing is not bound, a body of one material gets no array of
conductivities, a scene without surface terms never touches its surface: what is left
out has no array and no operation in the program, and the receipt says why.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..array_types import Scalar
from ..constants import STEFAN_BOLTZMANN
from ..errors import InputError
from ..memory import require_memory
from ..network.network import AbstractNetwork, Address
from ..physics.conduction import assemble_mixed, assemble_uniform
from ..physics.term import AbstractBoundTerm, LeftOut, Surface
from ..physics.values import is_unknown_function, knots
from ..structures.structure import AbstractStructure
from ..tracing import is_traced
from .receipt import Omission, Receipt
from .scene import Body, MaterialMap, Scene
from .surface import SolvedSurface, body_geometry


State = tuple[Float[Array, "..."], ...]
"""Temperature above the reference at every node, one array a body [K]."""


class BodyProgram(eqx.Module):
    """One body: its network, where its surface lies, and the terms on it."""

    network: AbstractNetwork
    address: Address
    """Of the node under each surface fragment."""
    terms: tuple[tuple[int, AbstractBoundTerm], ...]
    """With the number of the mechanism in `Program.mechanisms`."""
    reference: Float[Array, ""]
    """What the state counts from [K]."""


class Program(eqx.Module):
    """All that the solver needs, and nothing else."""

    bodies: tuple[BodyProgram, ...]
    mechanisms: tuple[str, ...] = eqx.field(static=True)
    knots: tuple[float, ...] = eqx.field(static=True)
    """Times the solver lands on besides the save times [s]."""
    sampled: bool = eqx.field(static=True)
    """Whether some value is a function of time, known only where it is evaluated."""


class Compiled(eqx.Module):
    """A program with its initial state, surfaces and receipt."""

    program: Program
    state: State
    surfaces: tuple[SolvedSurface, ...]
    hottest: Any
    """end [s] -> highest temperature that emission must be stable at [K]."""
    receipt: Receipt = eqx.field(static=True)


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


def _address(structure: AbstractStructure) -> Address:
    """Of the node under each fragment, which must come in the order of the state."""
    address = structure.fragment_address()
    place = np.ravel_multi_index(address, structure.state_shape)
    if (np.diff(place) < 0).any():
        raise ValueError(
            f"{type(structure).__name__}: fragments must be sorted by their nodes"
        )
    return tuple(jnp.asarray(index) for index in address)


def _surface(
    index: int, body: Body, triangles: np.ndarray, dtype: Any
) -> tuple[Surface, SolvedSurface]:
    grid, properties = body.structure.grid, _properties(body, dtype)
    surface = Surface(
        body=index,
        pitch=grid.pitch,
        position=body.pose.place(grid.fragment_position),
        normal=body.pose.turn(grid.fragment_normal),
        area=jnp.asarray(grid.fragment_area, dtype),
        own_position=grid.fragment_position,
        own_normal=grid.fragment_normal,
        conductivity=properties["conductivity"],
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


def _bind(scene: Scene, surface: Surface, reference: Scalar) -> tuple[list, list]:
    """The terms on one body, and what was left out with the reason."""
    bound, omitted = [], []
    for number, term in enumerate(scene.terms):
        result = term.bind(surface, reference)
        if isinstance(result, LeftOut):
            omitted.append((number, result.why))
        else:
            bound.append((number, result))
    return bound, omitted


def _check_memory(scene: Scene, saves: int) -> int:
    """Forecast of the solver's peak memory [bytes], refused if there is not enough."""
    width = 8 if scene.dtype == "float64" else 4
    total = 0
    for body in scene.bodies:
        cells = int(np.prod(body.structure.state_shape))
        fragments = len(body.structure.grid.fragment_area)
        copies = 4 if not isinstance(body.material, MaterialMap) else 12
        # Saved rows are held twice while the solution is put together.
        total += cells * (copies * width + 1) + fragments * (30 + 2 * saves) * width
        if body.structure.dense is None:
            total += body.structure.link_count * (3 * width + 8)
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
    programs, states, solved, omissions = [], [], [], []
    for index, body in enumerate(scene.bodies):
        surface, view = _surface(index, body, triangles, dtype)
        reference, state = _initial(body, dtype)
        bound, omitted = _bind(scene, surface, reference)
        programs.append((surface, reference, bound))
        states.append(state)
        solved.append(view)
        where = f" on body {index}" if len(scene.bodies) > 1 else ""
        omissions += [Omission(names[n] + where, why) for n, why in omitted]
        if not isinstance(body.material, MaterialMap):
            omissions.append(
                Omission(f"per-node conductivity{where}", "the material is uniform")
            )
    omissions += _absent(scene)
    used = sorted({number for _, _, bound in programs for number, _ in bound})
    bodies = tuple(
        BodyProgram(
            network=_network(body, dtype),
            address=_address(body.structure),
            terms=tuple((used.index(n), term) for n, term in bound),
            reference=jnp.asarray(reference, dtype),
        )
        for body, (_, reference, bound) in zip(scene.bodies, programs, strict=True)
    )
    values = [value for n in used for value in scene.terms[n].values]
    return Compiled(
        program=Program(
            bodies=bodies,
            mechanisms=tuple(names[n] for n in used),
            knots=tuple(sorted({k for value in values for k in knots(value)})),
            sampled=any(is_unknown_function(value) for value in values),
        ),
        state=tuple(states),
        surfaces=tuple(solved),
        hottest=lambda end: _hottest(scene, states, bodies, end),
        receipt=Receipt(
            included=("conduction", *(names[n] for n in used)),
            left_out=tuple(omissions),
            nodes=sum(b.structure.node_count for b in scene.bodies),
            links=sum(b.structure.link_count for b in scene.bodies),
            fragments=sum(len(s.area) for s, _, _ in programs),
            dtype=scene.dtype,
            memory_bytes=memory,
        ),
    )


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
