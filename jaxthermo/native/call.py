"""Loops that numba compiles as operations of JAX, within a compiled program.

The extra `native` installs numba. XLA calls these loops without the interpreter, and
copies nothing. Each loop has a reference in arrays.
"""

import importlib
from functools import cache
from typing import Any

import jax
import jaxlib.version
import numpy as np

from ..choices import Kernels
from ..errors import InputError
from ..extras import require_extra


def called(loop: str, results: Any, *arguments: Any, in_place: int = 0) -> Any:
    """Arrays that a loop fills, of the shapes and types of `results`.

    The loop is named by its module and function, such as "runs_loops.conduct", and is
    compiled for the precision of the first result. The last `in_place` arguments become
    the first results, and keep the values that the loop does not write.
    """
    like = jax.tree.leaves(results)[0]
    shapes = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape, a.dtype), results)
    first = len(arguments) - in_place
    return jax.ffi.ffi_call(
        _registered(loop, like.dtype.name),
        shapes,
        vmap_method="sequential",
        input_output_aliases={first + n: n for n in range(in_place)},
    )(*arguments)


def check_kernels(kernels: Kernels, where: str) -> None:
    """Check the name of kernels: "numba", or None for those of XLA.

    Raises:
        InputError: for any other.
    """
    if kernels not in (None, "numba"):
        raise InputError(f'{where}(kernels={kernels!r}): give "numba", or leave it out')


@cache
def require_native(feature: str) -> None:
    """Refuse where no loop can be compiled and called.

    Raises:
        InputError: without the package numba, where JAX computes on another device than
            a CPU, or if its version of XLA cannot call.
    """
    require_extra(f"{feature} needs", package="numba", extra="native")
    if jax.default_backend() != "cpu":
        raise InputError(
            f"{feature} runs on a CPU, and JAX computes on a {jax.default_backend()}: "
            "leave it out"
        )
    try:
        _try_call()
    except (jax.errors.JaxRuntimeError, ValueError) as error:
        raise InputError(
            f"{feature}: jaxlib {jaxlib.version.__version__} cannot call what numba "
            f"compiles ({str(error).splitlines()[0]}): leave it out"
        ) from error


def native_kernels() -> Kernels:
    """Kernels "numba" where they can be compiled and called, else None."""
    try:
        require_native("numba")
    except InputError:
        return None
    return "numba"


def _try_call() -> None:
    values = np.arange(3, dtype=np.float32)
    with jax.ensure_compile_time_eval():
        doubled = called("frame.double", values, values)
    if not np.array_equal(doubled, 2 * values):
        raise ValueError("wrong result")


@cache
def _registered(loop: str, dtype: str) -> str:
    """Name by which XLA knows a loop of a precision; compiled here, once."""
    module, function = loop.split(".")
    loops = importlib.import_module(f".{module}", __package__)
    frame = importlib.import_module(".frame", __package__)
    name = f"jaxthermo_{function}_{dtype}"
    address = frame.handler(getattr(loops, function), dtype)
    jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(address), platform="cpu")
    return name
