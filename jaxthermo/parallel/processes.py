"""Several processes that run one scene together, each with some of its devices.

All processes execute the same program, so that whatever depends on a clock, a signal or
a file of one of them is agreed upon first.
"""

import hashlib
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import jax
import numpy as np
from jax.experimental import multihost_utils

from ..errors import InputError
from .heartbeat import end_with, watched
from .meeting import Group, meet


# Wait for processes that start later [s].
_START = 60.0


def join(group: Group, key: str) -> None:
    """Connect this process with the others, before its first computation.

    `key` is a line that must be the same in all of them.

    Raises:
        InputError: if one of the others does not come, or differs.
    """
    _connections.extend(meet(group, key, _START))
    # Without effect where there are other devices than processors.
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    # Otherwise JAX aborts with a stack trace as soon as another process is gone.
    jax.config.update("jax_enable_recoverability", True)
    jax.distributed.initialize(
        group.coordinator,
        group.processes,
        group.process,
        initialization_timeout=int(_START),
    )


def is_first() -> bool:
    """True in the process that writes results, and where there is one."""
    return jax.process_index() == 0


def agreed(number: int) -> int:
    """The number that the first process gives."""
    if jax.process_count() == 1:
        return number
    return int(multihost_utils.broadcast_one_to_all(np.int64(number)))


def any_process(flag: bool) -> bool:
    """True in all processes if the flag is set in one of them."""
    if jax.process_count() == 1:
        return flag
    return bool(np.any(multihost_utils.process_allgather(np.bool_(flag))))


def wait_for_all(where: str) -> None:
    """Go on when all processes are here."""
    if jax.process_count() > 1:
        multihost_utils.sync_global_devices(where)


def check_alike(what: str, text: str) -> None:
    """Check that all processes have the same text, such as versions.

    Raises:
        InputError: in all of them, if one has another.
    """
    if jax.process_count() == 1:
        return
    digest = hashlib.sha256(text.encode()).digest()[:8]
    own = np.frombuffer(digest, np.int32)
    found = multihost_utils.process_allgather(own)
    others = [n for n, each in enumerate(found) if (each != found[0]).any()]
    if others:
        raise InputError(
            f"process {others[0]} has other {what} than process 0; start all of them "
            f"with the same (here: {text})"
        )


@contextmanager
def watching_others(remedy: str) -> Iterator[None]:
    """End this process with one line and status 2 if another is lost meanwhile."""
    message = f"another process is lost, or cannot be reached; {remedy}"
    try:
        with watched(_connections, message):
            yield
            wait_for_all("the run is at its end")
    except (jax.errors.JaxRuntimeError, ValueError) as error:
        if jax.process_count() == 1 or not _LOST.search(str(error)):
            raise
        # At once: JAX aborts with a stack trace as soon as it notices the same.
        end_with(message)


_LOST = re.compile("Gloo|UNAVAILABLE|coordination service", re.IGNORECASE)
"""In the messages of collective operations that fail."""
_connections: list[socket.socket] = []
"""Connections of this process to others, from `join` on."""
