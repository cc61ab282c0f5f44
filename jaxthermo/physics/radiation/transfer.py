"""Irradiation of patches for their emission: radiosity, solved or iterated.

With the emissive power E of each patch [W/m^2], its irradiation is

    H = F (eps E + rho H) + F_s E_s,    rho = 1 - eps.

| patches | operator |
| --- | --- |
| few | `_SolvedTransfer`: H = K E + k_s E_s, with the dense matrix K solved once |
| many | `_IteratedTransfer`: the sparse matrix F, H by conjugate gradients each time |

Source: Hottel and Sarofim, Radiative Transfer (1967).
"""

import abc
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ...arrays import device_array, is_traced, namespace, product, taken
from .view_factors import ViewFactors


# Number of patches up to which the matrix is dense: solving it takes time of the third
# order in their number, again for other emissivities.
_MAX_SOLVED = 1500

# Pairs of patches that are summed at once.
_CHUNK = 16

# Iterations, at most: those of mirrors that face each other.
_MAX_ITERATIONS = 500


class AbstractTransfer(Module):
    """Irradiation of patches for the emission of each."""

    @abc.abstractmethod
    def irradiation(self, emitted: Float[Array, " p"]) -> Float[Array, " p"]:
        """Irradiation of each patch for emissive powers, surroundings at 0 [W/m^2]."""


class _SolvedTransfer(AbstractTransfer):
    """Irradiation by a dense matrix."""

    matrix: Float[Array, "p p"]
    """K [-]: irradiation of each patch for a unit of emissive power of another."""

    @override
    def irradiation(self, emitted: Float[Array, " p"]) -> Float[Array, " p"]:
        return product(self.matrix, emitted)


class _Rows(NamedTuple):
    """Rows of a sparse matrix in chunks of equal length."""

    row: Int[Any, " c"]
    """Row of each chunk, ascending."""
    column: Int[Any, "c k"]
    value: Float[Any, "c k"]
    """0 at the end of a row that has no more."""

    def product(self, vector: Float[Array, " p"]) -> Float[Array, " p"]:
        """Product with a vector."""
        part = (self.value * taken(vector, self.column)).sum(1)
        return jax.ops.segment_sum(part, self.row, len(vector), indices_are_sorted=True)


class _IteratedTransfer(AbstractTransfer):
    """Irradiation by view factors as a sparse matrix."""

    between: _Rows
    """A_i F_ij, symmetric [m^2]."""
    area: Float[Array, " p"]
    """[m^2]"""
    emissivity: Float[Array, " p"]

    @override
    def irradiation(self, emitted: Float[Array, " p"]) -> Float[Array, " p"]:
        return self.reflected(self.between.product(self.emissivity * emitted))

    def reflected(self, direct: Float[Array, " p"]) -> Float[Array, " p"]:
        """Irradiation [W/m^2] for a direct one of patches [W], with all reflections."""
        # A H = X (eps E + rho H) + A F_s E_s with the symmetric X = A F. The unknowns
        # u = sqrt(rho A) H make the system symmetric, also where nothing is reflected.
        weight = jnp.sqrt((1 - self.emissivity) / self.area)

        def system(unknown):
            return unknown - weight * self.between.product(weight * unknown)

        solved, _ = jax.scipy.sparse.linalg.cg(
            system,
            weight * direct,
            tol=float(jnp.finfo(direct.dtype).eps) ** 0.85,
            maxiter=_MAX_ITERATIONS,
        )
        return (direct + self.between.product(weight * solved)) / self.area


class _Transfer(NamedTuple):
    """Irradiation of patches by patches, and by what is around them."""

    between: AbstractTransfer
    around: Float[Any, "p k"]
    """Irradiation of each patch for a unit of emissive power of the surroundings, or
    of the sky and of the ground [-]; with the row of K it adds up to 1."""


def transfer(
    views: ViewFactors,
    emissivity: Float[Any, " p"],
    around: Float[np.ndarray, "p k"],
    dtype: Any,
) -> _Transfer:
    """The exchange of patches of mean emissivities.

    `around` are the view factors to the surroundings, or to the sky and the ground; the
    result has the type `dtype`.
    """
    count = len(views.area)
    if count > _MAX_SOLVED:
        return _iterated(views, emissivity, around, dtype)
    # Without traced emissivities the system is solved on the host, in double precision.
    xp = namespace(emissivity)
    wide = dtype if is_traced(emissivity) else float
    factor = xp.asarray(views.factor.toarray(), wide)
    reflection = xp.eye(count, dtype=wide) - factor * (1 - emissivity)[None]
    direct = [factor * emissivity[None], xp.asarray(around, wide)]
    solved = xp.linalg.solve(reflection, xp.concatenate(direct, axis=1))
    matrix = device_array(solved[:, :count], dtype)
    return _Transfer(
        _SolvedTransfer(matrix), around=device_array(solved[:, count:], dtype)
    )


def _iterated(
    views: ViewFactors,
    emissivity: Float[Any, " p"],
    around: Float[np.ndarray, "p k"],
    dtype: Any,
) -> _Transfer:
    # Geometry is known also while the emissivities are traced.
    with jax.ensure_compile_time_eval():
        rows = _rows(views, dtype)
        area = device_array(views.area, dtype)
        direct = device_array(views.area[:, None] * around, dtype)
    between = _IteratedTransfer(
        between=rows, area=area, emissivity=device_array(emissivity, dtype)
    )
    seen = [between.reflected(column) for column in direct.T]
    return _Transfer(between, around=jnp.stack(seen, axis=1))


def _rows(views: ViewFactors, dtype: Any) -> _Rows:
    matrix = views.between
    count = np.diff(matrix.indptr)
    chunks = -(-count // _CHUNK)
    row = np.repeat(np.arange(len(count)), chunks)
    rank = np.arange(len(row)) - np.repeat(np.cumsum(chunks) - chunks, chunks)
    slot = matrix.indptr[row, None] + _CHUNK * rank[:, None] + np.arange(_CHUNK)
    exists = slot < matrix.indptr[row + 1, None]
    slot = np.where(exists, slot, 0)
    return _Rows(
        row=device_array(row, jnp.int32),
        column=device_array(matrix.indices[slot], jnp.int32),
        value=device_array(np.where(exists, matrix.data[slot], 0.0), dtype),
    )
