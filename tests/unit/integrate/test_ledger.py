"""The ledger's running totals keep their digits over many small entries."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxthermo.integrate.ledger import empty_ledger


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
