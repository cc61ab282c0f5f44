"""Energy ledger: heat by each mechanism, against the heat that the bodies store.

Relative residual = (stored heat - heat of all mechanisms) / heat moved.
"""

from dataclasses import replace
from functools import cache
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float

from ..arrays import device_array, product
from ..scene.compile.program import LedgerEntries


class Ledger(Module):
    """Running totals of the ledger entries [J]."""

    heat: Float[Array, " m"]
    """Heat into the bodies."""
    carry: Float[Array, " m"]
    """Rounding error of `heat` so far."""
    moved: Float[Array, " m"]
    """Integral of |heat rate|."""

    def add(self, heat: Float[Array, " m"]) -> "Ledger":
        """Return the ledger after a step that added `heat` [J]."""
        if not len(heat):
            return self
        # Compensated (Kahan): a thousand float32 steps would otherwise lose more than
        # the solver does.
        term = heat - self.carry
        total = self.heat + term
        return Ledger(
            heat=total,
            carry=(total - self.heat) - term,
            moved=self.moved + jnp.abs(heat),
        )


@cache
def empty_ledger(entries: int, dtype) -> Ledger:
    """Return the ledger at the start of a run."""
    # One array of zeros for all runs, known even while other values are traced.
    with jax.ensure_compile_time_eval():
        zeros = device_array(np.zeros(entries, dtype))
    return Ledger(heat=zeros, carry=zeros, moved=zeros)


class Energy(Module):
    """Energies of all bodies, or of one, at the saved times, since the start [J]."""

    stored_J: Float[Array, " t"]
    """Heat stored [J]."""
    mechanisms: dict[str, Float[Array, " t"]]
    """Heat by each mechanism [J]."""
    contacts: dict[str, Float[Array, " t"]]
    """Heat from the first to the second body of each pair in contact, by a name such as
    "contact 0-1"; of one body, positive into it [J]."""
    bodies: tuple["Energy", ...]
    """Energies of each body; empty within one body."""
    residual_relative: Float[Array, " t"]
    """(stored - sum of mechanisms) / heat moved, by mechanisms or by conduction; of one
    body, contacts count with the mechanisms."""


class HeatRates(Module):
    """Heat rates of all bodies, or of one, in a steady state [W]."""

    mechanisms: dict[str, Float[Array, ""]]
    """Heat rate by each mechanism [W]."""
    contacts: dict[str, Float[Array, ""]]
    """Heat rate from the first to the second body of each pair in contact; of one body,
    positive into it [W]."""
    bodies: tuple["HeatRates", ...]
    """Heat rates of each body; empty within one body."""
    residual_relative: Float[Array, ""]
    """Net heat rate over the sum of magnitudes, 0 in a steady state."""


_Energies = TypeVar("_Energies", bound=Energy | HeatRates)


def energies(
    entries: LedgerEntries,
    stored: Float[Array, "t b"],
    heat: Float[Array, "t c"],
    moved: Float[Array, "t c"],
    equalization: Float[Array, " b"],
) -> Energy:
    """Group a ledger of one column per entry by mechanism, by body and by pair [J]."""
    bodies = tuple(
        _body_energy(
            entries,
            body=body,
            stored=stored[:, body],
            heat=heat,
            moved=moved,
            equalization=equalization[body],
        )
        for body in range(stored.shape[1])
    )
    outer = [c for c, (_, ends) in enumerate(entries) if len(ends) == 1]
    pairs = [c for c, (_, ends) in enumerate(entries) if len(ends) == 2]
    # Contacts cancel in the sum over bodies and are listed apart.
    mechanisms: dict[str, Float[Array, " t"]] = {}
    for c in outer:
        name = entries[c][0]
        mechanisms[name] = mechanisms.get(name, 0) + heat[:, c]
    total = stored.sum(axis=1)
    error = total - heat[:, np.array(outer, int)].sum(axis=1)
    return Energy(
        stored_J=total,
        mechanisms=mechanisms,
        contacts={pair_name(*entries[c]): heat[:, c] for c in pairs},
        bodies=bodies,
        residual_relative=error / _nonzero(moved.sum(axis=1) + equalization.sum()),
    )


def _body_energy(entries, body, stored, heat, moved, equalization) -> Energy:
    columns = [c for c, (_, ends) in enumerate(entries) if body in ends]
    loads = [c for c in columns if len(entries[c][1]) == 1]
    pairs = [c for c in columns if len(entries[c][1]) == 2]
    contacts = {
        pair_name(*entries[c]): _sign(entries[c][1], body) * heat[:, c] for c in pairs
    }
    total = heat[:, np.array(loads, int)].sum(axis=1)
    total = sum(contacts.values(), total)
    through = moved[:, np.array(loads + pairs, int)].sum(axis=1)
    return Energy(
        stored_J=stored,
        mechanisms={entries[c][0]: heat[:, c] for c in loads},
        contacts=contacts,
        bodies=(),
        residual_relative=(stored - total) / _nonzero(through + equalization),
    )


def _sign(bodies: tuple[int, ...], body: int) -> int:
    # The heat of a pair flows from its first body to its second.
    into = int(bodies[-1] == body)
    return into if len(bodies) == 1 else into - int(bodies[0] == body)


def into_bodies(
    heat: Float[Array, " c"], entries: LedgerEntries, bodies: int
) -> Float[Array, " b"]:
    """Sum the heat of all entries into each body [J]."""
    # One product with a constant matrix instead of a sum per body.
    signs = [[_sign(ends, body) for _, ends in entries] for body in range(bodies)]
    shape = (bodies, len(entries))
    return product(device_array(np.array(signs).reshape(shape), heat.dtype), heat)


def pair_name(mechanism: str, bodies: tuple[int, ...]) -> str:
    """Name of a pair of bodies that a mechanism joins, in `Energy.contacts`."""
    return f"{mechanism} {bodies[0]}-{bodies[1]}"


def _nonzero(heat: Float[Array, " t"]) -> Float[Array, " t"]:
    # Where nothing moved, the residual itself is shown.
    return jnp.where(heat > 0, heat, 1)


def in_order(energy: _Energies, entries: LedgerEntries) -> _Energies:
    """Return energies, or heat rates, with mechanisms in the order of the scene."""
    # A dictionary that leaves a jitted function is sorted by name.
    names = dict.fromkeys(name for name, _ in entries)
    table = energy.mechanisms
    mechanisms = {name: table[name] for name in names if name in table}
    bodies = tuple(in_order(body, entries) for body in energy.bodies)
    return replace(energy, mechanisms=mechanisms, bodies=bodies)
