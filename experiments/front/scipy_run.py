"""TR-BDF2 of a full volume with scipy's sparse matrices and conjugate gradients."""

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import LinearOperator, cg

from .linear_body import LinearBody, Run, step_counts


_RELATIVE_RESIDUAL = 1e-4
"""Residual of a stage over its right-hand side, far below the error of a step [-]."""

_GAMMA = 2 - np.sqrt(2.0)
"""Length of the trapezoidal stage over that of the step [-]."""


def scipy_run(body: LinearBody, dt: float) -> Run:
    """TR-BDF2 with steps up to `dt` [s].

    With A the matrix of all links and slopes [W/K] and g = 2 - sqrt(2),

        (C + g dt/2 A) T_g = (C - g dt/2 A) T_0 + g dt q,
        (C + g dt/2 A) T_1 = C (T_g - (1 - g)^2 T_0) / (g (2 - g)) + g dt/2 q,

    by conjugate gradients with the diagonal as preconditioner.
    """
    body = body.with_layout("compact")
    rows = body.rows(body.cells)
    size, one = body.size, np.float32
    links = csr_array((rows.conductance, rows.column, rows.first), shape=(size, size))
    slope, gain = np.zeros(size), np.zeros((len(body.gain), size))
    place = body.position[body.loaded]
    slope[place], gain[:, place] = body.loss, body.gain
    total = links.sum(axis=1) + slope
    capacity = rows.capacity
    operator = csr_array(diags_array(total) - links, dtype=one)
    steps = step_counts(body.intervals, dt)
    reading = body.position[body.read_cell]
    factor, offset = body.read_factor.astype(one), body.read_offset.astype(one)
    initial, heat, held = body.initial(), gain.astype(one), capacity.astype(one)

    def run() -> np.ndarray:
        state, found = initial.copy(), np.empty(offset.shape, one)
        for (start, end, row), count, q in zip(
            body.intervals, steps, heat, strict=True
        ):
            part = one(_GAMMA * (end - start) / count / 2)
            system = _system(
                operator, capacity=held, diagonal=total.astype(one), part=part
            )
            for _ in range(count):
                state = _step(
                    operator, capacity=held, q=q, part=part, system=system, state=state
                )
            if row >= 0:
                found[row] = factor * state[reading] + offset[row]
        return found + one(body.reference)

    # The matrix, that of a stage, and the vectors of conjugate gradients.
    matrix = operator.data.nbytes + operator.indices.nbytes + operator.indptr.nbytes
    return Run(run, sum(steps), 2 * matrix + 12 * initial.nbytes)


def _system(operator, capacity, diagonal, part):
    """The matrix of both stages, and its inverse diagonal."""
    inverse = 1 / (capacity + part * diagonal)
    shape = operator.shape
    matrix = csr_array(diags_array(capacity) + part * operator)
    return matrix, LinearOperator(shape, matvec=lambda r: inverse * r)  # type: ignore


def _step(operator, capacity, q, part, system, state):
    matrix, inverse = system
    solve = lambda right, guess: cg(
        matrix, right, guess, rtol=_RELATIVE_RESIDUAL, M=inverse
    )[0]
    right = capacity * state + part * (2 * q - operator @ state)
    middle = solve(right, state)
    g = np.float32(_GAMMA)
    mixed = (middle - (1 - g) ** 2 * state) / (g * (2 - g))
    # Beyond the middle the temperature goes on as it did up to there.
    return solve(capacity * mixed + part * q, middle + (middle - state) * (1 / g - 1))
