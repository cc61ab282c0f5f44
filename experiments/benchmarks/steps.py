"""A step of each structure in the standard scene, conduction alone, and scipy.

Times of the same nodes and links, in turn: an explicit step with sun, convection and
the energy ledger; the conduction in it alone; the same by gathering both ends of every
link and adding to them, the simplest form; and scipy's product with the links as a
sparse matrix (CSR), in one thread. These three must give the same temperatures. Reading
the surface is the time to observe as many states as are saved, over its surface cells
and these states. A loop that takes no step besides makes what its steps share, products
with the length of the step.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array, diags_array, identity

import jaxthermo as jt
from jaxthermo.integrate.run.plan import initial_state, plan_run
from jaxthermo.integrate.run.solution import Observation, observe
from jaxthermo.integrate.stepper import RunState
from jaxthermo.network.link_operator import LinkNetwork
from jaxthermo.network.network import AbstractNetwork
from jaxthermo.physics.conduction import assemble_uniform
from jaxthermo.report.numbers import with_range
from jaxthermo.scene.compile.program import Program
from jaxthermo.structures.structure import AbstractStructure, Links
from jaxthermo.timing import Spread, interleaved, ratio_of

from ..harness.agreement import largest_difference
from ..harness.link_matrix import laplacian
from ..harness.measurement import MeasuredResult, Measurement, compared, plain_rows
from ..harness.meshes import END, SAVE_AT, STEEL, standard_scene, statue
from ..harness.present import show, table_of
from .loops import loop_of, per_item


QUICK = {"height": 48, "repeats": 3}

STRUCTURES: dict[str, Callable[..., Any]] = {
    "blocks x8": lambda grid: jt.Aggregate(grid, 8),
    "blocks x4": lambda grid: jt.Aggregate(grid, 4),
    "blocks x2": lambda grid: jt.Aggregate(grid, 2),
    "layer over core x4": lambda grid: jt.ShellOverCore(grid, 1, 4),
    "octree": jt.Octree,
    "full volume": jt.FullVolume,
}
"""Structures of a grid, by name."""
MAX_DT = 0.5
"""Step of conduction alone [stable steps]."""
# Evaluations that are timed together: about a hundredth of a second at 1 ns a node.
_WORK = 1e7
_MOST = 4000
_PRODUCTS = 10
_MAX_DIFFERENCE = 1e-5
"""Largest difference of states after these steps, which are 0 to 1 at the start."""


class _Costs(TypedDict):
    """Times of every call of one structure, and how many times as long they take."""

    nodes: int
    links: int
    surface_cells: int
    spans_s: dict[str, list[float]]
    links_over_conduction: Spread
    scipy_over_conduction: Spread
    reading_s: list[float]
    largest_difference: float


class _Row(_Costs):
    structure: str


class _Result(MeasuredResult):
    mesh: str
    height: int
    rows: list[_Row]


def run(folder: Path, height: int = 250, repeats: int = 7) -> _Result:
    """Times of a step, and of what is in it, for each structure."""
    name, grid = statue(height)
    rows: list[_Row] = []
    for label, structure in STRUCTURES.items():
        scene = standard_scene(structure(grid))
        rows.append({"structure": label, **_measured(scene, repeats)})

    def microseconds(key: str) -> Callable[[dict], str]:
        return lambda row: Spread.of(row["spans_s"][key]).text()

    def over_conduction(key: str) -> Callable[[dict], str]:
        return lambda row: with_range(*row[f"{key}_over_conduction"])

    columns = [
        ("", "{structure}"),
        ("nodes", "{nodes:,}"),
        ("explicit step", microseconds("step")),
        ("conduction alone", microseconds("conduction")),
        ("gathered links", microseconds("links")),
        ("over conduction", over_conduction("links")),
        ("scipy CSR", microseconds("scipy")),
        ("over conduction", over_conduction("scipy")),
        ("reading a cell", lambda row: f"{1e9 * np.median(row['reading_s']):.1f} ns"),
    ]
    show(table_of(rows, columns, f"{name}, {height} high, this host"))
    measured = [measurement for row in rows for measurement in _measurements(row)]
    return {
        "mesh": name,
        "height": height,
        "rows": rows,
        "measurements": plain_rows(measured),
    }


def _measurements(row: _Row) -> list[Measurement]:
    label = row["structure"]
    spans = row["spans_s"]
    conduction = spans["conduction"]
    conduction_peers = {
        "gathered links": spans["links"],
        "scipy CSR, one thread": spans["scipy"],
    }
    return [
        *compared(
            name=f"{label}: explicit step",
            ours=spans["step"],
            peers={"conduction alone": conduction},
            overhead=True,
            note=f"{row['nodes']:,} nodes, {row['surface_cells']:,} surface cells",
        ),
        *compared(
            name=f"{label}: conduction alone",
            ours=conduction,
            peers=conduction_peers,
            note=f"results agree to {row['largest_difference']:.1g} of 1",
        ),
        Measurement(f"{label}: reading a surface cell", "s", row["reading_s"]),
    ]


def _measured(scene: jt.Scene, repeats: int) -> _Costs:
    plan = plan_run(scene, t1=END, save_at=SAVE_AT, solver=jt.ForwardEuler())
    program = plan.compiled.program
    receipt = plan.compiled.receipt
    network = program.bodies[0].network
    start = initial_state(plan)
    count = int(np.clip(_WORK / receipt.nodes, 20, _MOST)) // 2 * 2
    # Other states each time, or a compiler would read the surface once for all.
    saved = jnp.asarray(SAVE_AT, plan.dtype)

    def shifted_states(values: jax.Array) -> jax.Array:
        return jnp.stack([values + time for time in saved])

    states = jax.tree.map(shifted_states, start)
    dt = jnp.asarray(plan.stable_step, plan.dtype)
    body = scene.bodies[0]
    assert isinstance(body.material, jt.Material)
    state = jnp.asarray(random_state(body.structure))
    values = state[body.structure.node_address()]

    def conduct(steps: int = count) -> jax.Array:
        return euler_steps(network, state, dt, jnp.int32(steps))

    conduction = _conduction(body.structure, body.material)
    link_steps = _link_steps(conduction, values, dt)
    scipy_steps = _scipy_steps(conduction, np.asarray(values), float(dt))
    difference = largest_difference(
        f"state of {receipt.nodes} nodes after {_PRODUCTS} steps",
        {
            "conduction": conduct(_PRODUCTS)[body.structure.node_address()],
            "links": link_steps(),
            "scipy": scipy_steps(),
        },
        tolerance=_MAX_DIFFERENCE,
    )
    spans = interleaved(
        {
            "loop": loop_of(plan, count),
            "no steps": loop_of(plan, 0),
            "reading": lambda: _observe_all(program, states, saved),
            "conduction": conduct,
            "links": link_steps,
            "scipy": scipy_steps,
        },
        repeats,
    )
    cells = program.bodies[0].node.shape[0]
    step = (np.array(spans["loop"]) - np.array(spans["no steps"])) / count
    counts = {"conduction": count, "links": _PRODUCTS, "scipy": _PRODUCTS}
    counts["reading"] = len(SAVE_AT) * cells
    item_spans = per_item(spans, counts)
    reading = item_spans.pop("reading")
    conduction_spans = item_spans["conduction"]
    return {
        "nodes": receipt.nodes,
        "links": receipt.links,
        "surface_cells": cells,
        "spans_s": {"step": step.tolist(), **item_spans},
        "links_over_conduction": ratio_of(item_spans["links"], conduction_spans),
        "scipy_over_conduction": ratio_of(item_spans["scipy"], conduction_spans),
        "reading_s": reading,
        "largest_difference": difference,
    }


@eqx.filter_jit
def _observe_all(
    program: Program, states: RunState, times: jax.Array
) -> tuple[Any, Observation]:
    """Observations of states, one after the other."""

    def observe_row(_, row):
        return None, observe(program, *row)

    return jax.lax.scan(observe_row, None, (states, times))


@eqx.filter_jit
def euler_steps(
    network: AbstractNetwork, state: jax.Array, dt: jax.Array, steps: jax.Array
) -> jax.Array:
    """A state after steps of `dt` [s] of conduction."""

    # Two steps a turn exchange their buffers, as in the time loop.
    def two_steps(_, state):
        return network.euler_step(network.euler_step(state, dt), dt)

    return jax.lax.fori_loop(0, steps // 2, two_steps, state)


def random_state(structure: AbstractStructure) -> Float[np.ndarray, "..."]:
    """A state of random temperatures from 0 to 1 K, in float32."""
    state = np.zeros(structure.state_shape, np.float32)
    values = np.random.default_rng(0).random(structure.node_count)
    state[structure.node_address()] = values
    return state


def conduction_call(structure: AbstractStructure, steps: int) -> Callable[[], Any]:
    """A call that takes steps of conduction in steel, in float32."""
    return partial(conduction_of(structure), steps)


def conduction_of(structure: AbstractStructure) -> Callable[[int], jax.Array]:
    """The state after a number of steps of conduction in steel, in float32."""
    heat = STEEL.volumetric_heat_capacity
    network = assemble_uniform(
        structure,
        conductivity=STEEL.conductivity,
        volumetric_heat_capacity=heat,
        dtype=jnp.float32,
    )
    start = jnp.asarray(random_state(structure))
    dt = MAX_DT / network.max_rate()
    return lambda steps: euler_steps(network, start, dt, jnp.int32(steps))


class _Conduction(NamedTuple):
    """Conduction of a structure of one material, link by link."""

    links: Links
    conductance: Float[np.ndarray, " e"]
    """Conductance of each link [W/K]."""
    capacity: Float[np.ndarray, " n"]
    """Heat capacity of each node [J/K]."""


def _conduction(structure: AbstractStructure, material: jt.Material) -> _Conduction:
    links = structure.links()
    heat = float(material.volumetric_heat_capacity)
    return _Conduction(
        links=links,
        conductance=np.asarray(material.conductivity) * links.area / links.length,
        capacity=heat * structure.nodes().volume,
    )


def _link_steps(
    conduction: _Conduction, start: jax.Array, dt: jax.Array
) -> Callable[[], jax.Array]:
    """Steps that gather both ends of every link and add to them."""
    network = LinkNetwork(
        src=jnp.asarray(conduction.links.src, jnp.int32),
        dst=jnp.asarray(conduction.links.dst, jnp.int32),
        conductance=jnp.asarray(conduction.conductance, start.dtype),
        node_capacity=jnp.asarray(conduction.capacity, start.dtype),
    )
    return lambda: euler_steps(network, start, dt, jnp.int32(_PRODUCTS))


def _scipy_steps(
    conduction: _Conduction, start: Float[np.ndarray, " n"], dt: float
) -> Callable[[], np.ndarray]:
    """Steps T + A T of a matrix with an entry for each link at each node."""
    links, conductance, capacity = conduction
    count = len(capacity)
    loss = laplacian(links, conductance, count)
    step = identity(count) - diags_array(dt / capacity) @ loss
    matrix = csr_array(step, dtype=np.float32)

    def steps() -> np.ndarray:
        values = start
        for _ in range(_PRODUCTS):
            values = matrix @ values
        return values

    return steps
