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
    size = body.size
    single = np.float32
    links = csr_array((rows.conductance, rows.column, rows.first), shape=(size, size))
    slope = np.zeros(size)
    gain = np.zeros((len(body.gain), size))
    loaded = body.position[body.loaded]
    slope[loaded] = body.loss
    gain[:, loaded] = body.gain
    total = links.sum(axis=1) + slope
    capacity = rows.capacity.astype(single)
    diagonal = total.astype(single)
    operator = csr_array(diags_array(total) - links, dtype=single)
    steps = step_counts(body.intervals, dt)
    reading = body.position[body.read_cell]
    factor = body.read_factor.astype(single)
    offset = body.read_offset.astype(single)
    initial = body.initial()
    heat = gain.astype(single)

    def run() -> np.ndarray:
        state = initial.copy()
        surface = np.empty(offset.shape, single)
        for (start, end, row), count, q in zip(
            body.intervals, steps, heat, strict=True
        ):
            stage_length = single(_GAMMA * (end - start) / count / 2)
            system = _system(
                operator,
                capacity=capacity,
                diagonal=diagonal,
                stage_length=stage_length,
            )
            for _ in range(count):
                state = _step(
                    operator,
                    capacity=capacity,
                    q=q,
                    stage_length=stage_length,
                    system=system,
                    state=state,
                )
            if row >= 0:
                surface[row] = factor * state[reading] + offset[row]
        return surface + single(body.reference)

    # The matrix, that of a stage, and the vectors of conjugate gradients.
    matrix = operator.data.nbytes + operator.indices.nbytes + operator.indptr.nbytes
    memory = 2 * matrix + 12 * initial.nbytes
    return Run(run, steps=sum(steps), memory_bytes=memory)


def _system(operator, capacity, diagonal, stage_length):
    """The matrix of both stages, and its inverse diagonal."""
    inverse = 1 / (capacity + stage_length * diagonal)
    shape = operator.shape
    matrix = csr_array(diags_array(capacity) + stage_length * operator)
    return matrix, LinearOperator(shape, matvec=lambda r: inverse * r)  # type: ignore


def _step(operator, capacity, q, stage_length, system, state):
    matrix, inverse = system

    def solve(right: np.ndarray, guess: np.ndarray) -> np.ndarray:
        return cg(matrix, right, guess, rtol=_RELATIVE_RESIDUAL, M=inverse)[0]

    right = capacity * state + stage_length * (2 * q - operator @ state)
    middle = solve(right, state)
    g = np.float32(_GAMMA)
    mixed = (middle - (1 - g) ** 2 * state) / (g * (2 - g))
    # The guess continues the change up to the middle.
    return solve(
        capacity * mixed + stage_length * q, middle + (middle - state) * (1 / g - 1)
    )
