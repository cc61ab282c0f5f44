"""Bases of reduced models: rational Krylov vectors or snapshots, and their choice.

The vectors V are orthonormal in the capacities, V^T C V = 1, so that the Galerkin
projection stays symmetric and the reduced model loses heat wherever the scene does.

Source of rational Krylov bases: Ruhe, Linear Algebra and its Applications 58 (1984)
391-405; of snapshots: Sirovich, Quarterly of Applied Mathematics 45 (1987) 561-571.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .linear_system import LinearSystem, Nodes
from .modal_run import Schedule, host_run, step_weights


_DEPENDENT = 1e-7
"""Part of a vector beyond the others below which it is rounding [-]."""
_SAMPLES = 40
"""Times of the responses from which a small basis is chosen."""

Columns = Float[np.ndarray, "n m"]


class Basis(NamedTuple):
    """Orthonormal vectors and what the scene makes of them."""

    vectors: Columns
    """V [K per unit]."""
    conducted: Columns
    """K V [W per unit]."""
    surface: Float[np.ndarray, "s m"]
    """R V [K per unit]."""

    @property
    def size(self) -> int:
        """Number of vectors."""
        return self.vectors.shape[1]

    @classmethod
    def empty(cls, system: LinearSystem) -> "Basis":
        """A basis without vectors."""
        nodes = np.zeros((len(system.capacity), 0))
        return cls(nodes, nodes, np.zeros((len(system.area), 0)))

    def with_vectors(self, system: LinearSystem, found: Sequence[Nodes]) -> "Basis":
        """The basis with further vectors, less what depends on the others."""
        new = _orthonormal(self.vectors, system.capacity, found)
        if not new:
            return self
        columns = lambda apply: np.stack([apply(v) for v in new], axis=1)
        return Basis(
            np.concatenate([self.vectors, np.stack(new, axis=1)], axis=1),
            np.concatenate([self.conducted, columns(system.conduct)], axis=1),
            np.concatenate([self.surface, columns(system.read)], axis=1),
        )

    def rotated(self, weights: Float[np.ndarray, "m r"]) -> "Basis":
        """Combinations of the vectors, which are orthonormal if the weights are."""
        return Basis(*(each @ weights for each in self))


def _orthonormal(
    before: Columns, capacity: Nodes, found: Sequence[Nodes]
) -> list[Nodes]:
    new: list[Nodes] = []
    for vector in found:
        size = np.sqrt(vector @ (capacity * vector))
        if size == 0:
            continue
        own = vector / size
        # Twice is enough (Kahan, in Parlett, The Symmetric Eigenvalue Problem, 1980).
        for _ in range(2):
            own = own - before @ (before.T @ (capacity * own))
            for other in new:
                own = own - other * (other @ (capacity * own))
        left = np.sqrt(own @ (capacity * own))
        if left > _DEPENDENT:
            own = own / left
            own = own - before @ (before.T @ (capacity * own))
            new.append(own / np.sqrt(own @ (capacity * own)))
    return new


class Projection(NamedTuple):
    """The modes of a scene in the space of a basis."""

    basis: Basis
    """Rotated to the modes."""
    rates: Float[np.ndarray, " m"]
    """Decay of each mode [1/s]."""
    drive: Float[np.ndarray, "m k"]
    """Growth of each mode by one unit of each input."""
    start: Float[np.ndarray, " m"]


def project(system: LinearSystem, basis: Basis) -> Projection:
    """Galerkin projection of C dx/dt = -K x + B u, diagonalized."""
    operator = basis.vectors.T @ basis.conducted
    rates, modes = np.linalg.eigh((operator + operator.T) / 2)
    basis = basis.rotated(modes)
    # Without a loss the slowest rate is 0 but for rounding.
    rates = np.maximum(rates, 0.0)
    drive = basis.vectors.T @ system.heat
    return Projection(
        basis=basis,
        rates=rates,
        drive=drive,
        start=basis.vectors.T @ (system.capacity * system.start),
    )


def krylov_blocks(
    system: LinearSystem, shortest: float, longest: float, count: int
) -> Iterator[list[Nodes]]:
    """Blocks of (s C + K)^-1 [B, C x_0], for rates s spread over the time scales.

    Args:
        system: of the scene.
        shortest: time [s] at which the model must be right after a load has changed.
        longest: the same at the end [s].
        count: number of blocks.
    """
    low, high = np.log(0.1 / longest), np.log(30.0 / shortest)
    sides = [system.heat[:, j] for j in range(system.heat.shape[1])]
    if np.any(system.start):
        sides.append(system.capacity * system.start)
    for fraction in _bisections(count):
        rate = float(np.exp(low + fraction * (high - low)))
        yield [system.solve(rate, side) for side in sides]


def _bisections(count: int) -> list[float]:
    """The ends of [0, 1], its middle, quarters, and so on."""
    found = [1.0, 0.0, 0.5]
    parts = 4
    while len(found) < count:
        found += [k / parts for k in range(1, parts, 2)]
        parts *= 2
    return found[:count]


def snapshots(
    system: LinearSystem, plan: Schedule, amplitudes: Float[np.ndarray, "q k"]
) -> list[Nodes]:
    """States of the scene by implicit steps under its own loads.

    Backward Euler, with steps that begin short after every knot and double.
    """
    u0, u1 = plan.loads(np, amplitudes)
    x, found = system.start, []
    for i, step in enumerate(plan.step):
        parts = 2.0 ** np.arange(_DOUBLINGS)
        parts = parts / parts.sum()
        for part, reached in zip(parts, np.cumsum(parts), strict=True):
            rate = 1 / (part * step)
            heat = system.heat @ (u0[i] + reached * (u1[i] - u0[i]))
            x = system.solve(rate, rate * system.capacity * x + heat)
            found.append(x)
    return found


_DOUBLINGS = 7
"""Steps of a snapshot run from one knot to the next."""


def surface_gram(system: LinearSystem, basis: Basis) -> Float[np.ndarray, "m m"]:
    """Mean square over the surface of a combination of the vectors [K^2 per unit^2]."""
    area = system.area / system.area.sum()
    return basis.surface.T @ (area[:, None] * basis.surface)


def principal_weights(
    system: LinearSystem,
    whole: Projection,
    plan: Schedule,
    amplitudes: Float[np.ndarray, "q k"],
) -> Float[np.ndarray, "m m"]:
    """Weights of the modes in vectors of falling importance, orthonormal.

    By a singular value decomposition of the responses to a step and to a ramp of every
    input, of the decay of the start and of the run itself, as deviations of surface and
    volume.
    """
    spans = np.cumsum(plan.step)
    times = np.geomspace(plan.step.min() / 30, spans[-1], _SAMPLES)[:, None]
    decay, of_step, of_ramp = step_weights(np, whole.rates[None], times)
    largest = np.abs(amplitudes).max(axis=0, initial=0.0)
    rows = [decay * whole.start]
    for scale, drive in zip(largest, whole.drive.T, strict=True):
        rows += [of_step * drive * scale, of_ramp * drive * scale]
    rows.append(
        host_run(
            whole.rates,
            drive=whole.drive,
            start=whole.start,
            plan=plan,
            amplitudes=amplitudes,
        )
    )
    gram = surface_gram(system, whole.basis)
    metric = gram + np.eye(len(whole.rates)) / system.capacity.sum()
    factor = np.linalg.cholesky(metric)
    left, _, _ = np.linalg.svd(factor.T @ np.concatenate(rows).T)
    return np.linalg.qr(np.linalg.solve(factor.T, left))[0]
