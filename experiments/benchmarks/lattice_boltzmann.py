"""A step of the lattice Boltzmann flow beside numba, its textbook form and a copy.

The thesis' channel of 800 x 300 cells with a cylinder, in float32. Ours is a run with
its walls, inlet, outlet, body, forces and means, with loops of XLA and with kernels of
numba. Numba's own loop has the collision alone,
fused with the streaming over all rows in threads, as one would write it by hand; the
textbook's step is that of a periodic box.
"""

import inspect
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numba
import numpy as np

from jaxthermo.flow.body import RoundBody
from jaxthermo.flow.channel import Channel
from jaxthermo.flow.flow import (
    advance_in_place,
    flow_program,
    initial_state,
    totals,
)
from jaxthermo.flow.lattice import MAGIC, flow_rates, textbook_step

from ..harness.measurement import Measurement, plain_rows
from ..harness.timing import Spans, interleaved
from .loops import NUMBA


QUICK = {"shape": (60, 160), "repeats": 2}

_SHAPE = (300, 800)
_SPEED, _VISCOSITY = 0.05, 0.02
_STRIDE, _SAMPLES = 20, 4
# Speed relative to numba, and lattice updates per second, that a run must have.
_BOUND, _UPDATES = 0.35, 2e7


def _rows(f, out, symmetric, antisymmetric):
    half, three = np.float32(0.5), np.float32(3.0)
    third, nine = np.float32(1.5), np.float32(4.5)
    w0, w1, w5 = np.float32(4 / 9), np.float32(1 / 9), np.float32(1 / 36)
    for y in numba.prange(1, f.shape[1] - 1):
        r0, r1, r2, r3, r4 = f[0, y], f[1, y], f[2, y - 1], f[3, y], f[4, y + 1]
        r5, r6, r7, r8 = f[5, y - 1], f[6, y - 1], f[7, y + 1], f[8, y + 1]
        t0, t1, t2, t3, t4 = out[0, y], out[1, y], out[2, y], out[3, y], out[4, y]
        t5, t6, t7, t8 = out[5, y], out[6, y], out[7, y], out[8, y]
        for x in range(1, f.shape[2] - 1):
            f0, f1, f2, f3, f4 = r0[x], r1[x - 1], r2[x], r3[x + 1], r4[x]
            f5, f6, f7, f8 = r5[x - 1], r6[x + 1], r7[x + 1], r8[x - 1]
            u = (f1 - f3) + ((f5 + f8) - (f6 + f7))
            v = (f2 - f4) + ((f5 + f6) - (f7 + f8))
            base = f0 + (f1 + f2) + (f3 + f4) + ((f5 + f8) + (f6 + f7))
            base -= third * (u * u + v * v)
            t0[x] = f0 + symmetric * (w0 * base - f0)
            even = symmetric * (w1 * (base + nine * u * u) - half * (f1 + f3))
            odd = antisymmetric * (w1 * three * u - half * (f1 - f3))
            t1[x], t3[x] = f1 + (even + odd), f3 + (even - odd)
            even = symmetric * (w1 * (base + nine * v * v) - half * (f2 + f4))
            odd = antisymmetric * (w1 * three * v - half * (f2 - f4))
            t2[x], t4[x] = f2 + (even + odd), f4 + (even - odd)
            c = u + v
            even = symmetric * (w5 * (base + nine * c * c) - half * (f5 + f7))
            odd = antisymmetric * (w5 * three * c - half * (f5 - f7))
            t5[x], t7[x] = f5 + (even + odd), f7 + (even - odd)
            c = v - u
            even = symmetric * (w5 * (base + nine * c * c) - half * (f6 + f8))
            odd = antisymmetric * (w5 * three * c - half * (f6 - f8))
            t6[x], t8[x] = f6 + (even + odd), f8 + (even - odd)


# Unwrapped: the type check of a test is not for numba.
_numba_step = numba.njit(parallel=True, fastmath=True)(inspect.unwrap(_rows))


