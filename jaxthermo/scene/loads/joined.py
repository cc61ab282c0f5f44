"""The surfaces of several bodies as one in the time loop.

The balance of every place stands for itself, so places of all bodies can be one set of
arrays: one balance to compile and to run instead of one a body. Bodies of their own
would run at once and in many small pieces, three times slower than one after the other.
`SurfaceLoad` on each body is the simple form of the same.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...network.network import precise_sum
from ...physics.surface_energy_balance import SurfaceTerms


class JoinedLoad(eqx.Module):
    """What acts on the surfaces of several bodies.

    Bodies on which nothing acts have no places, and are left out of all lists here.
    """

    terms: SurfaceTerms
    """On their places, one body's after another's, numbered as `entries` are. Total
    shares are one a body."""
    entries: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Of each number, each body's entry in the ledger; -1 where it has none."""
    places: tuple[int, ...] = eqx.field(static=True)
    """How many each body has."""

    def heat(
        self,
        time: Float[Array, ""],
        thetas: Sequence[Float[Array, " _"]],
        relative: Sequence[Float[Array, "..."]],
        radiated: Sequence[Float[Array, " _"]] | None,
        entries: int,
        emits: bool = False,
    ) -> tuple[list[Float[Array, " _"]], Float[Array, " c"]]:
        """Heat rate through each body's places, and by each entry of the ledger [W].

        Args:
            time: of the loads [s].
            thetas: of the places' nodes above the references [K].
            relative: their conductivities over the stated ones.
            radiated: to each place by what it sees [W/m^2].
            entries: how many the ledger has.
            emits: whether its own emission is not yet taken off what is radiated.
        """
        terms = self.terms
        if any(each.ndim for each in relative):
            pairs = zip(relative, thetas, strict=True)
            every = [jnp.broadcast_to(each, here.shape) for each, here in pairs]
            terms = terms.conducting(jnp.concatenate(every))
        if radiated is not None:
            terms = terms.radiating(jnp.concatenate(radiated), emits)
        here = jnp.concatenate(thetas)
        heat, rates = terms.rates(time, here)
        closed = self._closed()
        each = [(n, self._sums(rate)) for n, rate in rates.items() if n != closed]
        each += [(n, flux) for n, flux in terms.imposed(time, here) if n != closed]
        if closed is not None:
            each.append((closed, self._sums(heat) - sum(own for _, own in each)))
        return self._apart(heat), self._entered(each, entries, heat.dtype)

    def _closed(self) -> int | None:
        """The entry of the laws that cost most, if any bends: what others leave.

        All bring what goes through, so it need not be summed, nor kept in an array, nor
        computed twice; it is as exact as the heat of all.
        """
        sizes: dict[int, int] = {}
        for n, term in self.terms.natural:
            if not term.law.is_linear:
                held = sum(np.size(leaf) for leaf in jax.tree.leaves(term.law))
                sizes[n] = sizes.get(n, 0) + held
        return max(sizes, key=lambda n: sizes[n], default=None)

    def _sums(self, values: Float[Array, " p"]) -> Float[Array, " b"]:
        return jnp.stack([precise_sum(own) for own in self._apart(values)])

    def _entered(self, each, entries: int, dtype) -> Float[Array, " c"]:
        """What terms bring to each body, by the entries of the ledger."""
        where = np.array([entry for n, _ in each for entry in self.entries[n]])
        acts = np.flatnonzero(where >= 0)
        brought = jnp.concatenate([own for _, own in each])
        return jnp.zeros(entries, dtype).at[where[acts]].add(brought[acts])

    def _apart(self, values: Float[Array, " p"]) -> list[Float[Array, " _"]]:
        return jnp.split(values, np.cumsum(self.places)[:-1].tolist())
