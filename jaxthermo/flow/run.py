"""A flow from start to end: segments of about a second, means, forces, progress."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ..arrays import precision
from ..choices import Dtype, Kernels
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


_STRIDE = 20
"""Steps from one sample of forces and means to the next."""

_SEGMENT = 5e7
"""Number of lattice updates in a segment: about a second of one core."""

_ARRAYS = 30
"""Number of arrays of a run with a value for every cell: two sets of populations, sums
of fields and samples."""

_ARRAYS_WITH_HEAT = 50
"""Number of such arrays with a temperature: twice as many populations."""


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
    dtype: Dtype = "float32",
    start: Callable[..., FlowState] = initial_state,
    progress: Callable[[FlowProgress], None] | None = None,
    kernels: Kernels = None,
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
    samples = -(-steps // _STRIDE)
    segments = max(2, round(samples * _STRIDE * cells / _SEGMENT))
    samples_per_segment = -(-samples // segments)
    with precision(dtype):
        program = flow_program(channel, dtype, kernels)
        return _run(
            channel,
            program=program,
            samples_per_segment=samples_per_segment,
            segments=segments,
            average_from=average_from,
            start=start,
            progress=progress,
        )


def _run(
    channel: Channel,
    program: FlowProgram,
    samples_per_segment: int,
    segments: int,
    average_from: float,
    start: Callable[..., FlowState],
    progress: Callable[[FlowProgress], None] | None,
) -> FlowRun:
    state = start(program)
    total = jax.tree.map(jnp.zeros_like, totals(program, state))
    first = min(round(average_from * segments), segments - 1)
    samples = []
    clock = time.perf_counter()
    for number in range(segments):
        weight = jnp.asarray(float(number >= first), program.viscosity.dtype)
        state, total, sample = advance_in_place(
            program, state, total, weight, samples=samples_per_segment, stride=_STRIDE
        )
        samples.append(_on_host(sample))
        done = (number + 1) * samples_per_segment * _STRIDE
        if not np.isfinite(samples[-1].force).all() or not _is_finite(state):
            raise InputError(
                f"simulate_flow: the flow became unstable before step {done}: use a "
                "higher viscosity, a lower speed or more cells"
            )
        if progress is not None:
            left = (time.perf_counter() - clock) * (segments / (number + 1) - 1)
            all_steps = segments * samples_per_segment * _STRIDE
            progress(FlowProgress(steps=done, of=all_steps, seconds_left=left))
    force = np.concatenate([sample.force for sample in samples])
    mean = jax.tree.map(lambda a: np.asarray(a / total.count), total)
    return FlowRun(
        channel=channel,
        last=_on_host(fields(program, state)),
        mean=mean.fields,
        link_heat=mean.heat,
        step=_STRIDE * np.arange(1, segments * samples_per_segment + 1),
        drag=force[:, 0],
        lift=force[:, 1],
        heat=np.concatenate([sample.heat for sample in samples]),
        averaged=slice(first * samples_per_segment, None),
    )


def _on_host(tree: Any) -> Any:
    return jax.tree.map(np.asarray, tree)


def _is_finite(state: FlowState) -> bool:
    return bool(jnp.isfinite(state.flow[0].sum()))
