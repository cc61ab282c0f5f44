"""Whether a value has a number yet."""

from typing import Any

import jax
import jax.core


def is_traced(tree: Any) -> bool:
    """Whether anything in a pytree is being differentiated, mapped or compiled."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))
