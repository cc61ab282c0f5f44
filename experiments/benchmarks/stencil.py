"""One step of the full volume, beside a numba stencil and a memory copy, in one run."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numba
import numpy as np

from jaxthermo.network.stencil import UniformStencil, solid_degree
from jaxthermo.timing import measure

from ..harness.present import show, table_of


# About the thesis' 225 x 225 x 550: a lattice that no cache holds.
_SHAPE = (228, 228, 550)
# Even, since both loops take two steps a turn.
_STEPS = 40


def _body(shape: tuple[int, int, int]) -> np.ndarray:
    # An ellipsoid with bubbles: about as full as a statue in its box.
    x, y, z = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    bubbles = np.sin(9 * x) * np.sin(9 * y) * np.sin(21 * z) > 0.9
    return (x**2 + y**2 + z**2 < 1) & ~bubbles


@numba.njit(parallel=True, fastmath=True)
def _numba_step(state, out, degree, ratio):
    for i in numba.prange(1, state.shape[0] - 1):
        for j in range(1, state.shape[1] - 1):
            here, above, below = state[i, j], state[i, j + 1], state[i, j - 1]
            ahead, behind = state[i + 1, j], state[i - 1, j]
            row, target = degree[i - 1, j - 1], out[i, j]
            for k in range(1, state.shape[2] - 1):
                total = here[k - 1] + here[k + 1] + above[k] + below[k]
                total += ahead[k] + behind[k]
                # A product, not a branch, keeps the loop vectorized.
                mask = np.float32(row[k - 1] > 0)
                spread = total - np.float32(row[k - 1]) * here[k]
                target[k] = here[k] + ratio * mask * spread


def _network(solid: np.ndarray) -> UniformStencil:
    return UniformStencil(
        degree=jnp.asarray(solid_degree(solid)),
        conductance=jnp.float32(0.1),
        node_capacity=jnp.float32(1.0),
        node_count=int(solid.sum()),
    )


@partial(jax.jit, donate_argnums=1)
def _jax_steps(network: UniformStencil, state: jax.Array, steps: jax.Array):
    one = lambda state: network.euler_step(state, jnp.float32(1.0))
    return jax.lax.fori_loop(0, steps // 2, lambda _, s: one(one(s)), state)


def _numba_steps(state: np.ndarray, other: np.ndarray, degree: np.ndarray) -> None:
    for _ in range(_STEPS // 2):
        _numba_step(state, other, degree, np.float32(0.1))
        _numba_step(other, state, degree, np.float32(0.1))


def run(shape: tuple[int, int, int] = _SHAPE, repeats: int = 5) -> dict[str, Any]:
    """Time per step of each, and the largest difference of their results."""
    solid = _body(shape)
    network = _network(solid)
    start = np.pad(solid * np.float32(1), 1)
    start[1:-1, 1:-1, 1:-1] *= np.random.default_rng(0).random(shape, np.float32)
    degree, steps = np.asarray(network.degree), jnp.int32(_STEPS)
    a, b = start.copy(), start.copy()
    _numba_steps(a, b, degree)
    state = _jax_steps(network, jnp.asarray(start), steps)
    difference = np.abs(np.asarray(state) - a).max()

    # The state goes round: it was donated, and its buffer is reused.
    def step_ours():
        nonlocal state
        state = _jax_steps(network, state, steps)
        return state

    ours = measure(step_ours, repeats)
    peer = measure(lambda: _numba_steps(a, b, degree), repeats)
    copy = measure(lambda: np.copyto(b, a), repeats)
    rows = {"jaxthermo": ours.per(_STEPS), "numba": peer.per(_STEPS)}
    rows["memory copy"] = copy
    cells = int(np.prod(shape))
    columns = [
        ("", "{name}"),
        ("time (fastest-slowest)", lambda row: row["time"].text()),
        ("G lattice voxels/s", lambda row: f"{cells / row['time'].median / 1e9:.2f}"),
        ("of a copy", lambda row: f"{row['time'].median / copy.median:.1f} x"),
    ]
    title = f"One explicit step of {' x '.join(map(str, shape))} float32, this host"
    lines = [{"name": name, "time": time} for name, time in rows.items()]
    show(table_of(lines, columns, title))
    return {
        "shape": list(shape),
        "solid_share": float(solid.mean()),
        "step_s": {name: row._asdict() for name, row in rows.items()},
        "lattice_voxels_per_s": {n: cells / row.median for n, row in rows.items()},
        "largest_difference": float(difference),
    }
