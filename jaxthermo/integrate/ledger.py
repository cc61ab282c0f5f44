"""The energy ledger: what each mechanism brought, against what the bodies stored."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class Ledger(eqx.Module):
    """Running totals, one entry a mechanism [J].

    Sums are compensated (Kahan): a thousand float32 steps would otherwise lose more
    than the solver does.
    """

    heat: Float[Array, " m"]
    """Into the bodies."""
    carry: Float[Array, " m"]
    """What rounding has kept from `heat` so far."""
    moved: Float[Array, " m"]
    """Integral of |heat rate|."""

    def add(self, heat: Float[Array, " m"]) -> "Ledger":
        """The ledger after one step brought `heat` [J]."""
        term = heat - self.carry
        total = self.heat + term
        return Ledger(
            heat=total,
            carry=(total - self.heat) - term,
            moved=self.moved + jnp.abs(heat),
        )


def empty_ledger(mechanisms: int, dtype) -> Ledger:
    """Nothing moved yet."""
    zeros = jnp.zeros(mechanisms, dtype)
    return Ledger(heat=zeros, carry=zeros, moved=zeros)


class Energy(eqx.Module):
    """The ledger at the saved times."""

    stored_J: Float[Array, " t"]
    """Heat the bodies hold above the start."""
    mechanisms: dict[str, Float[Array, " t"]]
    """Heat each mechanism brought since the start [J]."""
    residual_relative: Float[Array, " t"]
    """(stored - sum of mechanisms) / heat moved, by mechanisms or by conduction."""
