"""Explicit Euler and RKL2 of a full volume in numba, as an engineer would write them.

The whole run is one compiled function: conduction in runs of voxels along z, which are
vectorized, rows of links with the loads for the voxels at the surface, and the surface
temperatures at the saved times. The mix of an RKL2 stage is part of the same pass.
"""

import inspect
from functools import cache
from typing import Any, Literal, NamedTuple

import numba
import numpy as np

from jaxthermo.integrate.explicit import rkl2_coefficients, stage_count

from .linear_body import LinearBody, Run, step_counts


class _Arrays(NamedTuple):
    # Of a body, in single precision, as the loops read them.
    runs: np.ndarray
    node: np.ndarray
    first: np.ndarray
    column: np.ndarray
    # Conductance over capacity [1/s].
    weight: np.ndarray
    # Loads over capacity, by interval [K/s]; and what they fall by per kelvin [1/s].
    gain: np.ndarray
    loss: np.ndarray
    read_node: np.ndarray
    read_factor: np.ndarray
    read_offset: np.ndarray


class _Steps(NamedTuple):
    # Of each interval: length and number of steps, and the row that its end is saved
    # in, or -1.
    dt: np.ndarray
    steps: np.ndarray
    row: np.ndarray
    stages: np.ndarray
    # Coefficients of RKL2 by interval and stage, and w: see `explicit`.
    mu: np.ndarray
    nu: np.ndarray
    a: np.ndarray
    weight: np.ndarray


Threads = Literal["all", "one", "interpreted"]
"""Threads of the compiled loops; or the loops as Python runs them, which is slow."""


def explicit_run(body: LinearBody, threads: Threads = "all") -> Run:
    """Explicit Euler at the stable step."""
    return _bound(body, body.stable_step, threads, rkl2=False)


def rkl2_run(body: LinearBody, dt: float, threads: Threads = "all") -> Run:
    """RKL2 with steps up to `dt` [s], each interval with the fewest stages."""
    return _bound(body, dt, threads, rkl2=True)


def _bound(body: LinearBody, dt: float, threads: Threads, rkl2: bool) -> Run:
    arrays, plan = _arrays(body), _steps(body, dt, rkl2)
    initial, reference = body.initial(), np.float32(body.reference)
    loop = _loops(threads)[rkl2]
    size = len(body.save_times), len(body.read_cell)

    def run() -> np.ndarray:
        found = np.empty(size, np.float32)
        loop(arrays, plan, initial, found)
        return found + reference

    # States of a step of RKL2: its start, change, and three stages.
    states = initial.nbytes * (5 if rkl2 else 2)
    memory = states + sum(each.nbytes for each in arrays)
    return Run(run, int(plan.steps.sum()), memory)


def _arrays(body: LinearBody) -> _Arrays:
    cells, one = body.surface_cells, np.float32
    rows = body.rows(cells)
    capacity = np.repeat(rows.capacity, np.diff(rows.first))
    gain, loss = np.zeros((len(body.gain), len(cells))), np.zeros(len(cells))
    at = np.searchsorted(cells, body.loaded)
    gain[:, at], loss[at] = body.gain, body.loss
    return _Arrays(
        runs=body.runs(),
        node=rows.node.astype(np.int32),
        first=rows.first.astype(np.int32),
        column=rows.column.astype(np.int32),
        weight=(rows.conductance / capacity).astype(one),
        gain=(gain / rows.capacity).astype(one),
        loss=(loss / rows.capacity).astype(one),
        read_node=body.position[body.read_cell],
        read_factor=body.read_factor.astype(one),
        read_offset=body.read_offset.astype(one),
    )


def _steps(body: LinearBody, dt: float, rkl2: bool) -> _Steps:
    steps = np.array(step_counts(body.intervals, dt))
    spans = np.array([end - start for start, end, _ in body.intervals])
    each = spans / steps
    count = np.ones(len(steps), int)
    if rkl2:
        count = np.array([stage_count(length, body.stable_step) for length in each])
    table = np.zeros((3, len(steps), count.max() + 1))
    for i, s in enumerate(count):
        if rkl2:
            named = rkl2_coefficients(int(s))
            table[:, i, : s + 1] = [named[name] for name in ("mu", "nu", "a")]
    weight = 4 / (count**2 + count - 2) if rkl2 else np.ones(len(steps))
    rate = body.conductance / body.capacity
    one = lambda values: np.ascontiguousarray(values, np.float32)
    row = np.array([saved for _, _, saved in body.intervals])
    # In the first column the rate of whole links over the length of an Euler step.
    weighted = one(np.stack([each * weight, each * weight * rate], axis=1))
    mu, nu, a = (one(rows) for rows in table)
    return _Steps(
        dt=one(each),
        steps=steps,
        row=row,
        stages=count,
        mu=mu,
        nu=nu,
        a=a,
        weight=weighted,
    )


