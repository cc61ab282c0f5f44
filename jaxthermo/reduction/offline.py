"""The offline part of a reduced model: basis, choice of its size, error, matrices."""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..accuracy.surface_error import error_span
from ..archive import arrays_checksum
from ..errors import InputError
from ..integrate.run.schedule import checked_save_times
from ..physics.time_varying import is_unknown_function
from ..scene.scene import Scene
from .basis import (
    Basis,
    Projection,
    krylov_blocks,
    principal_weights,
    project,
    surface_gram,
)
from .linear_system import LinearSystem, linear_system
from .modal_run import Schedule, host_run, schedule
from .reduced_file import About, LoadRange
from .reduced_model import ReducedModel, knots_of
from .residual_bound import error_bound


MAX_BLOCKS = 25
"""Blocks of Krylov vectors at most; with two inputs and a start some 75 solves."""
_KRYLOV_MARGIN = 0.1
"""Error of the large basis over the tolerance, so that it can judge the small one."""
_RANGE = (0.005, 0.995)
"""Quantiles of the surface's temperature between which its range lies."""

Log = Callable[[str], None]


class Target(NamedTuple):
    """The run that the model is made for."""

    system: LinearSystem
    times: tuple[float, ...]
    """Save times [s]."""
    knots: tuple[float, ...]
    """Times between which loads are linear [s]."""
    amplitudes: Float[np.ndarray, "q k"]
    """Amplitude of each input at each knot."""
    plan: Schedule
    ranges: tuple[tuple[float, float], ...]
    """Smallest and largest amplitude of every input."""


def target_of(scene: Scene, t1: float | int, save_at: Sequence[float] | None) -> Target:
    """Compile a linear scene and its loads.

    Raises:
        InputError: naming what is not linear, or for times out of order.
    """
    times = checked_save_times(t1, save_at)
    if times[-1] <= 0:
        raise InputError("reduce: give an end time above 0 s")
    system = linear_system(scene, times[-1])
    if not system.inputs and not np.any(system.start):
        raise InputError(
            "reduce: no load changes the start of the scene, which is even: there is "
            "nothing to reduce"
        )
    varies = any(is_unknown_function(load.amplitude) for load in system.inputs)
    knots = knots_of(times[-1], system.compiled.breakpoints, varies)
    rows = system.amplitudes(knots)
    ranges = tuple((float(column.min()), float(column.max())) for column in rows.T)
    return Target(
        system=system,
        times=times,
        knots=knots,
        amplitudes=rows,
        plan=schedule(knots, times),
        ranges=ranges,
    )


def _at_saves(target: Target, modes: Projection) -> Float[np.ndarray, "t m"]:
    """Modes at the saved times."""
    states = host_run(
        modes.rates,
        drive=modes.drive,
        start=modes.start,
        plan=target.plan,
        amplitudes=target.amplitudes,
    )
    return target.plan.at_saves(modes.start, states)


def _span(target: Target, modes: Projection) -> Float[np.ndarray, " t"]:
    """Range of the surface at the saved times [K]."""
    _, loads = target.plan.loads(np, target.amplitudes)
    above = _at_saves(target, modes) @ modes.basis.surface.T
    acting_loads = target.plan.at_saves(np.zeros(loads.shape[1]), loads)
    above = above + acting_loads @ target.system.direct.T
    return np.asarray(error_span(target.system.reference + above, _RANGE))


def krylov_modes(
    target: Target, size: int | None, tolerance: float, log: Log
) -> Projection:
    """The modes of a basis that no further block would change."""
    system = target.system
    # The response to a change must be right at the next saved time.
    waits = [t - max(k for k in target.knots if k < t) for t in target.times if t > 0]
    blocks = krylov_blocks(
        system, shortest=min(waits), longest=target.times[-1], count=MAX_BLOCKS
    )
    basis = Basis.empty(system)
    if np.any(system.start):
        basis = basis.with_vectors(system, [system.start])
    modes = project(system, basis)
    previous = None
    calm = 0
    for number, block in enumerate(blocks):
        basis = basis.with_vectors(system, block)
        modes = project(system, basis)
        now = _at_saves(target, modes) @ modes.basis.surface.T
        if previous is not None:
            change = _rms(system, now - previous) / _span(target, modes)
            worst = float(change.max())
            log(f"block {number + 1}: {basis.size} vectors, change {100 * worst:.2g} %")
            calm = calm + 1 if worst < _KRYLOV_MARGIN * tolerance else 0
        previous = now
        # Twice, since a single rate may add nothing that these loads excite.
        enough = size is None or basis.size >= 2 * size
        if (calm >= 2 and enough) or basis.size >= len(system.capacity):
            break
    return modes


