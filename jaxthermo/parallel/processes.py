"""Several processes that run one scene together, each with some of its devices.

All processes execute the same program, so that whatever depends on a clock, a signal or
a file of one of them is agreed upon first.
"""

import atexit
import hashlib
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import jax
import numpy as np
from jax.experimental import multihost_utils

from ..errors import InputError
from .meeting import Group, meet


# Within so many seconds a process that is lost ends the others.
_HEARTBEAT = 20
# Wait for processes that start later [s].
_START = 60.0


def join(group: Group, key: str) -> None:
    """Connect this process with the others, before its first computation.

    `key` is a line that must be the same in all of them.

    Raises:
        InputError: if one of the others does not come, or differs.
    """
    meet(group, key, _START)
    # Without effect where there are other devices than processors.
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    jax.distributed.initialize(
        group.coordinator,
        group.processes,
        group.process,
        initialization_timeout=int(_START),
        heartbeat_timeout_seconds=_HEARTBEAT,
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
def lost_processes_end_the_run(remedy: str) -> Iterator[None]:
    """Turn the failure of a collective operation into one line.

    Raises:
        InputError: if another process is gone.
    """
    try:
        yield
    except jax.errors.JaxRuntimeError as error:
        if jax.process_count() == 1:
            raise
        # JAX's own end would wait for the lost process, and abort with a stack trace.
        atexit.register(_leave)
        raise InputError(
            f"another process is lost, or cannot be reached; {remedy}"
        ) from error


def _leave() -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(2)