def _numba_steps(f: np.ndarray, out: np.ndarray, steps: int) -> None:
    rates = flow_rates(_VISCOSITY, MAGIC)
    both = np.float32(rates.symmetric), np.float32(rates.antisymmetric)
    for _ in range(steps // 2):
        _numba_step(f, out, *both)
        _numba_step(out, f, *both)


@jax.jit
def _textbook_steps(f: jax.Array) -> jax.Array:
    rates = flow_rates(_VISCOSITY, MAGIC)
    step = lambda _, f: textbook_step(f, rates)
    return jax.lax.fori_loop(0, _STRIDE, step, f)


def _channel(shape: tuple[int, int]) -> Channel:
    height, length = shape
    body = RoundBody((length / 5, height / 2), height * 2 / 15)
    return Channel(
        shape=shape,
        speed=_SPEED,
        viscosity=_VISCOSITY,
        body=body,
        inlet="poiseuille",
        walls="no_slip",
    )


def _difference(shape: tuple[int, int]) -> float:
    """Largest difference of a step in the inside of numba's and the textbook's loop."""
    random = np.random.default_rng(0).uniform(-1e-2, 1e-2, (9, *shape))
    f = np.pad(random.astype(np.float32), ((0, 0), (1, 1), (1, 1)), mode="wrap")
    out = f.copy()
    rates = flow_rates(_VISCOSITY, MAGIC)
    both = np.float32(rates.symmetric), np.float32(rates.antisymmetric)
    _numba_step(f, out, *both)
    plain = np.asarray(textbook_step(jnp.asarray(f[:, 1:-1, 1:-1]), rates))
    return float(np.abs(plain - out[:, 1:-1, 1:-1]).max())


def _run_of(shape: tuple[int, int], kernels: str | None) -> Callable[[], Any]:
    """Some steps of a run with its forces and means, from where the last ones ended."""
    program = flow_program(_channel(shape), "float32", kernels)
    state = initial_state(program)
    now = state, jax.tree.map(jnp.zeros_like, totals(program, state))

    def steps() -> Any:
        nonlocal now
        # The arrays go round: they are used up.
        weight = jnp.ones((), jnp.float32)
        size = {"samples": _SAMPLES, "stride": _STRIDE}
        *ended, _ = advance_in_place(program, *now, weight, **size)
        now = ended[0], ended[1]
        return ended[0]

    return steps


def run(shape: tuple[int, int] = _SHAPE, repeats: int = 7) -> dict[str, Any]:
    """Time per step of each, and the lattice updates per second."""
    f = np.zeros((9, shape[0] + 2, shape[1] + 2), np.float32)
    out, plain = f.copy(), jnp.zeros((9, *shape), jnp.float32)
    steps = _STRIDE * _SAMPLES
    calls = {
        "ours": _run_of(shape, None),
        "kernels": _run_of(shape, "numba"),
        "numba": lambda: _numba_steps(f, out, steps),
        "textbook": lambda: _textbook_steps(plain),
        "copy": lambda: np.copyto(out, f),
    }
    spans = interleaved(calls, repeats)
    counts = {"textbook": _STRIDE, "copy": 1}
    spans = {n: [s / counts.get(n, steps) for s in each] for n, each in spans.items()}
    cells = shape[0] * shape[1]
    return {
        "shape": list(shape),
        "step_s": spans,
        "updates_per_s": {n: cells / float(np.median(s)) for n, s in spans.items()},
        "largest_difference": _difference(shape),
        "measurements": plain_rows(_measurements(shape, spans)),
    }


def _measurements(shape: tuple[int, int], spans: Spans) -> list[Measurement]:
    name = f"flow, {shape[1]} x {shape[0]} cells: step"
    ours, cells = spans["ours"], shape[0] * shape[1]
    kernels, peer = spans["kernels"], spans["numba"]
    note, within = (
        f"{cells / float(np.median(each)) / 1e6:.3g} million lattice updates a second"
        for each in (ours, kernels)
    )
    copy = "copy of the populations, one thread"
    own = f"{name}, kernels of numba"
    return [
        Measurement(
            name=name,
            unit="s",
            ours=ours,
            peer_name=NUMBA,
            peer=peer,
            bound=_BOUND,
            note=note,
        ),
        Measurement(
            name=own,
            unit="s",
            ours=kernels,
            peer_name=NUMBA,
            peer=peer,
            bound=_BOUND,
            note=within,
        ),
        Measurement(name, "s", ours, bound=cells / _UPDATES, note=note),
        Measurement(
            name=name,
            unit="s",
            ours=ours,
            peer_name="the textbook's step",
            peer=spans["textbook"],
        ),
        Measurement(
            name=name,
            unit="s",
            ours=ours,
            peer_name=copy,
            peer=spans["copy"],
            overhead=True,
        ),
    ]
