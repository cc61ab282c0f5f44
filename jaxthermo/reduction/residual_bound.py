"""Bound of the error of a reduced model from its residual.

The reduced state V z leaves the residual r = C V dz/dt + K V z - B u, and the
error e = x - V z obeys C de/dt = -K e - r. With the time T of the run and the dual norm
|r|_*^2 = r^T (K + C / T)^-1 r,

    |e(t)|_C^2 <= exp(t / T) (|e(0)|_C^2 + integral of |r|_*^2 from 0 to t),

from d|e|_C^2 / dt = -2 |e|_K^2 - 2 e^T r, where the last term is at most
|r|_*^2 + |e|_K^2 + |e|_C^2 / T. Divided by the whole capacity, its root bounds the
root mean square error over the volume.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .basis import Projection
from .linear_system import LinearSystem
from .modal_run import Schedule, step_weights


_POINTS = 24
"""Times within a step at which the residual is evaluated."""
_SMALL = 1e-5
"""Relative size of a part of the residual that is bounded without a solve [-]."""
_SHARE = 1e-3
"""Fraction of the bound that this part may take [-]."""


def error_bound(
    system: LinearSystem,
    projection: Projection,
    plan: Schedule,
    amplitudes: Float[np.ndarray, "q k"],
) -> Float[np.ndarray, " i"]:
    """Bound of the root mean square error over the volume after each step [K]."""
    trajectory = _trajectory(projection, plan, amplitudes)
    times = trajectory.times
    span = float(plan.step.sum())
    residuals = np.concatenate([trajectory.states, -trajectory.loads], axis=1)
    gram = _dual_gram(system, projection=projection, residuals=residuals, span=span)
    squares = np.maximum(np.einsum("pi,ij,pj->p", residuals, gram, residuals), 0)
    dt = np.diff(times)
    integral = np.concatenate([[0], np.cumsum(dt * (squares[1:] + squares[:-1]) / 2)])
    basis = projection.basis.vectors
    missed = system.start - basis @ projection.start
    begin = missed @ (system.capacity * missed)
    bound = np.exp(times / span) * (begin + integral)
    ends = np.arange(1, len(plan.step) + 1) * (_POINTS + 1) - 1
    return np.sqrt(bound[ends] / system.capacity.sum())


class _Trajectory(NamedTuple):
    """A run at times within its steps, closer together after the start of each."""

    states: Float[np.ndarray, "p m"]
    loads: Float[np.ndarray, "p k"]
    times: Float[np.ndarray, " p"]


def _trajectory(
    projection: Projection, plan: Schedule, amplitudes: Float[np.ndarray, "q k"]
) -> _Trajectory:
    u0, u1 = plan.loads(np, amplitudes)
    fractions = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, _POINTS)])
    states = []
    loads = []
    times = []
    z = projection.start
    begin = 0.0
    for step, first, last in zip(plan.step, u0, u1, strict=True):
        elapsed = fractions * step
        weights = step_weights(np, projection.rates[None], elapsed[:, None])
        rise = fractions[:, None] * (last - first)
        step_states = weights.decay * z + weights.constant * (projection.drive @ first)
        step_states = step_states + weights.ramp * (rise @ projection.drive.T)
        states.append(step_states)
        loads.append(first + rise)
        times.append(begin + elapsed)
        z = step_states[-1]
        begin += step
    return _Trajectory(
        states=np.concatenate(states),
        loads=np.concatenate(loads),
        times=np.concatenate(times),
    )


def _dual_gram(
    system: LinearSystem,
    projection: Projection,
    residuals: np.ndarray,
    span: float,
) -> Float[np.ndarray, "j j"]:
    """Gram matrix of the parts of the residual in the dual norm.

    The residual is W z - F u, with W = K V - C V Lambda and F = B - C V V^T B.
    """
    basis = projection.basis
    capacity = system.capacity[:, None]
    stored = capacity * basis.vectors
    terms = np.concatenate(
        [
            basis.conducted - stored * projection.rates,
            system.heat - stored @ projection.drive,
        ],
        axis=1,
    )
    # Combinations by size, each as large as it gets in this run.
    scale = np.abs(residuals).max(axis=0)
    plain = (terms / capacity).T @ terms * np.outer(scale, scale)
    values, directions = np.linalg.eigh((plain + plain.T) / 2)
    large = values > _SMALL**2 * max(values[-1], 0.0)
    large_directions = directions[:, large]
    sides = (terms * scale) @ large_directions
    columns = [system.solve(1 / span, side) for side in sides.T]
    solved = np.stack(columns, axis=1) if columns else np.zeros_like(sides)
    inner = sides.T @ solved
    # For small combinations: (K + C / T)^-1 is at most T C^-1.
    small_directions = directions[:, ~large]
    small_values = np.maximum(values[~large], 0)
    small = span * (small_directions * small_values) @ small_directions.T
    # By (a + b)^2 <= (1 + q) a^2 + (1 + 1 / q) b^2 for any q.
    symmetric = (inner + inner.T) / 2
    gram = (1 + _SHARE) * large_directions @ symmetric @ large_directions.T
    gram = gram + (1 + 1 / _SHARE) * small
    # An input that this run does not use contributes nothing.
    per = np.where(scale > 0, scale, 1.0)
    return gram / np.outer(per, per)
