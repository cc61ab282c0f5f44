"""Loads of another scene as combinations of those that a reduced model knows."""

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .basis import Basis
from .linear_system import LinearSystem


_SAME = 1e-6
"""Relative difference of two patterns, operators or starts that are the same [-]."""


def check_same_bodies(own: LinearSystem, other: LinearSystem) -> None:
    """Refuse a scene that conducts, stores or loses heat differently.

    Raises:
        InputError: saying what differs.
    """
    remedy = "reduce() that scene by itself"
    same_shape = own.capacity.shape == other.capacity.shape
    same_shape = same_shape and own.area.shape == other.area.shape
    if not (same_shape and np.allclose(own.capacity, other.capacity, rtol=_SAME)):
        raise InputError(f"reduced model: the scene has other bodies: {remedy}")
    if not np.allclose(own.reference, other.reference, rtol=1e-12):
        raise InputError(
            f"reduced model: the scene starts at another mean temperature: {remedy}"
        )
    # Equal for a vector of noise means equal: no conductance is left out.
    noise = np.random.default_rng(0).standard_normal(len(own.capacity))
    if not _is_same(own.conduct(noise), other.conduct(noise)):
        raise InputError(
            "reduced model: the scene has another conductivity, contact or coefficient "
            f"of heat transfer: {remedy}"
        )
    if not _is_same(own.read(noise), other.read(noise)):
        raise InputError(f"reduced model: the scene has another surface map: {remedy}")


def input_shares(
    own: LinearSystem, other: LinearSystem
) -> tuple[Float[np.ndarray, "k j"], list[int]]:
    """Amplitudes of own inputs by one unit of each of another scene's.

    And the other's inputs that are no combination of own ones.
    """
    # Heat at the nodes and excess at the surface must both agree.
    sizes = [np.abs(each).max(initial=0.0) or 1.0 for each in (own.heat, own.direct)]
    stacked = lambda of: np.concatenate([of.heat / sizes[0], of.direct / sizes[1]])
    mine, theirs = stacked(own), stacked(other)
    scale = np.maximum(np.linalg.norm(mine, axis=0), 1e-300)
    shares = np.linalg.lstsq(mine / scale, theirs, rcond=None)[0] / scale[:, None]
    outside = [
        column
        for column in range(theirs.shape[1])
        if not (
            _is_same(own.heat @ shares[:, column], other.heat[:, column])
            and _is_same(own.direct @ shares[:, column], other.direct[:, column])
        )
    ]
    return shares, outside


def start_in_span(
    own: LinearSystem,
    other: LinearSystem,
    basis: Basis,
    start: Float[np.ndarray, " m"],
) -> Float[np.ndarray, " m"]:
    """Modes at the start of another scene.

    Raises:
        InputError: if its start is no combination of the basis.
    """
    if _is_same(own.start, other.start):
        return start
    found = basis.vectors.T @ (own.capacity * other.start)
    if not _is_same(basis.vectors @ found, other.start):
        raise InputError(
            "reduced model: the start of the scene is not in its span: "
            "model.extend(scene) adds it"
        )
    return found


def _is_same(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> bool:
    return bool(np.linalg.norm(a - b) <= _SAME * np.linalg.norm(b))
