"""A shorter way of JAX from a traced program to what XLA compiles, for the tests.

They compile some ten thousand programs, most of them a few operations long.
"""

import threading

import jax
import numpy as np
from jax._src import core
from jax._src.interpreters import mlir
from jaxlib.mlir import ir


MODULES_IN_A_CONTEXT = 100
"""Constants and types of all modules stay in their context: it is replaced in time."""


class _Contexts(threading.local):
    """Context of a thread and the number of modules that are still written in it."""

    context = None
    left = 0


def _inside_a_module() -> bool:
    try:
        return ir.Context.current is not None
    except ValueError:
        return False


def share_contexts() -> None:
    """Several modules share a context of MLIR: JAX makes one for each.

    To load all dialects takes 4 ms, as long as all else between the trace and XLA of a
    program of one operation. Private to JAX: where it is not there, nothing changes.
    """
    make = getattr(mlir, "make_ir_context", None)
    if make is None:
        return
    contexts = _Contexts()

    def context_of_thread():
        # What is computed while another module is written would land in it.
        if _inside_a_module():
            return make()
        if contexts.left == 0:
            contexts.context, contexts.left = make(), MODULES_IN_A_CONTEXT
        contexts.left -= 1
        return contexts.context

    mlir.make_ir_context = context_of_thread


def forget_places() -> None:
    """No operation says which lines of Python it comes from.

    The stack below a test is deep, and every module would hold all of it.
    """
    jax.config.update("jax_traceback_in_locations_limit", 0)


def put_arrays() -> None:
    """An array of numpy becomes one of JAX by a copy.

    `jnp.asarray` compiles the identity for every shape since it lifts what it is given
    into the trace; outside of one, that is half of the programs of a scene.
    """
    primitive = getattr(core, "stage_p", None)
    if primitive is None:
        return
    compiled = primitive.impl

    def put(value):
        if isinstance(value, np.ndarray):
            # Of its own: what is in the given one may change.
            return jax.device_put(value.copy())
        return compiled(value)

    primitive.def_impl(put)
