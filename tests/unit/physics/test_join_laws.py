"""A joined law is every body's own law on its own places."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.physics.boundary import Exchange, ImposedFlux
from jaxthermo.physics.convection.film import FilmExchange, speed_table
from jaxthermo.physics.convection.free_convection import FreeExchange
from jaxthermo.physics.join_laws import can_join, join_laws
from jaxthermo.physics.radiation.emission import Emission
from jaxthermo.physics.radiation.radiative_exchange import Radiation
from jaxthermo.physics.time_varying import Table


PLACES = (3, 2, 4)
number = jnp.asarray
RAMP = Table([0.0, 5.0], [280.0, 290.0])


def speed(time):
    return 1.0 + time


def _film(count, reference, table=False):
    chance = np.random.default_rng(count)
    rows = chance.uniform(5, 10, (5, count))
    if table:
        nodes = chance.uniform(5, 10, (25, 5, count))
        rows = speed_table(nodes, number(9.0), speed)
    return FilmExchange(rows, number(285.0), number(reference))


def _free(count, reference):
    chance = np.random.default_rng(count)
    still, rising = chance.uniform(1, 2, (2, count))
    root, rise = np.linspace(0.1, 0.2, 5), np.linspace(3.0, 4.0, 5)
    return FreeExchange(still, rising, root, rise, number(285.0), number(reference))


LAWS = {
    "flux": lambda n, reference: ImposedFlux(number(100.0)),
    "exchange": lambda n, reference: Exchange(number(9.0), RAMP, number(reference)),
    "own air": lambda n, air: Exchange(number(9.0), number(air), number(1.0)),
    "emission": lambda n, reference: Emission(number(280.0), number(reference)),
    "film": _film,
    "film by speed": lambda n, reference: _film(n, reference, table=True),
    "free": _free,
    "radiation": lambda n, reference: Radiation(
        number(30.0), number(300.0), number(reference)
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_on_its_own_places(name):
    made = [LAWS[name](n, 290.0 + n) for n in PLACES]
    laws = [(made[0],), None, (made[2],)]
    assert can_join([laws[0], laws[2]])
    (joined,) = join_laws(laws, PLACES)
    theta, time = jnp.linspace(-20.0, 30.0, sum(PLACES)), number(2.0)
    assert np.isfinite(joined.flux(time, theta)).all()
    for law, at in ((made[0], slice(0, 3)), (made[2], slice(5, 9))):
        for value in ("flux", "slope"):
            all_of_it = jnp.broadcast_to(
                getattr(joined, value)(time, theta), theta.shape
            )
            own = jnp.broadcast_to(
                getattr(law, value)(time, theta[at]), theta[at].shape
            )
            np.testing.assert_allclose(all_of_it[at], own, rtol=1e-14)


def test_equal_numbers_stay_one():
    made = [(_free(n, 290.0),) for n in PLACES]
    (joined,) = join_laws(made, PLACES)
    shapes = [np.shape(leaf) for leaf in jax.tree.leaves(joined)]
    assert shapes == [(9,), (9,), (5,), (5,), (), ()]


def test_what_differs_at_one_moment_is_repeated_at_all():
    """Programs of all moments have one shape."""
    moments = lambda *air: tuple(
        Exchange(number(9.0), number(t), number(300.0)) for t in air
    )
    joined = join_laws([moments(280.0, 280.0), moments(280.0, 290.0)], (2, 1))
    assert [jax.tree.leaves(law)[1].tolist() for law in joined] == [
        [280.0, 280.0, 280.0],
        [280.0, 280.0, 290.0],
    ]


def test_functions_and_tables_that_differ_stay_apart():
    law = lambda air: (Exchange(number(9.0), air, number(300.0)),)
    other = Table([0.0, 5.0], [280.0, 291.0])
    assert can_join([law(RAMP), law(Table([0.0, 5.0], [280.0, 290.0]))])
    assert can_join([law(speed), law(speed)])
    assert not can_join([law(RAMP), law(other)])
    assert not can_join([law(speed), law(lambda time: 2 * time)])
    assert not can_join([law(RAMP), law(number(280.0))])
    assert not can_join([law(RAMP), (Emission(RAMP, number(300.0)),)])
