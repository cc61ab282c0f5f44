"""Evaluation of a device's section while the planes of its neighbours are on their way.

First all of the section, beside empty planes, and then its two end planes again, beside
those that have come: the same values to the bit as with the planes written into the
rim. Nothing but the ends waits for the neighbours, so that a device with asynchronous
exchange computes meanwhile. And the state is only read: planes that are written into it
make a copy of the whole lattice where another reads it afterwards, as RKL2 does.
"""

from collections.abc import Callable, Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..parallel.lattice import with_planes
from .stencil import AbstractStencil, end_planes


_Lattice = Float[Array, "x y z"]
_Planes = Float[Array, "2 y z"]
_Others = Sequence[Float[Array, "..."]]
_Law = Callable[..., _Lattice]
"""law(stencil, state, *others): a lattice. Others are lattices, of which a value counts
in its own cell only, and numbers. The result may take the place of the first of them.
"""

_MIN_LENGTH = 5
"""Smallest length of the state of a section that is not ends alone [cells]."""


def in_turn(
    law: _Law,
    stencil: AbstractStencil,
    state: _Lattice,
    beyond: _Planes,
    others: _Others = (),
) -> _Lattice:
    """Law of a section with the planes beyond it in its rim."""
    return law(stencil, with_planes(state, 0, beyond), *others)


def overlapped(
    law: _Law,
    stencil: AbstractStencil,
    state: _Lattice,
    beyond: _Planes,
    others: _Others = (),
) -> _Lattice:
    """The values of `in_turn`, of which only the end planes depend on those beyond."""
    if len(state) < _MIN_LENGTH:
        return in_turn(law, stencil=stencil, state=state, beyond=beyond, others=others)
    inner = law(stencil, state, *others)
    if others:
        # The ends are evaluated after the first of the others may be overwritten: there
        # the result has its values until then. Else the lattice is copied.
        plane = jnp.arange(len(state))[:, None, None]
        is_end = (plane == 1) | (plane == len(state) - 2)
        inner = jnp.where(is_end, others[0], inner)
        others = inner, *others[1:]
    # Two planes from each end. Of these the inner ones, which lie beside each other
    # there, are evaluated for nothing.
    around = jnp.concatenate([beyond[:1], state[1:3], state[-3:-1], beyond[1:]])
    theirs = [end_planes(other, 3) if other.ndim else other for other in others]
    return with_planes(inner, 1, law(stencil.ends(), around, *theirs)[1::3])
