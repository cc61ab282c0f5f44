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
"""Name of the axis of devices: each has one section of every lattice, or one part of a
batch."""


def provide_devices(count: int) -> None:
    """Make as many devices of the host's processor as a command asks for.

    Nothing happens where there are other devices, or the user has set their number.
    """
    if count > 1 and _FORCED not in os.environ.get("XLA_FLAGS", ""):
        # A process that has computed before has its devices: it is told how many.
        with suppress(RuntimeError):
            jax.config.update("jax_num_cpu_devices", count)


def check_devices(count: int) -> None:
    """Check a number of devices.

    Raises:
        InputError: if there are fewer, or if several processes have more.
    """
    if not isinstance(count, int) or isinstance(count, bool) or count < 1:
        raise InputError(f"devices={count!r}: give a number of devices, 1 or more")
    there, processes = jax.device_count(), jax.process_count()
    kind = jax.devices()[0].platform
    if count > there:
        remedy = f"give at most {there}"
        if kind == "cpu":
            remedy += f", or start with XLA_FLAGS={_FORCED}={count}"
        raise InputError(
            f"devices={count}: there {'is' if there == 1 else 'are'} {there} {kind} "
            f"device{'s' * (there != 1)}; {remedy}"
        )
    if processes > 1 and count != there:
        raise InputError(
            f"devices={count}: {processes} processes run together and have {there} "
            f"devices; give devices={there}, all of them"
        )


def check_shared(devices: int, parts: int, shared: str) -> None:
    """Check that there is at least one part of something shared for each device.

    Raises:
        InputError: if there are fewer; `shared` says what devices would share.
    """
    if devices > parts:
        remedy = "leave devices out" if parts == 1 else f"give at most {parts}"
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
