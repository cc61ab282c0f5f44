"""RKL2 of the full volume beside the same scheme in numba, in one run.

The same voxels, links, loads, steps and stages. The peer is what an engineer would
write by hand: row spans of solid voxels, the stage's mix fused into the stencil, two
threads; loads are one flux and one coefficient for each voxel with surface, which its
author knows to be enough here and the scene compiler does not. They take turns.
"""

from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numba
import numpy as np

import jaxthermo as jt
from jaxthermo.integrate.explicit import RKL2Stepper, rkl2_coefficients, stage_count
from jaxthermo.integrate.run.plan import Plan, initial_state, plan_run
from jaxthermo.integrate.stepper import advance
from jaxthermo.network.stencil import UniformStencil

from ..harness.measurement import Measurement, plain_rows
from ..harness.meshes import STEEL, standard_scene
from ..harness.timing import interleaved, ratio_of


QUICK = {"height": 48, "repeats": 2}
_BOUND = 0.75
"""Speed relative to numba that a kernel must have."""

# Numbers of steps for the first 90 s of the standard scene [s], in the sun: with
# many stages and with few.
_STEPS, _END = (18, 36), 90.0


class _Peer(NamedTuple):
    # The arrays of a scene that the numba loop reads.
    # x, y, first z and z past the last of every span of solid voxels.
    rows: np.ndarray
    degree: np.ndarray
    # Conductance over capacity [1/s].
    conducts: float
    # Positions of voxels with surface in the flat state; the loads of each at 0 K above
    # the reference [K/s], and what they fall by for each kelvin [1/s].
    surface: np.ndarray
    gain: np.ndarray
    loss: np.ndarray


@numba.njit(parallel=True, fastmath=True)
def _stage(rows, degree, last, before, zero, change, out, c):
    # One stage but for its loads; c: dt w G/C, mu, nu, 1 - mu - nu, a mu.
    g, mu, nu, rest, a = c
    for r in numba.prange(rows.shape[0]):
        i, j, low, high = rows[r]
        here, above, below = last[i, j], last[i, j + 1], last[i, j - 1]
        ahead, behind, links = last[i + 1, j], last[i - 1, j], degree[i, j]
        old, first, slope, target = before[i, j], zero[i, j], change[i, j], out[i, j]
        # Apart, each loop has few enough arrays to be vectorized.
        for k in range(low, high):
            near = here[k - 1] + here[k + 1] + above[k] + below[k] + ahead[k]
            near += behind[k] - np.float32(links[k]) * here[k]
            target[k] = mu * (here[k] + g * near)
        for k in range(low, high):
            target[k] += nu * old[k] + rest * first[k] - a * slope[k]


@numba.njit(parallel=True, fastmath=True)
def _load(surface, gain, loss, last, out, span):
    for n in numba.prange(surface.shape[0]):
        place = surface[n]
        out[place] += span * (gain[n] - loss[n] * last[place])


@numba.njit(parallel=True, fastmath=True)
def _first(rows, zero, change, last):
    # From E - Y to Y + (E - Y) / 3, where the second stage starts.
    for r in numba.prange(rows.shape[0]):
        i, j, low, high = rows[r]
        for k in range(low, high):
            last[i, j, k] = zero[i, j, k] + change[i, j, k] / np.float32(3)


def _peer_run(peer: _Peer, state: np.ndarray, dt: float, steps: int, stages: int):
    weight, table = 4 / (stages**2 + stages - 2), rkl2_coefficients(stages)
    one = lambda *values: tuple(np.float32(v) for v in values)
    span = dt * weight
    g = span * peer.conducts
    zero = state.copy()
    before, last, change, other = (np.zeros_like(state) for _ in range(4))

    def stage(here, old, slope, out, mu, nu, rest, a):
        c = one(g, mu, nu, rest, a)
        _stage(peer.rows, peer.degree, here, old, zero, slope, out, c)
        flat = here.reshape(-1), out.reshape(-1)
        _load(peer.surface, peer.gain, peer.loss, *flat, np.float32(span * mu))

    for _ in range(steps):
        # Of what is not there yet the weight is 0.
        stage(zero, zero, zero, change, 1, 0, -1, 0)
        _first(peer.rows, zero, change, last)
        old = zero
        for j in range(2, stages + 1):
            mu, nu, a = (table[name][j] for name in ("mu", "nu", "a"))
            stage(last, old, change, other, mu, nu, 1 - mu - nu, a * mu)
            free = before if old is zero else old
            old, last, other = last, other, free
        zero, last, before = last, zero, old
    return zero


