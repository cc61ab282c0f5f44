"""Loads of another scene as combinations of those of a reduced model."""

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .basis import Basis
from .linear_system import LinearSystem


_SAME = 1e-6
"""Relative difference of two patterns, operators or starts that are the same [-]."""


def check_same_bodies(system: LinearSystem, other_system: LinearSystem) -> None:
    """Refuse a scene that conducts, stores or loses heat differently.

    Raises:
        InputError: saying what differs.
    """
    remedy = "reduce() that scene by itself"
    same_shape = system.capacity.shape == other_system.capacity.shape
    same_shape = same_shape and system.area.shape == other_system.area.shape
    if not (
        same_shape and np.allclose(system.capacity, other_system.capacity, rtol=_SAME)
    ):
        raise InputError(f"reduced model: the scene has other bodies: {remedy}")
    if not np.allclose(system.reference, other_system.reference, rtol=1e-12):
        raise InputError(
            f"reduced model: the scene starts at another mean temperature: {remedy}"
        )
    # Equal for a vector of noise means equal: no conductance is left out.
    noise = np.random.default_rng(0).standard_normal(len(system.capacity))
    if not _is_same(system.conduct(noise), other_system.conduct(noise)):
        raise InputError(
            "reduced model: the scene has another conductivity, contact or coefficient "
            f"of heat transfer: {remedy}"
        )
    if not _is_same(system.read(noise), other_system.read(noise)):
        raise InputError(f"reduced model: the scene has another surface map: {remedy}")


def input_shares(
    system: LinearSystem, other_system: LinearSystem
) -> tuple[Float[np.ndarray, "k j"], list[int]]:
    """Amplitudes of the system's inputs that make one unit of each of another's.

    The second result lists the inputs of the other system that no combination makes.
    """
    # Heat at the nodes and excess at the surface must both agree.
    heat_scale = np.abs(system.heat).max(initial=0.0) or 1.0
    direct_scale = np.abs(system.direct).max(initial=0.0) or 1.0

    def stacked(system: LinearSystem) -> Float[np.ndarray, "ns k"]:
        return np.concatenate([system.heat / heat_scale, system.direct / direct_scale])

    patterns = stacked(system)
    scale = np.maximum(np.linalg.norm(patterns, axis=0), 1e-300)
    solution, *_ = np.linalg.lstsq(patterns / scale, stacked(other_system), rcond=None)
    shares = solution / scale[:, None]
    outside = []
    for column, share in enumerate(shares.T):
        same_heat = _is_same(system.heat @ share, other_system.heat[:, column])
        same_direct = _is_same(system.direct @ share, other_system.direct[:, column])
        if not (same_heat and same_direct):
            outside.append(column)
    return shares, outside


def start_in_span(
    system: LinearSystem,
    other_system: LinearSystem,
    basis: Basis,
    start: Float[np.ndarray, " m"],
) -> Float[np.ndarray, " m"]:
    """Modes at the start of another scene.

    Raises:
        InputError: if its start is no combination of the basis.
    """
    if _is_same(system.start, other_system.start):
        return start
    modes = basis.vectors.T @ (system.capacity * other_system.start)
    if not _is_same(basis.vectors @ modes, other_system.start):
        raise InputError(
            "reduced model: the start of the scene is not in its span: "
            "model.extend(scene) adds it"
        )
    return modes


def _is_same(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> bool:
    return bool(np.linalg.norm(a - b) <= _SAME * np.linalg.norm(b))
