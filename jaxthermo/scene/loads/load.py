"""What acts on a body's surface, put together for the time loop and for reading."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ...arrays import members
from ...network.network import Address
from ...physics.surface_energy_balance import SurfaceTerms
from ..compile.bodies import HostAddress, PreparedBody
from ..compile.program import SurfaceReading
from .surface_load import SurfaceLoad


FEWEST_SPARE, MOST_SPARE = 16, 1024
"""Places come in multiples of a power of two between these."""


def _pick(address: HostAddress, nodes: Int[np.ndarray, " m"]) -> Address:
    return tuple(jnp.asarray(index[nodes]) for index in address)


def even_size(count: int) -> int:
    """The next size that processors share without a rest, at most 1/16 or 16 larger.

    XLA checks the bounds of every element of a loop that its threads do not divide
    evenly, and such a loop is not vectorized: several times slower.
    """
    most = max(count // 16, 1)
    step = min(max(1 << (most.bit_length() - 1), FEWEST_SPARE), MOST_SPARE)
    return -(-count // step) * step


def surface_load(
    one: PreparedBody,
    terms: SurfaceTerms,
    acts: list[Bool[np.ndarray, " s"]],
    group: Int[np.ndarray, " s"] | None = None,
) -> tuple[SurfaceLoad | None, Int[np.ndarray, " s"]]:
    """Fragments of one node with the same terms as one place; which place each is in.

    Args:
        one: the body.
        terms: on the fragments.
        acts: where each of them acts, at any time.
        group: of every fragment; those of different ones share no place.
    """
    nowhere = np.full(len(one.fragment_node), -1, np.int32)
    if not any(each.any() for each in acts):
        return None, nowhere
    signature = np.zeros(len(nowhere), np.int64) if group is None else group.astype(int)
    for each in acts:
        # Counted anew each time, so that any number of terms fits.
        signature = np.unique(2 * signature + each, return_inverse=True)[1].reshape(-1)
    touched = np.flatnonzero(np.any(acts, axis=0))
    signatures = signature.max() + 1
    key = one.fragment_node.astype(np.int64) * signatures + signature
    places, inverse = np.unique(key[touched], return_inverse=True)
    place = nowhere
    place[touched] = inverse.reshape(-1)
    nodes, node = np.unique(places // signatures, return_inverse=True)
    node = node.reshape(-1).astype(np.int32)
    where, count = _pick(one.address, nodes), even_size(len(places))
    load = SurfaceLoad(
        address=where,
        capacity=one.network.capacity_at(where),
        node=jnp.asarray(np.pad(node, (0, count - len(node)))),
        slots=tuple(jnp.asarray(slot) for slot in members(node, len(nodes))),
        terms=terms.coarsened(place, count),
    )
    return load, place


def surface_reading(
    one: PreparedBody, terms: SurfaceTerms, exposed_fraction: Float[np.ndarray, "*s"]
) -> SurfaceReading:
    """How every fragment's temperature is read.

    Args:
        one: the body.
        terms: on the fragments.
        exposed_fraction: part of each fragment that nothing touches.
    """
    nodes, node = np.unique(one.fragment_node, return_inverse=True)
    return SurfaceReading(
        address=_pick(one.address, nodes),
        node=jnp.asarray(node.reshape(-1).astype(np.int32)),
        terms=terms,
        exposed_fraction=jnp.asarray(exposed_fraction),
        surface_map=one.surface_map,
    )
