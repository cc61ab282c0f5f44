"""Double precision where a scene asks for it, without touching a global switch."""

import contextlib

import jax


def precision(dtype: str) -> contextlib.AbstractContextManager:
    """A context in which arrays of `dtype` can be made."""
    return jax.enable_x64(True) if dtype == "float64" else contextlib.nullcontext()
