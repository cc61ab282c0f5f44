"""Energy ledger: heat by each mechanism, against the heat that the bodies store.

Relative residual = (stored heat - heat of all mechanisms) / heat moved.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int

from ..arrays import added, device_array, is_traced, product, taken
from ..physics.flux_law import Values
from ..scene.compile.program import LedgerEntries
from .energy import Energy


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


class EntryEnds(NamedTuple):
    """Bodies of the entries of a ledger, with loads on one body and pairs apart."""

    load: Int[np.ndarray, " l"]
    """Entries of loads on one body."""
    heated: Int[np.ndarray, " l"]
    """Bodies that they heat."""
    pair: Int[np.ndarray, " p"]
    """Entries of pairs, whose heat flows from the first body to the second."""
    first: Int[np.ndarray, " p"]
    """First body of each pair."""
    second: Int[np.ndarray, " p"]
    """Second body of each pair."""

    @classmethod
    def of(cls, entries: LedgerEntries) -> "EntryEnds":
        """Bodies of the entries."""
        counts = np.array([len(bodies) for _, bodies in entries], int)
        singles = [bodies for _, bodies in entries if len(bodies) == 1]
        pairs = [bodies for _, bodies in entries if len(bodies) == 2]
        first, second = np.array(pairs, int).reshape(-1, 2).T
        return cls(
            load=np.flatnonzero(counts == 1),
            heated=np.array(singles, int).reshape(-1),
            pair=np.flatnonzero(counts == 2),
            first=first,
            second=second,
        )

    def into_bodies(
        self, heat: Float[Array, "*t c"], bodies: int
    ) -> Float[Array, "*t b"]:
        """Sum of the heat of all entries into each body [J]."""
        return self._summed(heat, bodies, sign_of_first=-1)

    def through_bodies(
        self, moved: Float[Array, "*t c"], bodies: int
    ) -> Float[Array, "*t b"]:
        """Sum of the heat that all entries move into or out of each body [J]."""
        return self._summed(moved, bodies, sign_of_first=1)

    def _summed(
        self, heat: Float[Array, "*t c"], bodies: int, sign_of_first: int
    ) -> Float[Array, "*t b"]:
        body = np.concatenate([self.heated, self.first, self.second])
        entry = np.concatenate([self.load, self.pair, self.pair])
        sign = np.ones(len(body), heat.dtype)
        sign[len(self.heated) :][: len(self.first)] = sign_of_first
        # In the order of bodies: the sum of each is taken at one time.
        order = np.argsort(body, kind="stable")
        none = jnp.zeros((*heat.shape[:-1], bodies), heat.dtype)
        signs = device_array(sign[order].reshape(*[1] * (heat.ndim - 1), -1))
        values = taken(heat, (..., entry[order])) * signs
        return added(none, (..., body[order]), values, is_sorted=True)


class EnergyTable(NamedTuple):
    """Energies of a scene at the saved times, since the start [J]."""

    stored: Float[Values, "t b"]
    """Heat that each body stores."""
    heat: Float[Values, "t c"]
    """Heat by each entry of the ledger."""
    mechanisms: Float[Values, "t m"]
    """Heat by each mechanism into all bodies, in the order of the entries."""
    total: Float[Values, " t"]
    """Heat that all bodies store."""
    relative: Float[Values, " t"]
    """(total - sum of mechanisms) / heat moved [-]."""
    residual_of_bodies: Float[Values, "t b"]
    """Heat that each body stores less that of its mechanisms and contacts."""
    relative_of_bodies: Float[Values, "t b"]
    """The like of each body over the heat that it moved [-]."""


def energy_table(
    entries: LedgerEntries,
    stored: Float[Array, "t b"],
    heat: Float[Array, "t c"],
    moved: Float[Array, "t c"],
    equalization: Float[Array, " b"],
) -> EnergyTable:
    """Sum a ledger of one column per entry by mechanism and by body [J]."""
    ends = EntryEnds.of(entries)
    bodies = stored.shape[1]
    names = _mechanisms(entries)
    outer = np.zeros((len(entries), len(names)), heat.dtype)
    for entry in ends.load.tolist():
        outer[entry, names.index(entries[entry][0])] = 1
    mechanisms = product(heat, device_array(outer))
    residual_of_bodies = stored - ends.into_bodies(heat, bodies)
    through = ends.through_bodies(moved, bodies)
    total = stored.sum(axis=1)
    # Contacts cancel in the sum over bodies.
    error = total - mechanisms.sum(axis=1)
    return EnergyTable(
        stored=stored,
        heat=heat,
        mechanisms=mechanisms,
        total=total,
        relative=error / _nonzero(moved.sum(axis=1) + equalization.sum()),
        residual_of_bodies=residual_of_bodies,
        relative_of_bodies=residual_of_bodies / _nonzero(through + equalization[None]),
    )


def energies(
    entries: LedgerEntries, table: EnergyTable, body_names: Sequence[str]
) -> Energy:
    """Group a table of energies by mechanism, by body and by pair [J]."""
    if not is_traced(table):
        # Cut on the host: a single operation on the device would take longer.
        table = EnergyTable(*map(np.asarray, table))
    columns: list[list[int]] = [[] for _ in range(table.stored.shape[1])]
    for c, (_, ends) in enumerate(entries):
        for body in ends:
            columns[body].append(c)
    return Energy(
        stored_J=table.total,
        mechanisms={
            name: table.mechanisms[:, n] for n, name in enumerate(_mechanisms(entries))
        },
        # Contacts are listed apart.
        contacts={
            pair_name(name, ends, body_names): table.heat[:, c]
            for c, (name, ends) in enumerate(entries)
            if len(ends) == 2
        },
        bodies=tuple(
            _body_energy(
                entries, table, body=body, columns=of_body, body_names=body_names
            )
            for body, of_body in enumerate(columns)
        ),
        residual_relative=table.relative,
    )


def _mechanisms(entries: LedgerEntries) -> tuple[str, ...]:
    """Mechanisms that heat single bodies, each once."""
    return tuple(dict.fromkeys(name for name, ends in entries if len(ends) == 1))


def _body_energy(
    entries: LedgerEntries,
    table: EnergyTable,
    body: int,
    columns: list[int],
    body_names: Sequence[str],
) -> Energy:
    mechanisms = {}
    contacts = {}
    for c in columns:
        name, ends = entries[c]
        if len(ends) == 1:
            mechanisms[name] = table.heat[:, c]
        else:
            pair = pair_name(name, ends, body_names)
            # The heat of a pair flows from its first body to its second.
            contacts[pair] = (1 if ends[1] == body else -1) * table.heat[:, c]
    return Energy(
        stored_J=table.stored[:, body],
        mechanisms=mechanisms,
        contacts=contacts,
        bodies=(),
        residual_relative=table.relative_of_bodies[:, body],
    )


def pair_name(
    mechanism: str, bodies: tuple[int, ...], body_names: Sequence[str]
) -> str:
    """Name of a pair of bodies that a mechanism joins, in `Energy.contacts`.

    Bodies without a name have their numbers alone. The numbers tell pairs apart whose
    names, with a hyphen in them, read alike.
    """
    ends = [
        f"{body} ({body_names[body]})" if body_names[body] else str(body)
        for body in bodies
    ]
    return f"{mechanism} {'-'.join(ends)}"


def _nonzero(heat: Float[Array, "*t"]) -> Float[Array, "*t"]:
    # Where nothing moved, the residual itself is shown.
    return jnp.where(heat > 0, heat, 1)
