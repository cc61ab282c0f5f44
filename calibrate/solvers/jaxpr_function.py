"""A function traced once, with the arrays that it closes over as arguments.

A simulation closes over tables of links as long as the body; as constants of a compiled
program XLA would try to fold them, and each derivative would be traced from the start.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.extend.core import ClosedJaxpr, jaxpr_as_fun


class Traced(eqx.Module):
    """A function as its program and its constants."""

    constants: tuple[jax.Array, ...]
    program: Any = eqx.field(static=True)
    outputs: Any = eqx.field(static=True)

    def __call__(self, *args: Any) -> Any:
        """What the function gives."""
        run = jaxpr_as_fun(ClosedJaxpr(self.program, self.constants))
        found = run(*jax.tree.leaves(args))
        return jax.tree.unflatten(self.outputs, found)


def trace(function: Callable[..., Any], *args: Any) -> Traced:
    """The function, for arguments of these shapes.

    Args:
        function: of arrays, or pytrees of them.
        args: such as it will be called with.
    """
    closed, shapes = jax.make_jaxpr(function, return_shape=True)(*args)
    constants = tuple(jnp.asarray(value) for value in closed.consts)
    return Traced(constants, closed.jaxpr, jax.tree.structure(shapes))