@cache
def _loops(threads: Threads) -> tuple[Any, Any]:
    """The loops of explicit Euler and of RKL2."""
    compiled = whole = lambda function: function
    if threads != "interpreted":
        # Unwrapped: with its types checked at run time numba could not read it.
        fast = numba.njit(parallel=threads == "all", fastmath=True)
        compiled = lambda function: fast(inspect.unwrap(function))
        whole = lambda function: numba.njit(inspect.unwrap(function))
    several = numba.prange
    six, third = np.float32(6), np.float32(1 / 3)

    @compiled
    def conduct(runs, last, out, g):
        for r in several(runs.shape[0]):
            here, count, ahead, behind, above, below = runs[r]
            centre, target = last[here - 1 : here + count + 1], out[here : here + count]
            north, south = last[ahead : ahead + count], last[behind : behind + count]
            east, west = last[above : above + count], last[below : below + count]
            for k in range(count):
                near = centre[k] + centre[k + 2] + north[k] + south[k]
                near += east[k] + west[k] - six * centre[k + 1]
                target[k] = centre[k + 1] + g * near

    @compiled
    def at_surface(arrays, gain, last, out, dt):
        node, first, column = arrays.node, arrays.first, arrays.column
        for n in several(node.shape[0]):
            value = last[node[n]]
            rate = gain[n] - arrays.loss[n] * value
            for e in range(first[n], first[n + 1]):
                rate += arrays.weight[e] * (last[column[e]] - value)
            out[node[n]] = value + dt * rate

    @compiled
    def conduct_mixed(runs, last, before, zero, change, out, c):
        g, mu, nu, rest, slope = c
        for r in several(runs.shape[0]):
            here, count, ahead, behind, above, below = runs[r]
            centre, target = last[here - 1 : here + count + 1], out[here : here + count]
            north, south = last[ahead : ahead + count], last[behind : behind + count]
            east, west = last[above : above + count], last[below : below + count]
            # Apart, each loop has few enough arrays to be vectorized.
            for k in range(count):
                near = centre[k] + centre[k + 2] + north[k] + south[k]
                near += east[k] + west[k] - six * centre[k + 1]
                target[k] = mu * (centre[k + 1] + g * near)
            old, start = before[here : here + count], zero[here : here + count]
            moved = change[here : here + count]
            for k in range(count):
                target[k] += nu * old[k] + rest * start[k] - slope * moved[k]

    @compiled
    def mixed_at_surface(arrays, gain, last, before, zero, change, out, dt, c):
        _, mu, nu, rest, slope = c
        node, first, column = arrays.node, arrays.first, arrays.column
        for n in several(node.shape[0]):
            i = node[n]
            value = last[i]
            rate = gain[n] - arrays.loss[n] * value
            for e in range(first[n], first[n + 1]):
                rate += arrays.weight[e] * (last[column[e]] - value)
            mixed = mu * (value + dt * rate) + nu * before[i]
            out[i] = mixed + rest * zero[i] - slope * change[i]

    @compiled
    def third_of(zero, after, change, out):
        for n in several(zero.shape[0]):
            change[n] = after[n] - zero[n]
            out[n] = zero[n] + third * change[n]

    @compiled
    def read(arrays, row, state, found):
        for n in several(arrays.read_node.shape[0]):
            value = arrays.read_factor[n] * state[arrays.read_node[n]]
            found[row, n] = value + arrays.read_offset[row, n]

    @whole
    def euler(arrays, plan, initial, found):
        last, out = initial.copy(), np.zeros_like(initial)
        for i in range(len(plan.dt)):
            dt, g = plan.weight[i]
            for _ in range(plan.steps[i]):
                conduct(arrays.runs, last, out, g)
                at_surface(arrays, arrays.gain[i], last, out, dt)
                last, out = out, last
            if plan.row[i] >= 0:
                read(arrays, plan.row[i], last, found)

    @whole
    def rkl2(arrays, plan, initial, found):
        zero = initial.copy()
        before, last = np.zeros_like(zero), np.zeros_like(zero)
        change, other = np.zeros_like(zero), np.zeros_like(zero)
        for i in range(len(plan.dt)):
            dt, g = plan.weight[i]
            gain = arrays.gain[i]
            for _ in range(plan.steps[i]):
                conduct(arrays.runs, zero, other, g)
                at_surface(arrays, gain, zero, other, dt)
                third_of(zero, other, change, last)
                for j in range(2, plan.stages[i] + 1):
                    mu, nu, a = plan.mu[i, j], plan.nu[i, j], plan.a[i, j]
                    c = (g, mu, nu, np.float32(1) - mu - nu, a * mu)
                    # Before the second stage is the start, which is kept.
                    old = zero if j == 2 else before
                    conduct_mixed(arrays.runs, last, old, zero, change, other, c)
                    mixed_at_surface(
                        arrays, gain, last, old, zero, change, other, dt, c
                    )
                    before, last, other = last, other, before
                zero, last = last, zero
            if plan.row[i] >= 0:
                read(arrays, plan.row[i], zero, found)

    return euler, rkl2
