"""The surfaces of several bodies as one in the time loop.

The balance of every place stands for itself, so places of all bodies can be one set of
arrays: one balance to compile and to run instead of one a body. Bodies of their own
would run at once and in many small pieces, three times slower than one after the other.
`SurfaceLoad` on each body is the simple form of the same.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..network.network import precise_sum
from ..physics.balance import SurfaceTerms
from ..physics.boundary import ImposedFlux


class JoinedLoad(eqx.Module):
    """What acts on the surfaces of several bodies.

    Bodies on which nothing acts have no places, and are left out of all lists here.
    """

    terms: SurfaceTerms
    """On their places, one body's after another's, numbered as `entries` are. Total
    shares are one a body."""
    entries: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Of each term on each body, its entry in the ledger; -1 where it does not act."""
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
        whole, summed = [], {}
        for (number, term), rate in zip(terms.numbered, rates, strict=True):
            entry = self.entries[number]
            flux = _imposed(term.law, time, here)
            if flux is not None:
                whole.append((entry, term.total_share * flux))
            else:
                # Those of the same entries, such as sky and ground, are summed as one.
                summed[entry] = summed[entry] + rate if entry in summed else rate
        for entry, rate in summed.items():
            each = [precise_sum(own) for own in self._apart(rate)]
            whole.append((entry, jnp.stack(each)))
        return self._apart(heat), _entered(whole, entries, heat.dtype)

    def _apart(self, values: Float[Array, " p"]) -> list[Float[Array, " _"]]:
        return jnp.split(values, np.cumsum(self.places)[:-1].tolist())


def _imposed(law, time, here):
    """A flux that is one number for all bodies; of traced ones that is not known."""
    if not isinstance(law, ImposedFlux):
        return None
    flux = law.flux(time, here)
    return None if flux.ndim else flux


def _entered(whole, entries: int, dtype) -> Float[Array, " c"]:
    """What terms bring to each body, by the entries of the ledger."""
    where = np.array([number for entry, _ in whole for number in entry])
    brought = jnp.concatenate([each for _, each in whole])
    acts = np.flatnonzero(where >= 0)
    return jnp.zeros(entries, dtype).at[where[acts]].add(brought[acts])
