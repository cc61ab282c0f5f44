"""Conduction as one linear JAX primitive that is its own transpose.

Node i receives G_ij (T_j - T_i) from node j with G symmetric, so the transpose of
conduction is conduction of the cotangent, by the same fused loop. JAX would instead
transpose every slice, pad and gather, several times slower, and keep an array for each.
Forward mode, reverse mode and any mixture of the two are those of JAX: the primitive
is linear in the state and linear in the conductances, and says so. Where a link has an
entry for each of its ends, second derivatives hold for both together, not for one.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Float


class Operator(NamedTuple):
    """Functions of a state, of factors and of a layout that define conduction.

    A state is zero where there is no node. The change is proportional to the factors;
    the layout holds arrays that nothing is differentiated by.
    """

    change: Callable[..., Float[Array, "..."]]
    """change(state, factors, layout): bilinear, and symmetric in the state."""
    step: Callable[..., Float[Array, "..."]]
    """step(state, factors, layout): state plus change, in one loop."""
    inside: Callable[..., Float[Array, "..."]]
    """inside(values, layout): zero where there is no node."""
    pull: Callable[..., Any]
    """pull(values, state, factors, layout): derivative of the sum of values times
    change by each factor; values are zero where there is no node."""


def conduct(
    operator: Operator,
    state: Float[Array, "..."],
    factors: Any,
    layout: Any,
) -> Float[Array, "..."]:
    """Change of a state of all nodes; factors and layout as `Operator` says."""
    return _bind(
        operator.change, operator=operator, state=state, factors=factors, layout=layout
    )


def conduct_step(
    operator: Operator,
    state: Float[Array, "..."],
    factors: Any,
    layout: Any,
) -> Float[Array, "..."]:
    """State plus change, for the arguments of `conduct`."""
    return _bind(
        operator.step, operator=operator, state=state, factors=factors, layout=layout
    )


def computed_once(values: Float[Array, "..."]) -> Float[Array, "..."]:
    """Values that a compiler does not recompute for each neighbour."""
    # XLA moves cheap operations into the loop that reads them, once for every read. A
    # division is not cheap; the barrier hides that this one is by 1.
    row = (1,) * (values.ndim - 1) + values.shape[-1:]
    unit = jnp.ones(row, values.dtype)
    return values / jax.lax.optimization_barrier(unit)


def _bind(function, operator, state, factors, layout):
    values, tree = jax.tree.flatten((factors, layout))
    count = len(jax.tree.leaves(factors))
    return _conduction.bind(
        state, *values, function=function, operator=operator, tree=tree, count=count
    )


_conduction = Primitive("conduction")


def _plain(state, *values, function, operator, tree, count):
    del operator, count
    return function(state, *jax.tree.unflatten(tree, values))


def _shape(state, *values, **params):
    del values, params
    return state.update(weak_type=False)


def _jvp(primals, tangents, *, function, operator, tree, count):
    state, *values = primals
    along_state, *along_values = tangents
    parameters = {"operator": operator, "tree": tree, "count": count}
    out = _conduction.bind(*primals, function=function, **parameters)
    along = ad.Zero(jax.typeof(out).to_tangent_aval())
    if not isinstance(along_state, ad.Zero):
        along = _conduction.bind(along_state, *values, function=function, **parameters)
    moved = along_values[:count]
    if not all(isinstance(value, ad.Zero) for value in moved):
        moved = [ad.instantiate_zeros(value) for value in moved]
        change = _conduction.bind(
            state, *moved, *values[count:], function=operator.change, **parameters
        )
        along = ad.add_tangents(along, change)
    return out, along


def _transpose(cotangent, state, *values, function, operator, tree, count):
    nothing = [None] * (1 + len(values))
    if isinstance(cotangent, ad.Zero):
        return nothing
    linear = [ad.is_undefined_primal(value) for value in values]
    values_or_zeros = [
        jnp.zeros(value.aval.shape, value.aval.dtype) if is_linear else value
        for is_linear, value in zip(linear, values, strict=True)
    ]
    factors, layout = jax.tree.unflatten(tree, values_or_zeros)
    inside = operator.inside(cotangent, layout)
    if ad.is_undefined_primal(state):
        out = _bind(
            function,
            operator=operator,
            state=computed_once(inside),
            factors=factors,
            layout=layout,
        )
        # Values outside the nodes are unchanged.
        outside = cotangent - inside if function is operator.step else 0
        return [out + outside, *nothing[1:]]
    pulled = jax.tree.leaves(operator.pull(inside, state, factors, layout))
    gradients = [
        gradient if is_linear else None
        for is_linear, gradient in zip(linear[:count], pulled, strict=True)
    ]
    return [None, *gradients, *nothing[count + 1 :]]


def _batch(values, axes, **params):
    return jax.vmap(partial(_plain, **params), axes)(*values), 0


_conduction.def_impl(
    jax.jit(_plain, static_argnames=("function", "operator", "tree", "count"))
)
_conduction.def_abstract_eval(_shape)
mlir.register_lowering(_conduction, mlir.lower_fun(_plain, multiple_results=False))
ad.primitive_jvps[_conduction] = _jvp
ad.primitive_transposes[_conduction] = _transpose
batching.primitive_batchers[_conduction] = _batch
