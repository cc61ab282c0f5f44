"""The devices of a run on several of them."""

import math
import os
from contextlib import suppress
from functools import cache

import jax
from jax.sharding import AxisType, Mesh

from ..errors import InputError
from ..host_memory import readable_bytes


AXIS = "section"
"""Axis of devices, each with a section of every lattice, or with a part of a batch."""


def provide_devices(count: int) -> None:
    """Make this number of devices of the host's processor.

    This has no effect if JAX uses other devices, or the user has set their number.
    """
    if count > 1 and _FORCED not in os.environ.get("XLA_FLAGS", ""):
        # The number of devices is fixed in a process that has computed already.
        with suppress(RuntimeError):
            jax.config.update("jax_num_cpu_devices", count)


def check_devices(count: int) -> None:
    """Check a number of devices.

    Raises:
        InputError: if there are fewer, or if several processes have more.
    """
    if not isinstance(count, int) or isinstance(count, bool) or count < 1:
        raise InputError(f"devices={count!r}: give a number of devices, 1 or more")
    available = jax.device_count()
    processes = jax.process_count()
    platform = jax.devices()[0].platform
    if count > available:
        remedy = f"give at most {available}"
        if platform == "cpu":
            remedy += f", or start with XLA_FLAGS={_FORCED}={count}"
        raise InputError(
            f"devices={count}: there {'is' if available == 1 else 'are'} {available} "
            f"{platform} device{'s' * (available != 1)}; {remedy}"
        )
    if processes > 1 and count != available:
        raise InputError(
            f"devices={count}: {processes} processes run together and have {available} "
            f"devices; give devices={available}, all of them"
        )


def check_shared(devices: int, shares: int, shared: str) -> None:
    """Check that there is at least one part of something shared for each device.

    Raises:
        InputError: if there are fewer; `shared` says what devices would share.
    """
    if devices > shares:
        remedy = "leave devices out" if shares == 1 else f"give at most {shares}"
        raise InputError(f"devices={devices}: they would share {shared}; {remedy}")


_FORCED = "--xla_force_host_platform_device_count"


def require_device_memory(needed: int, task: str, remedy: str) -> None:
    """Refuse work that does not fit into a device with memory of its own.

    Raises:
        InputError: if more than 90 % of what is free would be needed.
    """
    # None for processors, which share the memory of the host.
    stats = jax.local_devices()[0].memory_stats() or {}
    free = stats.get("bytes_limit", math.inf) - stats.get("bytes_in_use", 0)
    if needed > 0.9 * free:
        raise InputError(
            f"{task} needs about {readable_bytes(needed)} on each device and "
            f"{readable_bytes(free)} is free: {remedy}, or give more devices"
        )


@cache
def mesh_of(count: int) -> Mesh:
    """The first devices in a row."""
    # The partitioner decides where the few arrays of surfaces and probes are.
    return jax.make_mesh(
        (count,), (AXIS,), (AxisType.Auto,), devices=jax.devices()[:count]
    )