def _peer_of(todo: Plan, scene: jt.Scene) -> _Peer:
    # The same loads and links as plain arrays. A linear load is known from two states.
    program, structure = todo.compiled.program, scene.bodies[0].structure
    network, surface = program.bodies[0].network, program.surface
    assert isinstance(network, UniformStencil) and surface is not None
    load = surface.by_cell
    (cells,) = load.cells
    solid = np.pad(structure.grid.solid, 1)
    edges = np.diff(solid.astype(np.int8), axis=2)
    i, j, low = np.nonzero(edges == 1)
    high = np.nonzero(edges == -1)[2]
    begin = jnp.float32(0)
    zero = jnp.zeros(cells.node.shape, jnp.float32)
    capacity = float(network.node_capacity)
    heat = lambda theta: np.asarray(load.terms.heat(begin, theta)[0], float)
    own = lambda each: np.bincount(cells.node, each) / capacity
    cold, warm = own(heat(zero)), own(heat(zero + 1))
    address = tuple(np.asarray(index) for index in cells.address)
    return _Peer(
        rows=np.stack([i, j, low + 1, high + 1], axis=1),
        degree=np.pad(np.asarray(network.degree), 1),
        conducts=float(network.conductance) / capacity,
        surface=np.ravel_multi_index(address, solid.shape),
        gain=cold.astype(np.float32),
        loss=(cold - warm).astype(np.float32),
    )


def _compare(scene: jt.Scene, steps: int, repeats: int) -> dict[str, Any]:
    dt = _END / steps
    todo = plan_run(scene, _END, None, jt.SuperTimeStepping(dt=dt))
    stages = stage_count(dt, float(todo.compiled.stable_step))
    peer, first = _peer_of(todo, scene), initial_state(todo)
    begin, span = jnp.float32(0), jnp.float32(dt)
    program, stepper = todo.compiled.program, RKL2Stepper(stages)
    count = jnp.int32(steps)
    loop = eqx.filter_jit(lambda p, s: advance(stepper, p, s, begin, span, count))
    ours = lambda: jax.block_until_ready(loop(program, first)).theta[0]
    theirs = lambda: _peer_run(peer, np.asarray(first.theta[0]), dt, steps, stages)
    difference = np.abs(np.asarray(ours()) - theirs()).max()
    spans = interleaved({"jaxthermo": ours, "numba": theirs}, repeats)
    return {
        "steps": steps,
        "stages": stages,
        "evaluations": steps * stages,
        "largest_difference_K": float(difference),
        "times_s": spans,
        "ratio": ratio_of(spans["jaxthermo"], spans["numba"]),
    }


def run(folder: Path, height: int = 250, repeats: int = 5) -> dict[str, Any]:
    """Time of both for each number of steps, their ratio and largest difference."""
    # The peer's voxels are all whole.
    scene, name = standard_scene(
        STEEL, jt.FullVolume, height, surface_cells="dominant_axis"
    )
    rows = [_compare(scene, steps, repeats) for steps in _STEPS]
    measured = [
        Measurement(
            f"{name}, {height} high: RKL2, {row['steps']} x {row['stages']} stages",
            "s",
            row["times_s"]["jaxthermo"],
            f"numba, {numba.get_num_threads()} threads",
            row["times_s"]["numba"],
            _BOUND,
            note=f"both agree to {row['largest_difference_K']:.1g} K",
        )
        for row in rows
    ]
    found = {"mesh": name, "height": height, "rows": rows}
    return {**found, "measurements": plain_rows(measured)}
