"""A step of each structure in the standard scene, conduction alone, and scipy.

Times of the same nodes and links, in turn: an explicit step with sun, convection and
the energy ledger; the conduction in it alone; the same by gathering both ends of every
link and adding to them, the simplest form; and scipy's product of the links as a sparse
matrix (CSR), in one thread. Reading the surface is the time to observe as
many states as are saved, over its surface cells and these states. A loop that takes no
step besides makes what its steps share, products with the length of the step.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypedDict

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.sparse import csr_array, identity

import jaxthermo as jt
from jaxthermo.integrate.run.plan import initial_state, plan_run
from jaxthermo.integrate.run.solution import Observation, observe
from jaxthermo.integrate.stepper import RunState
from jaxthermo.network.link_operator import LinkNetwork
from jaxthermo.network.network import AbstractNetwork
from jaxthermo.physics.conduction import assemble_uniform
from jaxthermo.report.numbers import with_range
from jaxthermo.scene.compile.program import Program
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.timing import Spread, interleaved, ratio_of

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
# Evaluations that are timed together: about a hundredth of a second at 1 ns a node.
_WORK = 1e7
_MOST = 4000
_PRODUCTS = 10


class _Costs(TypedDict):
    """Times of every call of one structure, and how many times as long they take."""

    nodes: int
    links: int
    surface_cells: int
    spans_s: dict[str, list[float]]
    links_over_conduction: Spread
    scipy_over_conduction: Spread
    reading_s: list[float]


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
        *compared(f"{label}: conduction alone", conduction, conduction_peers),
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
    state = start.theta[0]

    def conduct() -> jax.Array:
        return euler_steps(network, state, dt, jnp.int32(count))

    product = _scipy_product(scene, state)
    spans = interleaved(
        {
            "loop": loop_of(plan, count),
            "no steps": loop_of(plan, 0),
            "reading": lambda: _observe_all(program, states, saved),
            "conduction": conduct,
            "links": _link_steps(scene, state),
            "scipy": product,
        },
        repeats,
    )
    cells = program.bodies[0].node.shape[0]
    step = (np.array(spans["loop"]) - np.array(spans["no steps"])) / count
    counts = {"conduction": count, "links": _PRODUCTS, "scipy": _PRODUCTS}
    counts["reading"] = len(SAVE_AT) * cells
    item_spans = per_item(spans, counts)
    reading = item_spans.pop("reading")
    conduction = item_spans["conduction"]
    return {
        "nodes": receipt.nodes,
        "links": receipt.links,
        "surface_cells": cells,
        "spans_s": {"step": step.tolist(), **item_spans},
        "links_over_conduction": ratio_of(item_spans["links"], conduction),
        "scipy_over_conduction": ratio_of(item_spans["scipy"], conduction),
        "reading_s": reading,
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
    state = np.zeros(structure.state_shape, np.float32)
    values = np.random.default_rng(0).random(structure.node_count)
    state[structure.node_address()] = values
    start = jnp.asarray(state)
    dt = 0.5 / network.max_rate()
    return lambda steps: euler_steps(network, start, dt, jnp.int32(steps))


def _link_steps(scene: jt.Scene, state: jax.Array) -> Callable[[], jax.Array]:
    """Steps that gather both ends of every link and add to them."""
    structure = scene.bodies[0].structure
    links = structure.links()
    # Only the pattern of the links counts for their time.
    network = LinkNetwork(
        src=jnp.asarray(links.src, jnp.int32),
        dst=jnp.asarray(links.dst, jnp.int32),
        conductance=jnp.full(len(links.src), 0.1, state.dtype),
        node_capacity=jnp.ones(structure.node_count, state.dtype),
    )
    start = state[structure.node_address()]
    dt = jnp.asarray(1, state.dtype)
    return lambda: euler_steps(network, start, dt, jnp.int32(_PRODUCTS))


def _scipy_product(scene: jt.Scene, state: jax.Array) -> Callable[[], np.ndarray]:
    """One product T + A T of a matrix with an entry for each link at each node."""
    structure = scene.bodies[0].structure
    links = structure.links()
    nodes = structure.node_count
    # Only the pattern of the matrix counts for its time.
    ratio = np.full(len(links.src), 0.1, np.float32)
    pairs = (
        np.concatenate([links.src, links.dst]),
        np.concatenate([links.dst, links.src]),
    )
    matrix = csr_array((np.tile(ratio, 2), pairs), shape=(nodes, nodes))
    matrix = csr_array(matrix + identity(nodes, "float32"))
    values = np.asarray(state[structure.node_address()])

    def products() -> np.ndarray:
        # Without what a call of its own costs.
        for _ in range(_PRODUCTS - 1):
            _ = matrix @ values
        return matrix @ values

    return products
