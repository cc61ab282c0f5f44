"""Order of values by groups of bodies, and by the bodies of a scene."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int, Shaped

from ..arrays import consecutive, device_array, taken


class GroupOrder(Module):
    """Order of the fragments of all groups, and of those of the bodies of a scene."""

    of_groups: Int[Array, " s"]
    """Fragment of the scene of each fragment of the groups, one after the other."""
    of_scene: Int[Array, " s"]
    """Its inverse."""


def group_order(
    numbers: Sequence[int], counts: Sequence[int]
) -> tuple[Int[np.ndarray, " s"], GroupOrder | None]:
    """Return the fragments of bodies that are listed by group, as scene and as order.

    Args:
        numbers: in the scene, of the bodies of one group after the other.
        counts: numbers of their fragments.

    Returns:
        The fragment of the scene of each of these, and the order, None if it is that of
        the scene.
    """
    sizes = np.zeros(len(numbers), int)
    sizes[list(numbers)] = counts
    slices = consecutive(sizes.tolist())
    index = np.concatenate(
        [np.arange(slices[n].start, slices[n].stop, dtype=np.int32) for n in numbers]
    )
    if (np.diff(numbers) > 0).all():
        return index, None
    inverse = np.argsort(index).astype(np.int32)
    return index, GroupOrder(device_array(index), device_array(inverse))


def apart(
    values: Shaped[Array, " s"], counts: Sequence[int], order: GroupOrder | None
) -> list[Shaped[Array, " _"]]:
    """Return the values of each group, from those in the order of the scene."""
    if order is not None:
        values = taken(values, order.of_groups)
    if len(counts) == 1:
        return [values]
    return [values[fragments] for fragments in consecutive(counts)]


def together(
    values: Sequence[Float[Array, " _"]], order: GroupOrder | None
) -> Float[Array, " s"]:
    """Return the values of all groups in the order of the scene."""
    joined = values[0] if len(values) == 1 else jnp.concatenate(values)
    return joined if order is None else taken(joined, order.of_scene)
