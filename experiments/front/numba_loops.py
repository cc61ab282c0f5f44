"""Explicit Euler and RKL2 of a full volume in numba, as an engineer would write them.

The whole run is one compiled function: conduction in runs of voxels along z, which are
vectorized, rows of links with the loads for the voxels at the surface, and the surface
temperatures at the saved times. The mix of an RKL2 stage is part of the same pass.
"""

import inspect
from collections.abc import Callable
from functools import cache, partial
from typing import Any, Literal, NamedTuple

import numba
import numpy as np

from jaxthermo.integrate.explicit import rkl2_coefficients, stage_count

from .linear_body import LinearBody, Run, step_counts


class _Arrays(NamedTuple):
    """Arrays of a body in single precision, as the loops read them."""

    runs: np.ndarray
    node: np.ndarray
    first: np.ndarray
    column: np.ndarray
    weight: np.ndarray
    """Conductance over capacity [1/s]."""
    gain: np.ndarray
    """Loads over capacity, by interval [K/s]."""
    loss: np.ndarray
    """Decrease of the loads over capacity per kelvin [1/s]."""
    read_node: np.ndarray
    read_factor: np.ndarray
    read_offset: np.ndarray


class _Steps(NamedTuple):
    """Steps of each interval; the coefficients of RKL2 are those of `explicit`."""

    steps: np.ndarray
    """Number of steps."""
    row: np.ndarray
    """Row of the saved time at the end of the interval, or -1."""
    stages: np.ndarray
    """Number of stages of a step."""
    mu: np.ndarray
    """Coefficient mu by interval and stage."""
    nu: np.ndarray
    """Coefficient nu by interval and stage."""
    a: np.ndarray
    """Coefficient a by interval and stage."""
    weight: np.ndarray
    """Length of a stage [s], and the rate of a whole link over it [-]."""


_Threads = Literal["all", "one", "interpreted"]
"""Threads of the compiled loops, or the loops in plain Python, which is slow."""


def explicit_run(body: LinearBody, threads: _Threads = "all") -> Run:
    """Explicit Euler at the stable step."""
    return _bound(body, dt=body.stable_step, threads=threads, rkl2=False)


def rkl2_run(body: LinearBody, dt: float, threads: _Threads = "all") -> Run:
    """RKL2 with steps up to `dt` [s], each interval with the fewest stages."""
    return _bound(body, dt=dt, threads=threads, rkl2=True)


def _bound(body: LinearBody, dt: float, threads: _Threads, rkl2: bool) -> Run:
    arrays = _arrays(body)
    plan = _steps(body, dt=dt, rkl2=rkl2)
    initial = body.initial()
    reference = np.float32(body.reference)
    loop = _loops(threads)[rkl2]
    size = (len(body.save_times), len(body.read_cell))

    def run() -> np.ndarray:
        surface = np.empty(size, np.float32)
        loop(arrays, plan, initial, surface)
        return surface + reference

    # States of a step of RKL2: its start, change, and three stages.
    states = initial.nbytes * (5 if rkl2 else 2)
    memory = states + sum(array.nbytes for array in arrays)
    return Run(run, steps=int(plan.steps.sum()), memory_bytes=memory)


def _arrays(body: LinearBody) -> _Arrays:
    cells = body.surface_cells
    single = np.float32
    rows = body.rows(cells)
    capacity = np.repeat(rows.capacity, np.diff(rows.first))
    gain = np.zeros((len(body.gain), len(cells)))
    loss = np.zeros(len(cells))
    at = np.searchsorted(cells, body.loaded)
    gain[:, at] = body.gain
    loss[at] = body.loss
    return _Arrays(
        runs=body.runs(),
        node=rows.node.astype(np.int32),
        first=rows.first.astype(np.int32),
        column=rows.column.astype(np.int32),
        weight=(rows.conductance / capacity).astype(single),
        gain=(gain / rows.capacity).astype(single),
        loss=(loss / rows.capacity).astype(single),
        read_node=body.position[body.read_cell],
        read_factor=body.read_factor.astype(single),
        read_offset=body.read_offset.astype(single),
    )


