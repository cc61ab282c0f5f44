"""V-cycle of multigrid: a fixed, symmetric, positive approximation of A^-1.

A = diag(m) - K, where K v is the network's heat rate, is the matrix of an implicit step
and of a steady state. A few smoothing sweeps leave only a smooth error, which a coarser
network resolves as well and removes at an eighth of the cost; and so on down to a few
nodes, which are solved directly. With the same polynomial smoother before and after,
and restriction the transpose of prolongation, the cycle is a symmetric map, so that it
can precondition conjugate gradients.

Source: Briggs, Henson, McCormick, A Multigrid Tutorial (2000), ch. 3; Chebyshev
smoothing, Adams et al., J. Comput. Phys. 188 (2003) 593-610.
"""

import abc

import jax
import jax.numpy as jnp
from equinox import Module
from jaxtyping import Array, Float
from typing_extensions import override

from ..arrays import product
from .network import AbstractNetwork, inverse


_SMOOTHED_RANGE = 6.0
"""Ratio of the largest to the smallest smoothed eigenvalue of D^-1 A."""


def _materialized(values: Float[Array, "*n"]) -> Float[Array, "*n"]:
    # Otherwise XLA on the CPU recomputes gathered values for every neighbour, from
    # level to level. It does not fuse through a branch that depends on the values.
    first = values.reshape(-1)[0]
    return jax.lax.cond(first > -jnp.inf, lambda v: v, lambda v: v + v, values)


class AbstractCycle(Module):
    """Symmetric, positive and linear approximation of A^-1."""

    @abc.abstractmethod
    def __call__(self, r: Float[Array, "..."]) -> Float[Array, "..."]:
        """Approximation of A^-1 r [K], zero where there is no node; r [W]."""


class AbstractTransfer(Module):
    """Restriction to the next coarser level and prolongation, its transpose."""

    @abc.abstractmethod
    def restrict(self, fine: Float[Array, "..."]) -> Float[Array, "..."]:
        """Sum over the fine nodes of each coarse node."""

    @abc.abstractmethod
    def prolong(self, coarse: Float[Array, "..."]) -> Float[Array, "..."]:
        """Value of the coarse node of each fine node."""


class JacobiCycle(AbstractCycle):
    """D^-1 r: the tested reference, and sufficient for short steps."""

    inverse_diagonal: Float[Array, "..."]
    """Inverse of the diagonal D of A [K/W]."""

    @override
    def __call__(self, r: Float[Array, "..."]) -> Float[Array, "..."]:
        return self.inverse_diagonal * r


class _Level(Module):
    """A = diag(m) - K on one level, with the smoother q(D^-1 A) D^-1, q linear."""

    network: AbstractNetwork
    m: Float[Array, "..."]
    """Added to the diagonal [W/K]."""
    inverse_diagonal: Float[Array, "..."]
    """Inverse of the diagonal of A [K/W]; 0 where there is no node."""
    constant: Float[Array, ""]
    """Constant term a of the smoother q(x) = a - b x."""
    slope: Float[Array, ""]
    """Slope b of the smoother."""

    def apply(self, v: Float[Array, "..."]) -> Float[Array, "..."]:
        """A v [W]."""
        return self.m * v - self.network.heat_rate(v)

    def masked(self, v: Float[Array, "..."]) -> Float[Array, "..."]:
        """`v` with zeros where there is no node."""
        return jnp.where(self.inverse_diagonal > 0, v, 0)

    def smoothed(self, r: Float[Array, "..."]) -> Float[Array, "..."]:
        """Smoothed correction q(D^-1 A) D^-1 r [K]."""
        d = _materialized(self.inverse_diagonal * r)
        image = self.inverse_diagonal * self.apply(d)
        return self.constant * d - self.slope * image


def level(network: AbstractNetwork, m: Float[Array, "..."]) -> _Level:
    """Level diag(m) - K with the smoother for its range of eigenvalues; m [W/K].

    Those of D^-1 A lie in [1 - s, 1 + s], s the largest fraction of links in D
    (Gershgorin). On [a, b] = [max(1 - s, b / _SMOOTHED_RANGE), 1 + s] the polynomial
    of degree two that is 1 at 0 and smallest elsewhere is Chebyshev's, with

        q(x) = (4 t - 2 x) / (2 t^2 - d^2),   t = (a + b) / 2, d = (b - a) / 2.

    It is positive below a + b, hence so is the smoother.
    """
    links = network.diagonal()
    inverse_diagonal = inverse(m + links)
    fraction = (links * inverse_diagonal).max()
    high = 1 + fraction
    low = jnp.maximum(1 - fraction, high / _SMOOTHED_RANGE)
    middle = (low + high) / 2
    half_range = (high - low) / 2
    scale = 2 * middle**2 - half_range**2
    return _Level(
        network=network,
        m=m,
        inverse_diagonal=inverse_diagonal,
        constant=4 * middle / scale,
        slope=2 / scale,
    )


class _DenseSolve(AbstractCycle):
    """W^T W r with a dense W: A^-1 of a few nodes, for the coarsest level."""

    factor: Float[Array, "c c"]
    """W = L^-1 D^-1/2, where L L^T = D^-1/2 A D^-1/2."""

    @override
    def __call__(self, r: Float[Array, "..."]) -> Float[Array, "..."]:
        scaled = product(self.factor, r.reshape(-1))
        return product(self.factor.T, scaled).reshape(r.shape)


def dense_solve(network: AbstractNetwork, m: Float[Array, "..."]) -> _DenseSolve:
    """(diag(m) - K)^-1 of few nodes, regularized for an insulated body (m = 0)."""
    n = m.size
    unit = jnp.eye(n, dtype=m.dtype).reshape(n, *m.shape)
    conduction = jax.vmap(network.heat_rate)(unit).reshape(n, n)
    a = jnp.diag(m.reshape(-1)) - conduction
    scale = jnp.sqrt(inverse(jnp.diag(a)))
    a = scale[:, None] * a * scale[None]
    # Larger than the factorization's rounding error, so that no square root is of a
    # negative number.
    regularization = jnp.asarray(4 * n * jnp.finfo(m.dtype).eps, m.dtype)
    a = a + jnp.diag(jnp.where(scale > 0, regularization, 1))
    lower = jnp.linalg.cholesky(a)
    factor = jax.scipy.linalg.solve_triangular(lower, jnp.diag(scale), lower=True)
    return _DenseSolve(factor)


class MultigridCycle(AbstractCycle):
    """V-cycle down to the coarsest level and up again, with smoothing on each."""

    levels: tuple[_Level, ...]
    """Levels from fine to coarse, without the coarsest."""
    transfers: tuple[AbstractTransfer, ...]
    """Transfers from each level to the next."""
    coarsest: AbstractCycle

    @override
    def __call__(self, r: Float[Array, "..."]) -> Float[Array, "..."]:
        descent = []
        for level, transfer in zip(self.levels, self.transfers, strict=True):
            z = _materialized(level.smoothed(r))
            descent.append((level, transfer, z, r))
            residual = _materialized(level.masked(r - level.apply(z)))
            r = _materialized(transfer.restrict(residual))
        z = self.coarsest(r)
        for level, transfer, smoothed, r in reversed(descent):
            correction = transfer.prolong(_materialized(z))
            z = _materialized(smoothed + level.masked(correction))
            z = z + level.smoothed(_materialized(r - level.apply(z)))
        return z
