"""Conduction in the full volume alone, compared with numba, simple steps and a copy.

An ellipsoid with bubbles, without a surface or loads: those are in `full_volume`. The
simple form is the change of the temperatures, computed by itself and added.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numba
import numpy as np

from jaxthermo.network.network import AbstractNetwork
from jaxthermo.network.stencil import Stencil, solid_degree
from jaxthermo.timing import Spans, interleaved

from ..harness.agreement import largest_difference
from ..harness.measurement import MeasuredResult, Measurement, plain_rows
from .loops import kernel_rows, per_item


QUICK = {"shape": (60, 60, 140), "repeats": 2}

# About the thesis' 225 x 225 x 550: a lattice that no cache holds.
_SHAPE = (228, 228, 550)
# Even, since both loops take two steps a turn.
_STEPS = 40
_MAX_DIFFERENCE = 1e-5
"""Largest difference of the states after these steps, which are 0 to 1 at the start."""
_BOUND = 0.75
"""Speed relative to numba that a kernel must have."""


def _body(shape: tuple[int, int, int]) -> np.ndarray:
    # An ellipsoid with bubbles: about as full as a statue in its box.
    axes = [np.linspace(-1, 1, count) for count in shape]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    waves = np.sin(9 * x) * np.sin(9 * y) * np.sin(21 * z)
    square = x**2 + y**2 + z**2
    return (square < 1) & (waves <= 0.9)


@numba.njit(parallel=True, fastmath=True)
def _numba_step(state, out, degree, ratio):
    for i in numba.prange(1, state.shape[0] - 1):
        for j in range(1, state.shape[1] - 1):
            centre = state[i, j]
            above = state[i, j + 1]
            below = state[i, j - 1]
            ahead = state[i + 1, j]
            behind = state[i - 1, j]
            row = degree[i - 1, j - 1]
            target = out[i, j]
            for k in range(1, state.shape[2] - 1):
                total = centre[k - 1] + centre[k + 1] + above[k] + below[k]
                total += ahead[k] + behind[k]
                # A product, not a branch, keeps the loop vectorized.
                mask = np.float32(row[k - 1] > 0)
                spread = total - np.float32(row[k - 1]) * centre[k]
                target[k] = centre[k] + ratio * mask * spread


def _network(solid: np.ndarray) -> Stencil:
    return Stencil(
        degree=jnp.asarray(solid_degree(solid)),
        conductance=jnp.float32(0.1),
        node_capacity=jnp.float32(1.0),
        node_count=int(solid.sum()),
    )


@partial(jax.jit, donate_argnums=1, static_argnames="simple")
def _jax_steps(
    network: Stencil, state: jax.Array, steps: jax.Array, simple: bool = False
):
    dt = jnp.float32(1.0)

    def step(state: jax.Array) -> jax.Array:
        if simple:
            # The step of networks that write none of their own.
            return AbstractNetwork.euler_step(network, state, dt)
        return network.euler_step(state, dt)

    return jax.lax.fori_loop(0, steps // 2, lambda _, s: step(step(s)), state)


def _numba_steps(state: np.ndarray, next_state: np.ndarray, degree: np.ndarray) -> None:
    for _ in range(_STEPS // 2):
        _numba_step(state, next_state, degree, np.float32(0.1))
        _numba_step(next_state, state, degree, np.float32(0.1))


class _Result(MeasuredResult):
    shape: list[int]
    solid_share: float
    step_s: Spans
    lattice_voxels_per_s: dict[str, float]
    largest_difference: float


def run(shape: tuple[int, int, int] = _SHAPE, repeats: int = 5) -> _Result:
    """Time per step of each, and the largest difference of their results."""
    solid = _body(shape)
    network = _network(solid)
    start = np.pad(solid * np.float32(1), 1)
    random = np.random.default_rng(0).random(shape, np.float32)
    start[1:-1, 1:-1, 1:-1] *= random
    degree = np.asarray(network.degree)
    steps = jnp.int32(_STEPS)
    a = start.copy()
    b = start.copy()
    _numba_steps(a, b, degree)
    # The states go round: they were donated, and their buffers are reused.
    states = {
        simple: _jax_steps(network, jnp.asarray(start), steps, simple)
        for simple in (False, True)
    }
    difference = largest_difference(
        f"state after {_STEPS} steps",
        {"numba": a, "ours": states[False], "the same from rates": states[True]},
        tolerance=_MAX_DIFFERENCE,
    )

    def step_ours(simple: bool) -> jax.Array:
        states[simple] = _jax_steps(network, states[simple], steps, simple)
        return states[simple]

    calls = {
        "ours": lambda: step_ours(False),
        "numba": lambda: _numba_steps(a, b, degree),
        "simple": lambda: step_ours(True),
        "copy": lambda: np.copyto(b, a),
    }
    counts = {**dict.fromkeys(calls, _STEPS), "copy": 1}
    spans = per_item(interleaved(calls, repeats), counts)
    cells = int(np.prod(shape))
    return {
        "shape": list(shape),
        "solid_share": float(solid.mean()),
        "step_s": spans,
        "lattice_voxels_per_s": {
            name: cells / float(np.median(step_spans))
            for name, step_spans in spans.items()
        },
        "largest_difference": difference,
        "measurements": plain_rows(_measurements(shape, spans, difference)),
    }


def _measurements(
    shape: tuple[int, int, int], spans: Spans, difference: float
) -> list[Measurement]:
    size = " x ".join(map(str, shape))
    speed = np.prod(shape) / np.median(spans["ours"]) / 1e9
    return kernel_rows(
        name=f"ellipsoid, {size}: explicit step of conduction",
        spans=spans,
        bound=_BOUND,
        notes={
            "ours": f"{speed:.2g} billion lattice voxels a second; results agree to "
            f"{difference:.1g} of 1"
        },
        slower_forms={
            "simple": "the same from rates",
            "copy": "copy of the state, one thread",
        },
    )