def _steps(body: LinearBody, dt: float, rkl2: bool) -> _Steps:
    steps = np.array(step_counts(body.intervals, dt))
    spans = np.array([end - start for start, end, _ in body.intervals])
    lengths = spans / steps
    count = np.ones(len(steps), int)
    if rkl2:
        count = np.array([stage_count(length, body.stable_step) for length in lengths])
    table = np.zeros((3, len(steps), count.max() + 1))
    for i, s in enumerate(count):
        if rkl2:
            named = rkl2_coefficients(int(s))
            table[:, i, : s + 1] = [named[name] for name in ("mu", "nu", "a")]
    weight = 4 / (count**2 + count - 2) if rkl2 else np.ones(len(steps))
    rate = body.conductance / body.capacity

    def single_precision(values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(values, np.float32)

    row = np.array([saved for _, _, saved in body.intervals])
    # In the first column the rate of whole links over the length of an Euler step.
    weighted = single_precision(
        np.stack([lengths * weight, lengths * weight * rate], axis=1)
    )
    mu, nu, a = (single_precision(rows) for rows in table)
    return _Steps(
        steps=steps,
        row=row,
        stages=count,
        mu=mu,
        nu=nu,
        a=a,
        weight=weighted,
    )


@cache
def _loops(threads: _Threads) -> tuple[Any, Any]:
    """The loops of explicit Euler and of RKL2."""

    def compiled(function: Callable[..., None], **options: Any) -> Callable[..., None]:
        if threads == "interpreted":
            return function
        # Unwrapped: with its types checked at run time numba could not read it.
        return numba.njit(**options)(inspect.unwrap(function))

    fast = partial(compiled, parallel=threads == "all", fastmath=True)
    several = numba.prange
    six = np.float32(6)
    third = np.float32(1 / 3)

    @fast
    def conduct(runs, last, out, g):
        for r in several(runs.shape[0]):
            first, count, ahead, behind, above, below = runs[r]
            centre = last[first - 1 : first + count + 1]
            target = out[first : first + count]
            north = last[ahead : ahead + count]
            south = last[behind : behind + count]
            east = last[above : above + count]
            west = last[below : below + count]
            for k in range(count):
                near = centre[k] + centre[k + 2] + north[k] + south[k]
                near += east[k] + west[k] - six * centre[k + 1]
                target[k] = centre[k + 1] + g * near

    @fast
    def at_surface(arrays, gain, last, out, dt):
        node = arrays.node
        first = arrays.first
        column = arrays.column
        for n in several(node.shape[0]):
            value = last[node[n]]
            rate = gain[n] - arrays.loss[n] * value
            for e in range(first[n], first[n + 1]):
                rate += arrays.weight[e] * (last[column[e]] - value)
            out[node[n]] = value + dt * rate

    @fast
    def conduct_mixed(runs, last, previous, zero, change, out, c):
        g, mu, nu, remainder, slope = c
        for r in several(runs.shape[0]):
            first, count, ahead, behind, above, below = runs[r]
            centre = last[first - 1 : first + count + 1]
            target = out[first : first + count]
            north = last[ahead : ahead + count]
            south = last[behind : behind + count]
            east = last[above : above + count]
            west = last[below : below + count]
            # Apart, each loop has few enough arrays to be vectorized.
            for k in range(count):
                near = centre[k] + centre[k + 2] + north[k] + south[k]
                near += east[k] + west[k] - six * centre[k + 1]
                target[k] = mu * (centre[k + 1] + g * near)
            old = previous[first : first + count]
            start = zero[first : first + count]
            moved = change[first : first + count]
            for k in range(count):
                target[k] += nu * old[k] + remainder * start[k] - slope * moved[k]

    @fast
    def mixed_at_surface(arrays, gain, last, previous, zero, change, out, dt, c):
        _, mu, nu, remainder, slope = c
        node = arrays.node
        first = arrays.first
        column = arrays.column
        for n in several(node.shape[0]):
            i = node[n]
            value = last[i]
            rate = gain[n] - arrays.loss[n] * value
            for e in range(first[n], first[n + 1]):
                rate += arrays.weight[e] * (last[column[e]] - value)
            mixed = mu * (value + dt * rate) + nu * previous[i]
            out[i] = mixed + remainder * zero[i] - slope * change[i]

    @fast
    def third_of(zero, following, change, out):
        for n in several(zero.shape[0]):
            change[n] = following[n] - zero[n]
            out[n] = zero[n] + third * change[n]

    @fast
    def read(arrays, row, state, surface):
        for n in several(arrays.read_node.shape[0]):
            value = arrays.read_factor[n] * state[arrays.read_node[n]]
            surface[row, n] = value + arrays.read_offset[row, n]

    @compiled
    def euler(arrays, plan, initial, surface):
        last = initial.copy()
        out = np.zeros_like(initial)
        for i in range(len(plan.steps)):
            dt, g = plan.weight[i]
            for _ in range(plan.steps[i]):
                conduct(arrays.runs, last, out, g)
                at_surface(arrays, arrays.gain[i], last, out, dt)
                last, out = out, last
            if plan.row[i] >= 0:
                read(arrays, plan.row[i], last, surface)

    @compiled
    def rkl2(arrays, plan, initial, surface):
        zero = initial.copy()
        previous = np.zeros_like(zero)
        last = np.zeros_like(zero)
        change = np.zeros_like(zero)
        following = np.zeros_like(zero)
        for i in range(len(plan.steps)):
            dt, g = plan.weight[i]
            gain = arrays.gain[i]
            for _ in range(plan.steps[i]):
                conduct(arrays.runs, zero, following, g)
                at_surface(arrays, gain, zero, following, dt)
                third_of(zero, following, change, last)
                for j in range(2, plan.stages[i] + 1):
                    mu = plan.mu[i, j]
                    nu = plan.nu[i, j]
                    a = plan.a[i, j]
                    c = (g, mu, nu, np.float32(1) - mu - nu, a * mu)
                    # The second stage follows the start, which must stay unchanged.
                    old = zero if j == 2 else previous
                    conduct_mixed(arrays.runs, last, old, zero, change, following, c)
                    mixed_at_surface(
                        arrays, gain, last, old, zero, change, following, dt, c
                    )
                    previous, last, following = last, following, previous
                zero, last = last, zero
            if plan.row[i] >= 0:
                read(arrays, plan.row[i], zero, surface)

    return euler, rkl2