def _rms(system: LinearSystem, gap: np.ndarray) -> Float[np.ndarray, " t"]:
    area = system.area / system.area.sum()
    return np.sqrt((gap**2) @ area)


def chosen_basis(
    target: Target, modes: Projection, size: int | None, tolerance: float
) -> tuple[Basis, Float[np.ndarray, " t"]]:
    """The smallest basis within the tolerance, and its estimated error [K]."""
    count = modes.basis.size
    exact = _at_saves(target, modes)
    gram = surface_gram(target.system, modes.basis)
    zero = np.zeros(len(target.times))
    if not count or (size is not None and size >= count):
        return modes.basis, zero
    weights = principal_weights(
        target.system, projection=modes, plan=target.plan, amplitudes=target.amplitudes
    )
    span = _span(target, modes)

    def error(number: int) -> Float[np.ndarray, " t"]:
        selected = weights[:, :number]
        rates, turn = np.linalg.eigh(selected.T @ (modes.rates[:, None] * selected))
        selected = selected @ turn
        start = selected.T @ modes.start
        states = host_run(
            np.maximum(rates, 0),
            drive=selected.T @ modes.drive,
            start=start,
            plan=target.plan,
            amplitudes=target.amplitudes,
        )
        gap = exact - target.plan.at_saves(start, states) @ selected.T
        return np.sqrt(np.maximum(np.einsum("ti,ij,tj->t", gap, gram, gap), 0))

    if size is not None:
        return modes.basis.rotated(weights[:, :size]), error(size)
    for number in range(1, count):
        errors = error(number)
        if (errors / span).max() <= tolerance:
            return modes.basis.rotated(weights[:, :number]), errors
    return modes.basis, zero


def make_model(
    target: Target,
    basis: Basis,
    errors: Float[np.ndarray, " t"],
    method: str,
    solves: int,
    clock: float,
    log: Log,
) -> tuple[ReducedModel, Basis]:
    """The model of a basis whose estimated errors [K] are known, and its modes."""
    system = target.system
    modes = project(system, basis)
    log("bounding the error by the residual")
    ends = error_bound(
        system, projection=modes, plan=target.plan, amplitudes=target.amplitudes
    )
    missed = system.start - modes.basis.vectors @ modes.start
    begin = np.sqrt(missed @ (system.capacity * missed) / system.capacity.sum())
    bounds = target.plan.at_saves(begin, ends)
    fractions = errors / _span(target, modes)
    about = About(
        size=modes.basis.size,
        nodes=len(system.capacity),
        method=method,
        offline_s=time.perf_counter() - clock,
        solves=solves,
        estimate_kelvin=tuple(map(float, errors)),
        estimate_percent=100 * float(fractions.max()),
        residual_bound_kelvin=tuple(map(float, bounds)),
        scene_hash=_hash(system),
    )
    ranges = [
        LoadRange(load.name, unit=load.unit, low=low, high=high)
        for load, (low, high) in zip(system.inputs, target.ranges, strict=True)
    ]
    model = ReducedModel(
        rates=modes.rates,
        drive=modes.drive,
        start=modes.start,
        output=modes.basis.surface,
        direct=system.direct,
        reference=system.reference,
        inputs=tuple(ranges),
        knots=target.knots,
        amplitudes=target.amplitudes,
        times=target.times,
        surfaces=system.surfaces,
        about=about,
        dtype=system.dtype,
    )
    return model, modes.basis


def _hash(system: LinearSystem) -> str:
    names = ("capacity", "heat", "direct", "reference", "start")
    return arrays_checksum({name: getattr(system, name) for name in names})[:16]
