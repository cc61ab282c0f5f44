"""A flow from start to end: segments of about a second, means, forces, progress."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ..arrays import precision
from ..errors import InputError, whole_number
from ..host_memory import require_memory
from ..native.call import check_kernels, require_native
from .channel import Channel
from .flow import (
    Fields,
    FlowProgram,
    FlowState,
    advance_in_place,
    fields,
    flow_program,
    initial_state,
    totals,
)


STRIDE = 20
"""Steps from one sample of forces and means to the next."""

# Lattice updates in a segment: about a second of one core.
_SEGMENT = 5e7
# Arrays of numbers that a run holds for every cell: two sets of populations, sums of
# fields and what is read; twice as many populations with a temperature.
_ARRAYS, _ARRAYS_WITH_HEAT = 30, 50


class FlowProgress(NamedTuple):
    """State of a run, once for every segment."""

    steps: int
    of: int
    seconds_left: float

    @property
    def text(self) -> str:
        """Format for a line of a terminal, e.g. "12000 of 40000 steps, 35 s left"."""
        return f"{self.steps} of {self.of} steps, {self.seconds_left:.0f} s left"


class FlowRun(NamedTuple):
    """A flow at its end, its mean, and what was sampled, in lattice units."""

    channel: Channel
    last: Fields
    """Fields at the end."""
    mean: Fields
    """Mean over the samples from `average_from` on."""
    link_heat: Float[np.ndarray, "8 y x"] | None
    """Mean heat per step over each link of the body; None without temperatures."""
    step: Int[np.ndarray, " t"]
    """Step of each sample."""
    drag: Float[np.ndarray, " t"]
    lift: Float[np.ndarray, " t"]
    heat: Float[np.ndarray, " t"]
    """Heat that leaves the body per step."""
    averaged: slice
    """Samples of the mean."""


def simulate_flow(
    channel: Channel,
    steps: int,
    *,
    average_from: float = 0.5,
    dtype: str = "float32",
    start: Callable[..., FlowState] = initial_state,
    progress: Callable[[FlowProgress], None] | None = None,
    kernels: str | None = None,
) -> FlowRun:
    """Run a flow from rest in equilibrium, with means over its later part.

    Args:
        channel: domain, inlet, body and fluid.
        steps: number of steps, rounded up to whole segments.
        average_from: fraction of the steps before the mean begins.
        dtype: float32 or float64.
        start: makes the first state of the program.
        progress: called after every segment, with the time left.
        kernels: "numba" for collisions in loops that it compiles, on a CPU and with the
            extra `native`: equal to rounding; None for those of XLA.

    Raises:
        InputError: if the flow becomes unstable, or does not fit into memory; for other
            kernels, or where numba is missing.
    """
    check_kernels(kernels, "simulate_flow")
    if kernels is not None:
        require_native(f"simulate_flow(kernels={kernels!r})")
    whole_number(steps, "simulate_flow(steps=)")
    cells = channel.shape[0] * channel.shape[1]
    arrays = _ARRAYS if channel.diffusivity is None else _ARRAYS_WITH_HEAT
    needed = arrays * cells * np.dtype(dtype).itemsize
    require_memory(needed, "a flow", "use fewer cells")
    samples = -(-steps // STRIDE)
    segments = max(2, round(samples * STRIDE * cells / _SEGMENT))
    each = -(-samples // segments)
    with precision(dtype):
        program = flow_program(channel, dtype, kernels)
        return _run(
            channel,
            program=program,
            each=each,
            segments=segments,
            average_from=average_from,
            start=start,
            progress=progress,
        )


def _run(
    channel: Channel,
    program: FlowProgram,
    each: int,
    segments: int,
    average_from: float,
    start: Callable[..., FlowState],
    progress: Callable[[FlowProgress], None] | None,
) -> FlowRun:
    state = start(program)
    total = jax.tree.map(jnp.zeros_like, totals(program, state))
    first, read = min(round(average_from * segments), segments - 1), []
    clock = time.perf_counter()
    for number in range(segments):
        weight = jnp.asarray(float(number >= first), program.viscosity.dtype)
        state, total, sample = advance_in_place(
            program, state, total, weight, samples=each, stride=STRIDE
        )
        read.append(jax.tree.map(np.asarray, sample))
        done = (number + 1) * each * STRIDE
        if not np.isfinite(read[-1].force).all() or not _is_finite(state):
            raise InputError(
                f"simulate_flow: the flow became unstable before step {done}: use a "
                "higher viscosity, a lower speed or more cells"
            )
        if progress is not None:
            left = (time.perf_counter() - clock) * (segments / (number + 1) - 1)
            progress(FlowProgress(done, segments * each * STRIDE, left))
    force = np.concatenate([r.force for r in read])
    to_host: Callable[[Any], Any] = lambda tree: jax.tree.map(np.asarray, tree)
    mean = jax.tree.map(lambda a: np.asarray(a / total.count), total)
    return FlowRun(
        channel=channel,
        last=to_host(fields(program, state)),
        mean=mean.fields,
        link_heat=mean.heat,
        step=STRIDE * np.arange(1, segments * each + 1),
        drag=force[:, 0],
        lift=force[:, 1],
        heat=np.concatenate([r.heat for r in read]),
        averaged=slice(first * each, None),
    )


def _is_finite(state: FlowState) -> bool:
    return bool(jnp.isfinite(state.flow[0].sum()))
