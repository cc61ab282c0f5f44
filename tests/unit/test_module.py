"""Modules of the host: pytrees whose methods are those of plain objects."""

import types

import jax
import numpy as np
from equinox import Module

import jaxthermo as jt
from jaxthermo.module import AbstractHostModule


class _Length(AbstractHostModule):
    metres: float

    def doubled(self) -> float:
        return 2 * self.metres


class _PlainLength(Module):
    metres: float

    def doubled(self) -> float:
        return 2 * self.metres


def test_naming_a_method_makes_no_pytree():
    assert isinstance(_Length(1.5).doubled, types.MethodType)
    assert not isinstance(_PlainLength(1.5).doubled, types.MethodType)
    assert isinstance(jt.Pose().rotate, types.MethodType)


def test_a_module_of_the_host_is_a_pytree():
    assert jax.tree.leaves(_Length(1.5)) == [1.5]
    assert jax.tree.map(lambda leaf: 2 * leaf, _Length(1.5)).doubled() == 6.0
    assert float(jax.grad(lambda length: length.doubled())(_Length(1.5)).metres) == 2.0
    np.testing.assert_array_equal(jax.vmap(_Length(1.5).doubled, axis_size=2)(), [3, 3])
