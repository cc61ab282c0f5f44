"""Evaluation of a device's section while its neighbours' planes are being received.

First the whole section is evaluated next to empty planes, and then its two end planes
again, next to the received ones: bit by bit the values that follow from planes written
into the rim. Only the ends wait for the neighbours, so that a device with asynchronous
exchange computes meanwhile. And the state is only read: writing planes into it would
copy the whole lattice wherever it is read again afterwards, as RKL2 does.
"""

from collections.abc import Callable, Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..parallel.lattice import with_planes
from .stencil import AbstractStencil, end_planes


_Lattice = Float[Array, "x y z"]
_Planes = Float[Array, "2 y z"]
_Fields = Sequence[Float[Array, "..."]]
_Law = Callable[..., _Lattice]
"""`law(stencil, state, *fields)` returns a lattice. Fields are lattices and numbers and
act pointwise: cell i of the result uses cell i of each. The result may overwrite the
first field.
"""

_MIN_LENGTH = 5
"""Smallest length of a section's state that has more than its end planes [cells]."""


def apply_after_exchange(
    law: _Law,
    stencil: AbstractStencil,
    state: _Lattice,
    beyond: _Planes,
    fields: _Fields = (),
) -> _Lattice:
    """Law of a section with the neighbours' planes written into its rim."""
    return law(stencil, with_planes(state, 0, beyond), *fields)


def apply_overlapping_exchange(
    law: _Law,
    stencil: AbstractStencil,
    state: _Lattice,
    beyond: _Planes,
    fields: _Fields = (),
) -> _Lattice:
    """Law of a section, of which only the end planes depend on the exchange."""
    if len(state) < _MIN_LENGTH:
        return apply_after_exchange(
            law, stencil=stencil, state=state, beyond=beyond, fields=fields
        )
    end_fields = fields
    inner = law(stencil, state, *fields)
    if fields:
        # The ends are evaluated after the result may have overwritten the first field:
        # until then the result holds its values there. Otherwise XLA copies it.
        plane = jnp.arange(len(state))[:, None, None]
        is_end = (plane == 1) | (plane == len(state) - 2)
        inner = jnp.where(is_end, fields[0], inner)
        end_fields = [inner, *fields[1:]]
    # Two planes from each end. The inner two, which are adjacent only in this stack,
    # are evaluated too and discarded.
    end_state = jnp.concatenate([beyond[:1], state[1:3], state[-3:-1], beyond[1:]])
    end_fields = [end_planes(field, 3) if field.ndim else field for field in end_fields]
    ends = law(stencil.ends(), end_state, *end_fields)
    return with_planes(inner, depth=1, planes=ends[1::3])
