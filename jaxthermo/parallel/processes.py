"""Several processes that run one scene together, each with some of its devices.

All processes execute the same program, so that they must agree first on whatever
depends on a clock, a signal or a file of one of them.

A process that is killed closes its connections, and the next collective operation of
the others fails. One that hangs, or whose machine is gone, does neither, and the others
would wait for ever: so a thread of each process regularly sends them a byte.
"""

import hashlib
import os
import re
import socket
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn

import jax
import numpy as np
from jax.experimental import multihost_utils

from ..errors import InputError
from .meeting import Group, meet


_START = 60.0
"""Time to wait for processes that start later [s]."""
_INTERVAL = 3.0
"""Time between two bytes [s]."""
_PATIENCE = 30.0
"""Time without a byte after which another process counts as lost [s]."""
_GRACE = 5.0
"""Time that the main thread has to end the run by itself [s]."""


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


def check_alike(subject: str, text: str) -> None:
    """Check that all processes have the same text on a subject, such as versions.

    Raises:
        InputError: in all of them, if one has another.
    """
    if jax.process_count() == 1:
        return
    digest = hashlib.sha256(text.encode()).digest()[:8]
    digests = multihost_utils.process_allgather(np.frombuffer(digest, np.int32))
    differing = np.flatnonzero((digests != digests[0]).any(axis=1))
    if len(differing):
        raise InputError(
            f"process {differing[0]} has other {subject} than process 0; start all of "
            f"them with the same (here: {text})"
        )


@contextmanager
def watching_others(remedy: str) -> Iterator[None]:
    """End this process with one line and status 2 if another is lost meanwhile."""
    message = f"another process is lost, or cannot be reached; {remedy}"
    try:
        with _watched(_connections, message):
            yield
            wait_for_all("the run is at its end")
    except (jax.errors.JaxRuntimeError, ValueError) as error:
        if jax.process_count() == 1 or not _LOST.search(str(error)):
            raise
        # At once: JAX aborts with a stack trace as soon as it notices the same.
        _end_with(message)


_LOST = re.compile("Gloo|UNAVAILABLE|coordination service", re.IGNORECASE)
"""Words in the messages of collective operations that fail."""
_connections: list[socket.socket] = []
"""Connections of this process to others, from `join` on."""


@contextmanager
def _watched(connections: Sequence[socket.socket], message: str) -> Iterator[None]:
    """End this process with a line if another gives no sign of life meanwhile."""
    if not connections:
        yield
        return
    ended = threading.Event()
    thread = threading.Thread(
        target=_watch, args=(connections, message, ended), daemon=True
    )
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _watch(
    connections: Sequence[socket.socket], message: str, ended: threading.Event
) -> None:
    last_heard = dict.fromkeys(connections, time.monotonic())
    for connection in connections:
        connection.setblocking(False)
    while not ended.wait(_INTERVAL):
        alive = all(_is_alive(connection, last_heard) for connection in connections)
        if not alive and not ended.wait(_GRACE):
            _end_with(message)


def _is_alive(
    connection: socket.socket, last_heard: dict[socket.socket, float]
) -> bool:
    try:
        connection.send(b".")
        if not connection.recv(4096):
            return False
        last_heard[connection] = time.monotonic()
    except BlockingIOError:
        # Nothing has come since the last time, or nothing can be sent.
        pass
    except OSError:
        return False
    return time.monotonic() - last_heard[connection] < _PATIENCE


def _end_with(message: str) -> NoReturn:
    """End this process at once with a line and status 2.

    JAX's own end would wait for the lost process, and abort with a stack trace.
    """
    sys.stdout.flush()
    sys.stderr.write(f"jaxthermo: {message}\n")
    sys.stderr.flush()
    os._exit(2)
