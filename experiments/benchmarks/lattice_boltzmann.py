"""A step of the lattice Boltzmann flow compared with numba, the textbook and a copy.

The thesis' channel of 800 x 300 cells with a cylinder, in float32. Ours is a run with
its walls, inlet, outlet, body, forces and means, with loops of XLA and with kernels of
numba. Numba's own loop has the collision alone,
fused with the streaming over all rows in threads, as one would write it by hand; the
textbook's step is that of a periodic box. All of them must give the same populations:
numba's and the textbook's in a periodic box, ours and numba's away from walls and body,
and our two in the whole channel.
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
    advance,
    advance_in_place,
    flow_program,
    initial_state,
    totals,
)
from jaxthermo.flow.lattice import MAGIC, flow_rates, textbook_step
from jaxthermo.timing import Spans, interleaved

from ..harness.agreement import largest_difference
from ..harness.measurement import MeasuredResult, Measurement, plain_rows
from .loops import kernel_rows, per_item


QUICK = {"shape": (60, 160), "repeats": 2}

_SHAPE = (300, 800)
_SPEED = 0.05
_VISCOSITY = 0.02
_STRIDE = 20
_SAMPLES = 4
# Speed relative to numba, and lattice updates per second, that a run must have.
_BOUND = 0.35
_UPDATES = 2e7
_MAX_DIFFERENCE = 1e-6
"""Largest difference of populations, which are up to 0.05."""


def _rows(f, out, symmetric, antisymmetric):
    half = np.float32(0.5)
    three = np.float32(3.0)
    third = np.float32(1.5)
    nine = np.float32(4.5)
    w0 = np.float32(4 / 9)
    w1 = np.float32(1 / 9)
    w5 = np.float32(1 / 36)
    for y in numba.prange(1, f.shape[1] - 1):
        r0 = f[0, y]
        r1 = f[1, y]
        r2 = f[2, y - 1]
        r3 = f[3, y]
        r4 = f[4, y + 1]
        r5 = f[5, y - 1]
        r6 = f[6, y - 1]
        r7 = f[7, y + 1]
        r8 = f[8, y + 1]
        t0 = out[0, y]
        t1 = out[1, y]
        t2 = out[2, y]
        t3 = out[3, y]
        t4 = out[4, y]
        t5 = out[5, y]
        t6 = out[6, y]
        t7 = out[7, y]
        t8 = out[8, y]
        for x in range(1, f.shape[2] - 1):
            f0 = r0[x]
            f1 = r1[x - 1]
            f2 = r2[x]
            f3 = r3[x + 1]
            f4 = r4[x]
            f5 = r5[x - 1]
            f6 = r6[x + 1]
            f7 = r7[x + 1]
            f8 = r8[x - 1]
            u = (f1 - f3) + ((f5 + f8) - (f6 + f7))
            v = (f2 - f4) + ((f5 + f6) - (f7 + f8))
            base = f0 + (f1 + f2) + (f3 + f4) + ((f5 + f8) + (f6 + f7))
            base -= third * (u * u + v * v)
            t0[x] = f0 + symmetric * (w0 * base - f0)
            even = symmetric * (w1 * (base + nine * u * u) - half * (f1 + f3))
            odd = antisymmetric * (w1 * three * u - half * (f1 - f3))
            t1[x] = f1 + (even + odd)
            t3[x] = f3 + (even - odd)
            even = symmetric * (w1 * (base + nine * v * v) - half * (f2 + f4))
            odd = antisymmetric * (w1 * three * v - half * (f2 - f4))
            t2[x] = f2 + (even + odd)
            t4[x] = f4 + (even - odd)
            c = u + v
            even = symmetric * (w5 * (base + nine * c * c) - half * (f5 + f7))
            odd = antisymmetric * (w5 * three * c - half * (f5 - f7))
            t5[x] = f5 + (even + odd)
            t7[x] = f7 + (even - odd)
            c = v - u
            even = symmetric * (w5 * (base + nine * c * c) - half * (f6 + f8))
            odd = antisymmetric * (w5 * three * c - half * (f6 - f8))
            t6[x] = f6 + (even + odd)
            t8[x] = f8 + (even - odd)


# Unwrapped: the type check of a test is not for numba.
_numba_step = numba.njit(parallel=True, fastmath=True)(inspect.unwrap(_rows))


_RATES = flow_rates(_VISCOSITY, MAGIC)
_EVEN_RATE = np.float32(_RATES.symmetric)
_ODD_RATE = np.float32(_RATES.antisymmetric)


def _numba_steps(f: np.ndarray, out: np.ndarray, steps: int) -> None:
    for _ in range(steps // 2):
        _numba_step(f, out, _EVEN_RATE, _ODD_RATE)
        _numba_step(out, f, _EVEN_RATE, _ODD_RATE)


@jax.jit
def _textbook_steps(f: jax.Array) -> jax.Array:
    return jax.lax.fori_loop(0, _STRIDE, lambda _, f: textbook_step(f, _RATES), f)


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


def _differences(shape: tuple[int, int]) -> float:
    """Largest difference of the populations of all forms."""
    return max(_from_textbook(shape), _from_ours(shape))


def _from_textbook(shape: tuple[int, int]) -> float:
    """Largest difference of numba's and the textbook's step in a periodic box."""
    random = np.random.default_rng(0)
    start = random.uniform(-1e-2, 1e-2, (9, *shape)).astype(np.float32)
    f = np.pad(start, ((0, 0), (1, 1), (1, 1)), mode="wrap")
    out = f.copy()
    _numba_step(f, out, _EVEN_RATE, _ODD_RATE)
    inside = (slice(None), slice(1, -1), slice(1, -1))
    plain = np.asarray(textbook_step(jnp.asarray(f[inside]), _RATES))
    return largest_difference(
        "populations after a step",
        {"numba": out[inside], "textbook": plain},
        tolerance=_MAX_DIFFERENCE,
    )


def _from_ours(shape: tuple[int, int]) -> float:
    """Largest difference of our two forms, and of ours and numba's away from walls."""
    height, length = shape
    y, x = np.meshgrid(*map(np.arange, shape), indexing="ij")
    wave = np.sin(0.3 * x) * np.cos(0.2 * y)
    velocity = (_SPEED * (1 + wave), _SPEED * wave)
    flows = {}
    for form, kernels in (("XLA", None), ("kernels", "numba")):
        program = flow_program(_channel(shape), "float32", kernels)
        start = initial_state(program, velocity)
        if form == "XLA":
            f = np.stack(start.flow)
        weight = jnp.ones((), jnp.float32)
        moved = advance(program, start, None, weight, samples=1, stride=2).state.flow
        flows[form] = np.stack(moved)[:, 1:-1, 1:-1]
    between = largest_difference(
        "populations of the channel", flows, tolerance=_MAX_DIFFERENCE
    )
    _numba_steps(f, f.copy(), 2)
    # Behind the body; two steps carry nothing over more than two cells.
    away = (slice(None), slice(4, height - 4), slice(2 * length // 5, length - 4))
    return max(
        between,
        largest_difference(
            "populations away from walls",
            {"numba": f[:, 1:-1, 1:-1][away], "ours": flows["XLA"][away]},
            tolerance=_MAX_DIFFERENCE,
        ),
    )


def _run_of(shape: tuple[int, int], kernels: str | None) -> Callable[[], Any]:
    """Some steps of a run with its forces and means, from where the last ones ended."""
    program = flow_program(_channel(shape), "float32", kernels)
    state = initial_state(program)
    sums = jax.tree.map(jnp.zeros_like, totals(program, state))

    def steps() -> Any:
        # The arrays are donated: each call starts from those of the call before.
        nonlocal state, sums
        weight = jnp.ones((), jnp.float32)
        state, sums, _ = advance_in_place(
            program, state, sums, weight, samples=_SAMPLES, stride=_STRIDE
        )
        return state

    return steps


class _Result(MeasuredResult):
    shape: list[int]
    step_s: Spans
    updates_per_s: dict[str, float]
    largest_difference: float


def run(shape: tuple[int, int] = _SHAPE, repeats: int = 7) -> _Result:
    """Time per step of each, and the lattice updates per second."""
    difference = _differences(shape)
    f = np.zeros((9, shape[0] + 2, shape[1] + 2), np.float32)
    out = f.copy()
    plain = jnp.zeros((9, *shape), jnp.float32)
    steps = _STRIDE * _SAMPLES
    calls = {
        "ours": _run_of(shape, None),
        "kernels": _run_of(shape, "numba"),
        "numba": lambda: _numba_steps(f, out, steps),
        "textbook": lambda: _textbook_steps(plain),
        "copy": lambda: np.copyto(out, f),
    }
    counts = {**dict.fromkeys(calls, steps), "textbook": _STRIDE, "copy": 1}
    spans = per_item(interleaved(calls, repeats), counts)
    cells = shape[0] * shape[1]
    return {
        "shape": list(shape),
        "step_s": spans,
        "updates_per_s": {n: cells / float(np.median(s)) for n, s in spans.items()},
        "largest_difference": difference,
        "measurements": plain_rows(_measurements(shape, spans)),
    }


def _measurements(shape: tuple[int, int], spans: Spans) -> list[Measurement]:
    name = f"flow, {shape[1]} x {shape[0]} cells: step"
    cells = shape[0] * shape[1]
    notes = {}
    for form in ("ours", "kernels"):
        speed = 1e-6 * cells / float(np.median(spans[form]))
        notes[form] = f"{speed:.3g} million lattice updates a second"
    slower_forms = {
        "textbook": "the textbook's step",
        "copy": "copy of the populations, one thread",
    }
    rows = kernel_rows(
        name=name, spans=spans, bound=_BOUND, notes=notes, slower_forms=slower_forms
    )
    # The required rate, which has no peer, stands below the two loops.
    largest_time = cells / _UPDATES
    ours = Measurement(name, "s", spans["ours"], bound=largest_time, note=notes["ours"])
    rows.insert(len(notes), ours)
    return rows
