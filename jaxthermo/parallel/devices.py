"""The devices of a run on several of them."""

from functools import cache

import jax
from jax.sharding import AxisType, Mesh

from ..errors import InputError


AXIS = "section"
"""Name of the axis of devices: each has one section of every lattice."""


def check_devices(count: int) -> None:
    """Check a number of devices.

    Raises:
        InputError: if there are fewer, or several processes.
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
    if processes > 1:
        raise InputError(
            f"devices={count}: {processes} processes run together, and a scene is "
            "spread over the devices of one; start a single process"
        )


_FORCED = "--xla_force_host_platform_device_count"


@cache
def mesh_of(count: int) -> Mesh:
    """The first devices in a row."""
    # The partitioner decides where the few arrays of surfaces and probes are.
    return jax.make_mesh(
        (count,), (AXIS,), (AxisType.Auto,), devices=jax.devices()[:count]
    )
