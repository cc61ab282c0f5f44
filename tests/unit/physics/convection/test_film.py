"""Exchange by the film temperature: the fast law against the formula."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxthermo.physics.convection.air import FILM_TEMPERATURES, film_polynomial, horner
from jaxthermo.physics.convection.cross_flow import _mean_coefficient
from jaxthermo.physics.convection.film import (
    FilmExchange,
    _SpeedTable,
    speed_nodes,
    speed_table,
)
from jaxthermo.physics.convection.nusselt import AVERAGES


DIAMETERS = np.array([1e-4, 1e-3, 1e-2, 0.1, 1.0])
SURFACES = np.linspace(200.0, 600.0, 41)
TIME = jnp.zeros(())
SWAPPED = np.array([0, 2, 1, 4, 3])


@eqx.filter_jit
def direct(average, speed, diameter, film):
    return _mean_coefficient(speed, diameter=diameter, film=film, average=average)


def law(average, speed, air):
    """One surface cell for each diameter."""
    shape = (len(DIAMETERS), len(FILM_TEMPERATURES))
    film = np.broadcast_to(FILM_TEMPERATURES, shape)
    width = np.broadcast_to(DIAMETERS[:, None], shape)
    h = direct(
        average,
        speed=jnp.full(shape, speed),
        diameter=jnp.asarray(width),
        film=jnp.asarray(film),
    )
    return FilmExchange(film_polynomial(h).T, jnp.asarray(air), jnp.asarray(250.0))


@eqx.filter_jit
def evaluated(law, surface, time=TIME):
    """Flux and slope at surface temperatures [q], of every cell."""

    def at(theta):
        cell_theta = jnp.full(len(DIAMETERS), theta)
        return law.flux(time, cell_theta), law.slope(time, cell_theta)

    return jax.vmap(at)(surface - law.reference)


@eqx.filter_jit
def steepest_of(law, hottest):
    return law.max_slope(jnp.asarray(hottest), 10.0)


@eqx.filter_jit
def with_slopes(law, surface):
    """Total heat, and its slopes by air and surface temperatures [q]."""

    def heat(air, surface):
        moved = eqx.tree_at(lambda l: l.temperature, law, air)
        return moved.flux(TIME, jnp.full(len(DIAMETERS), surface - 250.0)).sum()

    with_gradient = jax.value_and_grad(heat, (0, 1))
    return jax.vmap(with_gradient, (None, 0))(law.temperature, surface)


@pytest.mark.parametrize(
    ("average", "error"),
    list(zip(AVERAGES, (8e-4, 2.1e-2, 2.1e-2), strict=True)),
    ids=lambda value: getattr(value, "name", ""),
)
def test_it_follows_the_correlation_at_each_film_temperature(average, error):
    """From Re 6e-2 to 3e5, surfaces at 200 to 600 K in air of 220 to 500 K."""
    worst = 0.0
    for speed in (0.01, 1.0, 5.0):
        for air in (220.0, 295.0, 500.0):
            flux, _ = evaluated(law(average.nusselt, speed, air), jnp.asarray(SURFACES))
            shape = (len(SURFACES), len(DIAMETERS))
            film = np.broadcast_to((SURFACES + air)[:, None] / 2, shape)
            width = np.broadcast_to(DIAMETERS, shape)
            exact = direct(
                average.nusselt,
                speed=jnp.full(shape, speed),
                diameter=jnp.asarray(width),
                film=jnp.asarray(film),
            )
            h = (
                np.asarray(flux)
                / np.where(air == SURFACES, np.nan, air - SURFACES)[:, None]
            )
            worst = max(worst, np.nanmax(np.abs(h / np.asarray(exact) - 1)))
    assert 0.1 * error < worst < error


def test_nothing_flows_at_the_airs_own_temperature():
    exchange = law(AVERAGES[0].nusselt, 2.0, 300.0)
    flux, slope = evaluated(exchange, jnp.full(len(SURFACES), 300.0))
    assert not np.asarray(flux).any()
    assert (np.asarray(slope) > 0).all()


def test_the_slope_is_that_of_the_flux_and_below_the_steepest():
    exchange = law(AVERAGES[0].nusselt, 2.0, 300.0)
    surface = jnp.asarray(np.linspace(5.0, 2500.0, len(SURFACES)))
    slope = np.asarray(evaluated(exchange, surface)[1])
    above, _ = evaluated(exchange, surface + 1e-3)
    below, _ = evaluated(exchange, surface - 1e-3)
    rise = np.asarray(above - below) / 2e-3
    assert_allclose(slope, -rise, rtol=1e-6)
    assert (slope > 0).all()
    steepest = float(steepest_of(exchange, 2500.0))
    assert slope.max() <= steepest < 2 * slope.max()


def test_gradients_by_both_temperatures_are_finite_and_right():
    base = law(AVERAGES[0].nusselt, 2.0, 300.0)
    step = 1e-3
    surface = np.array([0.0, 5.0, 290.0, 300.0, 1699.0, 5800.0])

    def heat(surface, air=300.0):
        moved = eqx.tree_at(lambda l: l.temperature, base, jnp.array(air))
        return with_slopes(moved, jnp.asarray(surface))[0]

    by_air = (heat(surface, 300 + step) - heat(surface, 300 - step)) / (2 * step)
    by_surface = (heat(surface + step) - heat(surface - step)) / (2 * step)
    slopes = with_slopes(base, jnp.asarray(surface))[1]
    assert_allclose(slopes[0], by_air, rtol=1e-5)
    assert_allclose(slopes[1], by_surface, rtol=1e-5)


def test_single_precision_keeps_small_differences():
    exchange = law(AVERAGES[0].nusselt, 2.0, 300.0)
    single = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), exchange)
    surface = jnp.asarray(np.array([300.001]), jnp.float32)
    flux, _ = evaluated(single, surface, jnp.zeros((), jnp.float32))
    assert flux.dtype == jnp.float32
    exact, _ = evaluated(exchange, surface.astype(float))
    assert_allclose(flux, exact, rtol=2e-6)


def test_places_are_merged_by_their_mean_coefficient():
    exchange = law(AVERAGES[0].nusselt, 2.0, 300.0)

    # The first cell twice, then the mean of the next two, and so on.
    def mean(row):
        return (jnp.asarray(row) + jnp.asarray(row)[SWAPPED]) / 2

    merged = exchange.coarsened(mean)
    surface = jnp.asarray(SURFACES)
    separate, _ = evaluated(exchange, surface)
    flux, _ = evaluated(merged, surface)
    assert_allclose(flux, np.stack([mean(q) for q in separate]), rtol=1e-12)


def test_a_speed_table_is_exact_at_its_nodes_and_smooth_between():
    nodes = speed_nodes(8.0, 25, np.float64)
    assert nodes[0] == pytest.approx(0.0, abs=1e-18) and nodes[-1] == pytest.approx(8.0)
    values = np.sqrt(nodes)[:, None, None] * np.ones((1, 2, 3))
    table = speed_table(values, 8.0, lambda t: t)
    at = jax.jit(jax.vmap(jax.value_and_grad(lambda t: table(t)[0, 0])))
    value, _ = at(jnp.asarray(nodes))
    assert_allclose(value, np.sqrt(nodes), atol=1e-12)
    between = np.array([0.05, 0.4, 1.3, 7.0, -1.0, 0.0, 99.0])
    value, slope = at(jnp.asarray(np.resize(between, 25)))
    above, _ = at(jnp.asarray(np.resize(between + 1e-5, 25)))
    below, _ = at(jnp.asarray(np.resize(between - 1e-5, 25)))
    assert_allclose(value[:4], np.sqrt(between[:4]), rtol=1e-3)
    rise = (above - below) / 2e-5
    assert_allclose(slope[:4], rise[:4], rtol=1e-5)
    # Held beyond its ends, with finite slopes at them.
    assert value[4] == value[5] and value[6] == pytest.approx(np.sqrt(8.0))
    assert np.isfinite(slope).all()


def test_the_steepest_of_a_table_bounds_every_speed():
    nodes = speed_nodes(8.0, 25, np.float64)
    rows = [law(AVERAGES[0].nusselt, float(v), 300.0).coefficients for v in nodes]
    table = speed_table(np.stack(rows), 8.0, lambda t: t)
    exchange = FilmExchange(table, jnp.asarray(300.0), jnp.asarray(250.0))
    assert isinstance(exchange.coefficients, _SpeedTable)
    surface = jnp.asarray(SURFACES)
    top = max(
        float(evaluated(exchange, surface, jnp.asarray(t))[1].max())
        for t in np.linspace(0.0, 8.0, 9)
    )
    steepest = float(steepest_of(exchange, 600.0))
    assert top <= steepest < 2 * top


def test_the_polynomial_goes_through_its_nodes():
    values = jnp.asarray(np.array([3.0, 1.0, 4.0, 1.5, 9.0]))
    rows = film_polynomial(values)
    places = np.cos((np.arange(5) + 0.5) * np.pi / 5)
    assert_allclose(horner(rows, jnp.asarray(places))[0], values, rtol=1e-12)


@pytest.mark.parametrize("speeds", [3, 25])
def test_a_table_of_any_length_is_selected_by_one_operation(speeds):
    values = np.random.default_rng(0).normal(size=(speeds, 5, 4))
    table = speed_table(values, 8.0, lambda t: t)
    cells = np.array([3, 0])

    def select(rows):
        law = FilmExchange(eqx.tree_at(lambda t: t.table, table, rows), 300.0)
        return law.coarsened(lambda row: row[..., cells]).coefficients.table

    # On the host row by row, in a program at once.
    assert_allclose(select(table.table), table.table[..., cells], rtol=0)
    assert_allclose(jax.jit(select)(table.table), table.table[..., cells], rtol=0)
    assert len(jax.make_jaxpr(select)(table.table).eqns) < 12
