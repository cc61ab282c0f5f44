"""The energy ledger: what each mechanism brought, against what the bodies stored."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...scene.compile.program import LedgerEntry


class Ledger(eqx.Module):
    """Running totals, one for each entry [J].

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
        if not len(heat):
            return self
        term = heat - self.carry
        total = self.heat + term
        return Ledger(
            heat=total,
            carry=(total - self.heat) - term,
            moved=self.moved + jnp.abs(heat),
        )


def empty_ledger(entries: int, dtype) -> Ledger:
    """Nothing moved yet."""
    zeros = jnp.zeros(entries, dtype)
    return Ledger(heat=zeros, carry=zeros, moved=zeros)


class BodyEnergy(eqx.Module):
    """The ledger of one body at the saved times."""

    stored_J: Float[Array, " t"]
    """Heat it holds above the start."""
    mechanisms: dict[str, Float[Array, " t"]]
    """Heat each mechanism brought to it since the start [J]."""
    contacts: dict[str, Float[Array, " t"]]
    """Heat that came through each contact, by its name [J]."""
    residual_relative: Float[Array, " t"]
    """(stored - all that was brought) / heat moved."""


class Energy(eqx.Module):
    """The ledger at the saved times."""

    stored_J: Float[Array, " t"]
    """Heat the bodies hold above the start."""
    mechanisms: dict[str, Float[Array, " t"]]
    """Heat each mechanism brought to all bodies since the start [J]."""
    contacts: dict[str, Float[Array, " t"]]
    """Heat that went from the first body to the second of each pair in contact, such as
    "contact 0-1" [J]."""
    bodies: tuple[BodyEnergy, ...]
    residual_relative: Float[Array, " t"]
    """(stored - sum of mechanisms) / heat moved, by mechanisms or by conduction."""


class BodyHeatRates(eqx.Module):
    """What comes to one body in a steady state."""

    mechanisms: dict[str, Float[Array, ""]]
    """By each mechanism [W]."""
    contacts: dict[str, Float[Array, ""]]
    """Through each contact, by its name [W]."""
    residual_relative: Float[Array, ""]
    """All that comes over all that comes or goes, 0 if the state is steady."""


class HeatRates(eqx.Module):
    """What comes to the bodies in a steady state, and goes."""

    mechanisms: dict[str, Float[Array, ""]]
    """By each mechanism, to all bodies [W]."""
    contacts: dict[str, Float[Array, ""]]
    """From the first body to the second of each pair in contact [W]."""
    bodies: tuple[BodyHeatRates, ...]
    residual_relative: Float[Array, ""]
    """All that comes over all that comes or goes."""


def steady_heat_rates(
    entries: tuple[LedgerEntry, ...], rates: Float[Array, " c"], bodies: int
) -> HeatRates:
    """What each entry brings, by mechanism, by body and by pair.

    Args:
        entries: what the values are.
        rates: of each entry [W].
        bodies: how many there are.
    """
    still = jnp.zeros((1, bodies), rates.dtype)
    found = energies(entries, still, rates[None], jnp.abs(rates)[None], still[0])
    found = in_order(found, entries)
    only = lambda table: {name: each[0] for name, each in table.items()}
    each = lambda e: (only(e.mechanisms), only(e.contacts))
    return HeatRates(
        *each(found),
        tuple(BodyHeatRates(*each(b), -b.residual_relative[0]) for b in found.bodies),
        -found.residual_relative[0],
    )


def energies(
    entries: tuple[LedgerEntry, ...],
    stored: Float[Array, "t b"],
    heat: Float[Array, "t c"],
    moved: Float[Array, "t c"],
    even: Float[Array, " b"],
) -> Energy:
    """The ledger by mechanism, by body and by pair.

    Args:
        entries: what the columns are.
        stored: by each body since the start [J].
        heat: of each entry since the start [J].
        moved: the same without signs [J].
        even: heat that conduction must move to even out each body's start [J].
    """
    bodies = tuple(
        _of_body(entries, body, stored[:, body], heat, moved, even[body])
        for body in range(stored.shape[1])
    )
    outer = [c for c, entry in enumerate(entries) if entry.other is None]
    inner = [c for c, entry in enumerate(entries) if entry.other is not None]
    mechanisms: dict[str, Float[Array, " t"]] = {}
    for c in outer:
        name = entries[c].mechanism
        mechanisms[name] = mechanisms.get(name, 0) + heat[:, c]
    total = stored.sum(axis=1)
    error = total - heat[:, np.array(outer, int)].sum(axis=1)
    return Energy(
        stored_J=total,
        mechanisms=mechanisms,
        contacts={_pair_name(entries[c]): heat[:, c] for c in inner},
        bodies=bodies,
        residual_relative=error / _or_one(moved.sum(axis=1) + even.sum()),
    )


def _of_body(entries, body, stored, heat, moved, even) -> BodyEnergy:
    own = [c for c, e in enumerate(entries) if e.other is None and e.body == body]
    pairs = [c for c, e in enumerate(entries) if e.other is not None and body in e[1:]]
    sign = lambda c: _sign(entries[c], body)
    contacts = {_pair_name(entries[c]): sign(c) * heat[:, c] for c in pairs}
    brought = heat[:, np.array(own, int)].sum(axis=1)
    brought = sum(contacts.values(), brought)
    through = moved[:, np.array(own + pairs, int)].sum(axis=1)
    return BodyEnergy(
        stored_J=stored,
        mechanisms={entries[c].mechanism: heat[:, c] for c in own},
        contacts=contacts,
        residual_relative=(stored - brought) / _or_one(through + even),
    )


def _sign(entry: LedgerEntry, body: int) -> int:
    """What an entry counts for in a body: a pair's goes from its first to its other."""
    if entry.other is None:
        return int(entry.body == body)
    return int(entry.other == body) - int(entry.body == body)


def into_bodies(
    heat: Float[Array, " c"], entries: tuple[LedgerEntry, ...], bodies: int
) -> Float[Array, " b"]:
    """What the entries bring to each body [J]."""
    counts = [[_sign(entry, body) for entry in entries] for body in range(bodies)]
    return (
        jnp.asarray(np.array(counts).reshape(bodies, len(entries)), heat.dtype) @ heat
    )


def _pair_name(entry: LedgerEntry) -> str:
    return f"{entry.mechanism} {entry.body}-{entry.other}"


def _or_one(throughput: Float[Array, " t"]) -> Float[Array, " t"]:
    return jnp.where(throughput > 0, throughput, 1)


def in_order(energy: Energy, entries: tuple[LedgerEntry, ...]) -> Energy:
    """The same in the order of the scene: jit sorts mechanisms by name."""
    names = dict.fromkeys(entry.mechanism for entry in entries)
    sort = lambda found: {name: found[name] for name in names if name in found}
    bodies = tuple(
        BodyEnergy(
            body.stored_J, sort(body.mechanisms), body.contacts, body.residual_relative
        )
        for body in energy.bodies
    )
    return Energy(
        energy.stored_J,
        sort(energy.mechanisms),
        energy.contacts,
        bodies,
        energy.residual_relative,
    )
