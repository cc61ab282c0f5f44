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
"""Length of a vector's remainder, relative to the vector, that is rounding [-]."""
_SAMPLES = 40
"""Times of the responses from which a small basis is chosen."""

_Columns = Float[np.ndarray, "n m"]


class Basis(NamedTuple):
    """Orthonormal vectors, with the operators of the scene applied to them."""

    vectors: _Columns
    """V [K per unit]."""
    conducted: _Columns
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

    def with_vectors(
        self, system: LinearSystem, candidates: Sequence[Nodes]
    ) -> "Basis":
        """The basis with further vectors, made orthonormal; dependent ones are left."""
        new = _orthonormal(self.vectors, system.capacity, candidates)
        if not new:
            return self
        conducted = [system.conduct(vector) for vector in new]
        surface = [system.read(vector) for vector in new]
        return Basis(
            vectors=np.column_stack([self.vectors, *new]),
            conducted=np.column_stack([self.conducted, *conducted]),
            surface=np.column_stack([self.surface, *surface]),
        )

    def rotated(self, weights: Float[np.ndarray, "m r"]) -> "Basis":
        """Combinations of the vectors, which are orthonormal if the weights are."""
        return Basis._make(columns @ weights for columns in self)


def _orthonormal(
    basis: _Columns, capacity: Nodes, candidates: Sequence[Nodes]
) -> list[Nodes]:
    new: list[Nodes] = []
    for vector in candidates:
        size = np.sqrt(vector @ (capacity * vector))
        if size == 0:
            continue
        remainder = vector / size
        # Twice is enough (Kahan, in Parlett, The Symmetric Eigenvalue Problem, 1980).
        for _ in range(2):
            remainder = remainder - basis @ (basis.T @ (capacity * remainder))
            for accepted in new:
                remainder = remainder - accepted * (accepted @ (capacity * remainder))
        left = np.sqrt(remainder @ (capacity * remainder))
        if left > _DEPENDENT:
            remainder = remainder / left
            remainder = remainder - basis @ (basis.T @ (capacity * remainder))
            new.append(remainder / np.sqrt(remainder @ (capacity * remainder)))
    return new


class Projection(NamedTuple):
    """The modes of a scene in the space of a basis."""

    basis: Basis
    """Basis rotated to the modes."""
    rates: Float[np.ndarray, " m"]
    """Decay of each mode [1/s]."""
    drive: Float[np.ndarray, "m k"]
    """Growth of each mode by one unit of each input."""
    start: Float[np.ndarray, " m"]
    """Modes at time 0."""


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
        longest: time [s] up to which the model must be right.
        count: number of blocks.
    """
    low = np.log(0.1 / longest)
    high = np.log(30.0 / shortest)
    sides = [system.heat[:, j] for j in range(system.heat.shape[1])]
    if np.any(system.start):
        sides.append(system.capacity * system.start)
    for fraction in _bisections(count):
        rate = float(np.exp(low + fraction * (high - low)))
        yield [system.solve(rate, side) for side in sides]


def _bisections(count: int) -> list[float]:
    """The ends of [0, 1], its middle, quarters, and so on."""
    fractions = [1.0, 0.0, 0.5]
    divisions = 4
    while len(fractions) < count:
        fractions += [k / divisions for k in range(1, divisions, 2)]
        divisions *= 2
    return fractions[:count]


def snapshots(
    system: LinearSystem, plan: Schedule, amplitudes: Float[np.ndarray, "q k"]
) -> list[Nodes]:
    """States of the scene by implicit steps under its own loads.

    Backward Euler, with steps that begin short after every knot and double.
    """
    u0, u1 = plan.loads(np, amplitudes)
    x = system.start
    states = []
    fractions = 2.0 ** np.arange(_DOUBLINGS)
    fractions = fractions / fractions.sum()
    for i, step in enumerate(plan.step):
        for fraction, reached in zip(fractions, np.cumsum(fractions), strict=True):
            rate = 1 / (fraction * step)
            heat = system.heat @ (u0[i] + reached * (u1[i] - u0[i]))
            x = system.solve(rate, rate * system.capacity * x + heat)
            states.append(x)
    return states


_DOUBLINGS = 7
"""Steps of a snapshot run from one knot to the next."""


def surface_gram(system: LinearSystem, basis: Basis) -> Float[np.ndarray, "m m"]:
    """Mean square over the surface of a combination of the vectors [K^2 per unit^2]."""
    area = system.area / system.area.sum()
    return basis.surface.T @ (area[:, None] * basis.surface)


def principal_weights(
    system: LinearSystem,
    projection: Projection,
    plan: Schedule,
    amplitudes: Float[np.ndarray, "q k"],
) -> Float[np.ndarray, "m m"]:
    """Orthonormal combinations of the modes, in falling importance.

    They are singular vectors of the responses to a step and to a ramp of every input,
    of the decay of the start, and of the run itself, as deviations of the surface and
    the volume.
    """
    spans = np.cumsum(plan.step)
    times = np.geomspace(plan.step.min() / 30, spans[-1], _SAMPLES)[:, None]
    weights = step_weights(np, projection.rates[None], times)
    largest = np.abs(amplitudes).max(axis=0, initial=0.0)
    rows = [weights.decay * projection.start]
    for scale, drive in zip(largest, projection.drive.T, strict=True):
        rows += [weights.constant * drive * scale, weights.ramp * drive * scale]
    rows.append(
        host_run(
            projection.rates,
            drive=projection.drive,
            start=projection.start,
            plan=plan,
            amplitudes=amplitudes,
        )
    )
    gram = surface_gram(system, projection.basis)
    metric = gram + np.eye(len(projection.rates)) / system.capacity.sum()
    factor = np.linalg.cholesky(metric)
    left, _, _ = np.linalg.svd(factor.T @ np.concatenate(rows).T)
    return np.linalg.qr(np.linalg.solve(factor.T, left))[0]
