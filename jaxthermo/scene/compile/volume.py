"""Heat released inside bodies, put together for the time loop."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from ...physics.heat_source import HeatSource, VolumeBinding
from ...physics.term import Omitted
from ...physics.time_varying import for_jit
from ..receipt import Omission
from ..scene import Scene
from .bodies import PreparedBody
from .program import VolumeLoad


def bind_volumes(
    scene: Scene, names: tuple[str, ...]
) -> tuple[dict[tuple[int, int], VolumeBinding], list[Omission]]:
    """What each source reaches, by its number and the body's; what it does not."""
    found, omitted = {}, []
    for number, term in enumerate(scene.terms):
        if not isinstance(term, HeatSource):
            continue
        for index, body in enumerate(scene.bodies):
            result = term.bind_volume(body.structure, index)
            if isinstance(result, Omitted):
                where = f" on body {index}" if len(scene.bodies) > 1 else ""
                omitted.append(Omission(names[number] + where, result.reason))
            else:
                found[number, index] = result
    return found, omitted


def volume_load(
    entry: int, found: VolumeBinding, one: PreparedBody, dtype: Any
) -> VolumeLoad:
    """Heat of one source in one body.

    Args:
        entry: in the ledger.
        found: what the source reaches.
        one: the body.
        dtype: of the state.
    """
    nodes = np.flatnonzero(found.volume)
    address = tuple(jnp.asarray(index[nodes]) for index in one.address)
    reached = np.asarray(found.volume[nodes], dtype)
    return VolumeLoad(
        entry=entry,
        address=address,
        rise=jnp.asarray(reached) / one.network.capacity_at(address),
        volume=jnp.asarray(reached.sum(dtype=float), dtype),
        heat_rate_density=for_jit(found.heat_rate_density, dtype),
    )
