"""The ledger keeps the digits of many small entries, and sums them by body."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxthermo.integrate.ledger import EntryEnds, empty_ledger, energy_table


STEPS = 200_000


def test_totals_of_many_small_entries_in_float32():
    entry = jnp.array([0.1, -0.3], jnp.float32)

    def add(i, ledger):
        return ledger.add(entry)

    ledger = jax.jit(
        lambda: jax.lax.fori_loop(0, STEPS, add, empty_ledger(2, jnp.float32))
    )()
    exact = STEPS * np.asarray(entry, float)
    np.testing.assert_allclose(ledger.heat, exact, rtol=2e-7)
    # Summed without compensation the same entries lose four digits.
    plain = np.cumsum(np.full(STEPS, entry[0], np.float32))[-1]
    assert abs(plain / exact[0] - 1) > 1e-4
    # What has moved only scales the residual.
    np.testing.assert_allclose(ledger.moved, np.abs(exact), rtol=1e-2)


def _entries(bodies: int):
    """Two mechanisms on every body, and a contact of each with the one after it."""
    loads = [(name, (body,)) for name in ("sun", "air") for body in range(bodies)]
    pairs = [("contact", (body + 1, body)) for body in range(bodies - 1)]
    return (*loads, *pairs)


def test_sums_by_body_are_those_of_one_entry_after_the_other():
    entries = _entries(7)
    rng = np.random.default_rng(3)
    stored = rng.normal(size=(4, 7))
    heat = rng.normal(size=(4, len(entries)))
    moved = np.abs(heat) + rng.random(heat.shape)
    into = np.zeros((4, 7))
    through = np.zeros((4, 7))
    mechanisms = np.zeros((4, 2))
    for column, (name, ends) in enumerate(entries):
        into[:, ends[-1]] += heat[:, column]
        through[:, ends[-1]] += moved[:, column]
        if len(ends) == 2:
            into[:, ends[0]] -= heat[:, column]
            through[:, ends[0]] += moved[:, column]
        else:
            mechanisms[:, ("sun", "air").index(name)] += heat[:, column]
    table = energy_table(
        entries,
        stored=jnp.asarray(stored),
        heat=jnp.asarray(heat),
        moved=jnp.asarray(moved),
        equalization=jnp.full(7, 0.5),
    )
    ends = EntryEnds.of(entries)
    np.testing.assert_allclose(ends.into_bodies(jnp.asarray(heat), 7), into)
    np.testing.assert_allclose(ends.into_bodies(jnp.asarray(heat[1]), 7), into[1])
    np.testing.assert_allclose(table.mechanisms, mechanisms)
    of_bodies = (stored - into) / (through + 0.5)
    np.testing.assert_allclose(table.relative_of_bodies, of_bodies)


def test_a_table_of_energies_holds_no_array_of_all_bodies_and_all_entries():
    """Its memory is in proportion to the number of bodies."""
    entries = _entries(500)

    def table(stored, heat):
        return energy_table(
            entries, stored, heat=heat, moved=heat, equalization=stored[0]
        )

    traced = jax.make_jaxpr(table)(jnp.ones((2, 500)), jnp.ones((2, len(entries))))
    sizes = [np.size(constant) for constant in traced.consts]
    sizes += [v.aval.size for line in traced.eqns for v in line.outvars]
    assert max(sizes) <= 3 * len(entries)
