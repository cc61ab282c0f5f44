"""Properties that vary with temperature: what they give and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from jaxthermo.errors import InputError
from jaxthermo.material.material import Material, Property


def test_piecewise_linear_and_constant_outside():
    k = Property([300, 400, 500], [10, 20, 16])
    assert [k(t) for t in (0, 300, 350, 450, 900)] == [10, 10, 15, 18, 16]
    assert_allclose(k(np.array([320.0, 480.0])), [12.0, 16.8])


@pytest.mark.parametrize(
    ("temperatures", "values", "says"),
    [
        ([300, 400], [1.0, -2.0], "goes negative, -2 at 400 K: give positive"),
        ([300, 400], [0.0, 2.0], "is no positive number, 0 at 300 K"),
        ([300, 400], [1.0, np.nan], "no positive number, nan at 400 K"),
        ([300, 300], [1.0, 2.0], "must increase"),
        ([-1, 300], [1.0, 2.0], "in kelvin"),
        ([300, np.inf], [1.0, 2.0], "in kelvin"),
        ([300, 400], [1.0], "two lists of the same length"),
        ([], [], "two lists of the same length"),
        ([[300]], [[1.0]], "two lists of the same length"),
        ([300, 400], ["much", 2.0], "are not numbers"),
    ],
)
def test_mistakes_are_one_line(temperatures, values, says):
    with pytest.raises(InputError, match=says) as told:
        Property(temperatures, values)
    assert "\n" not in str(told.value)


def test_a_traced_table_is_told_by_its_number_when_negative():
    with pytest.raises(InputError, match="goes negative, -1 value 1"):
        jax.jit(lambda t: Property(t, [1.0, -1.0])(350.0))(jnp.array([300.0, 400.0]))


def test_traced_values_and_their_derivatives():
    def at(values):
        return Property([300.0, 400.0], values)(325.0)

    value = jax.jit(jax.grad(at))(jnp.array([10.0, 20.0]))
    assert_allclose(value, [0.75, 0.25])
    by_parts = jax.grad(lambda k: Property([300.0, 400.0], [k, 2 * k])(350.0))(3.0)
    assert float(by_parts) == 1.5


def test_a_material_at_one_temperature():
    iron = Material(
        Property([300, 600], [80.0, 50.0]), 7870.0, Property([300, 600], [450, 570])
    )
    assert iron.varies and not Material(1.0, 1.0, 1.0).varies
    warm = iron.at(400.0)
    assert (warm.conductivity, warm.specific_heat) == (70.0, 490.0)
    assert not warm.varies and warm.density == 7870.0
    assert warm.diffusivity == pytest.approx(70.0 / (7870.0 * 490.0))
    assert warm.at(500.0) is warm


@pytest.mark.parametrize(
    ("material", "field", "says"),
    [
        (Material(Property([300], [1.0]), 1.0, 1.0), "diffusivity", "conductivity dep"),
        (Material(1.0, 1.0, Property([300], [1.0])), "effusivity", "specific_heat dep"),
        (Material((1.0, 2.0, 3.0), 1.0, 1.0), "diffusivity", "differs by axis"),
    ],
)
def test_what_is_no_one_number_says_so(material, field, says):
    with pytest.raises(InputError, match=says):
        getattr(material, field)


@pytest.mark.parametrize(
    ("conductivity", "says"),
    [
        ((1.0, 2.0), "got 2 numbers; give one, or three"),
        ((1.0, -2.0, 3.0), "conductivity along y=-2.0: give a positive"),
        ((1.0, 2.0, np.nan), "conductivity along z=nan"),
        (jnp.array([0.0, 1.0, 1.0]), "conductivity along x=0.0"),
    ],
)
def test_three_conductivities_are_checked(conductivity, says):
    with pytest.raises(InputError, match=says):
        Material(conductivity, 1.0, 1.0)


def test_three_conductivities_may_be_a_list_or_an_array():
    assert Material([1.0, 2.0, 3.0], 1.0, 1.0).conductivity == (1.0, 2.0, 3.0)
    assert Material(jnp.array([1.0, 2.0, 3.0]), 1.0, 1.0).conductivity == (1, 2, 3)
    second = jax.grad(lambda k: jnp.asarray(Material(k, 1.0, 1.0).conductivity)[1])
    assert_array_equal(second(jnp.array([1.0, 2.0, 3.0])), [0, 1, 0])
