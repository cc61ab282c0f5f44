"""One V-cycle of multigrid: a fixed, symmetric, positive approximation of A^-1.

A = diag(m) - K, where K v is the network's heat rate: what an implicit step and a
steady state solve. A few sweeps over neighbours leave only an error that is smooth,
which a coarser network sees as well and removes at an eighth of the cost; and so on
down to a few nodes, which are solved at once. With the same polynomial smoother before
and after, and restriction the transpose of prolongation, the cycle is a symmetric map,
so that it may precondition conjugate gradients.

Source: Briggs, Henson, McCormick, A Multigrid Tutorial (2000), ch. 3; Chebyshev
smoothing, Adams et al., J. Comput. Phys. 188 (2003) 593-610.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .network import AbstractNetwork, inverse


SMOOTHED_RANGE = 6.0
"""Largest over smallest eigenvalue of D^-1 A that the smoother is made for."""


def made(values: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The same, as an array in memory.

    XLA on the CPU else computes what neighbours are gathered from anew for every one of
    them, from level to level: a cycle took five times as long. A branch that depends on
    the values is what it does not look through.
    """
    first = values.reshape(-1)[0]
    return jax.lax.cond(first > -jnp.inf, lambda v: v, lambda v: v + v, values)


class AbstractCycle(eqx.Module):
    """An approximation of A^-1: symmetric, positive and linear."""

    @abc.abstractmethod
    def __call__(self, r: Float[Array, "..."]) -> Float[Array, "..."]:
        """About A^-1 r [K], zero where there is no node; r is a state [W]."""


class AbstractTransfer(eqx.Module):
    """Between a level and the next coarser one; its two maps are transposes."""

    @abc.abstractmethod
    def total(self, fine: Float[Array, "..."]) -> Float[Array, "..."]:
        """For each coarse node the sum over its fine ones."""

    @abc.abstractmethod
    def spread(self, coarse: Float[Array, "..."]) -> Float[Array, "..."]:
        """For each fine node the value of its coarse one."""


class JacobiCycle(AbstractCycle):
    """D^-1 r, the simplest: the tested reference, and good enough for short steps."""

    inverse_diagonal: Float[Array, "..."]
    """[K/W]"""

    def __call__(self, r: Float[Array, "..."]) -> Float[Array, "..."]:
        """About A^-1 r [K]."""
        return self.inverse_diagonal * r


class Level(eqx.Module):
    """A = diag(m) - K on one level, and its smoother q(D^-1 A) D^-1, q linear."""

    network: AbstractNetwork
    m: Float[Array, "..."]
    """[W/K]"""
    inverse_diagonal: Float[Array, "..."]
    """Of A [K/W]; 0 where there is no node."""
    first: Float[Array, ""]
    second: Float[Array, ""]
    """q(x) = first - second x."""

    def apply(self, v: Float[Array, "..."]) -> Float[Array, "..."]:
        """A v [W]."""
        return self.m * v - self.network.heat_rate(v)

    def masked(self, v: Float[Array, "..."]) -> Float[Array, "..."]:
        """V, with zeros where there is no node."""
        return jnp.where(self.inverse_diagonal > 0, v, 0)

    def smoothed(self, r: Float[Array, "..."]) -> Float[Array, "..."]:
        """About A^-1 r, as far as neighbours tell [K]."""
        d = made(self.inverse_diagonal * r)
        return self.first * d - self.second * (self.inverse_diagonal * self.apply(d))


def level(network: AbstractNetwork, m: Float[Array, "..."]) -> Level:
    """A level with the smoother for its range of eigenvalues.

    Those of D^-1 A lie in [1 - s, 1 + s], s the largest share that links have in D
    (Gershgorin). On [a, b] = [max(1 - s, b / SMOOTHED_RANGE), 1 + s] the polynomial
    of degree two that is 1 at 0 and least elsewhere is Chebyshev's, with

        q(x) = (4 t - 2 x) / (2 t^2 - d^2),   t = (a + b) / 2, d = (b - a) / 2.

    It is positive below a + b, hence so is the smoother.

    Args:
        network: K.
        m: what is added to its diagonal [W/K], 0 or more.
    """
    links = network.diagonal()
    inverse_diagonal = inverse(m + links)
    share = (links * inverse_diagonal).max()
    high = 1 + share
    low = jnp.maximum(1 - share, high / SMOOTHED_RANGE)
    middle, half = (low + high) / 2, (high - low) / 2
    scale = 2 * middle**2 - half**2
    return Level(network, m, inverse_diagonal, 4 * middle / scale, 2 / scale)


class DenseSolve(AbstractCycle):
    """W^T W r with a dense W: A^-1 of a few nodes, for the coarsest level."""

    factor: Float[Array, "c c"]
    """W = L^-1 D^-1/2, where L L^T = D^-1/2 A D^-1/2."""

    def __call__(self, r: Float[Array, "..."]) -> Float[Array, "..."]:
        """A^-1 r [K]."""
        return (self.factor.T @ (self.factor @ r.reshape(-1))).reshape(r.shape)


def dense_solve(network: AbstractNetwork, m: Float[Array, "..."]) -> DenseSolve:
    """A^-1 of few nodes; a body that nothing holds (m = 0) is held by rounding error.

    Args:
        network: K.
        m: what is added to its diagonal [W/K], 0 or more.
    """
    n, dtype = m.size, m.dtype
    unit = jnp.eye(n, dtype=dtype).reshape(n, *m.shape)
    a = jnp.diag(m.reshape(-1)) - jax.vmap(network.heat_rate)(unit).reshape(n, n)
    scale = jnp.sqrt(inverse(jnp.diag(a)))
    a = scale[:, None] * a * scale[None]
    # More than the factorization's rounding error, so that it never meets a root of
    # a negative number.
    held = 4 * n * jnp.finfo(dtype).eps
    a = a + jnp.diag(jnp.where(scale > 0, jnp.asarray(held, dtype), 1))
    lower = jnp.linalg.cholesky(a)
    factor = jax.scipy.linalg.solve_triangular(lower, jnp.diag(scale), lower=True)
    return DenseSolve(factor)


class MultigridCycle(AbstractCycle):
    """Down to the coarsest level and up again, smoothing on every one."""

    levels: tuple[Level, ...]
    """From fine to coarse, without the coarsest."""
    transfers: tuple[AbstractTransfer, ...]
    """From each to the next."""
    coarsest: AbstractCycle

    def __call__(self, r: Float[Array, "..."]) -> Float[Array, "..."]:
        """About A^-1 r [K]."""
        steps = list(zip(self.levels, self.transfers, strict=True))
        before = []
        for level, transfer in steps:
            z = made(level.smoothed(r))
            before.append((z, r))
            r = made(transfer.total(made(level.masked(r - level.apply(z)))))
        z = self.coarsest(r)
        for (level, transfer), (z_before, r) in zip(
            reversed(steps), reversed(before), strict=True
        ):
            z = made(z_before + level.masked(transfer.spread(made(z))))
            z = z + level.smoothed(made(r - level.apply(z)))
        return z
