"""Signs of life between the processes of a run.

A process that is killed closes its connections, and the next collective operation of
the others fails. One that hangs, or whose machine is gone, does neither, and they would
wait for ever: so a thread of each process sends a byte to the others from time to time.
"""

import os
import socket
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn


_INTERVAL = 3.0
_PATIENCE = 30.0
_GRACE = 5.0
"""Between two bytes; without any from another process; and for the main thread to end
the run by itself [s]."""


@contextmanager
def watched(connections: Sequence[socket.socket], message: str) -> Iterator[None]:
    """End this process with a line if another gives no sign of life meanwhile."""
    if not connections:
        yield
        return
    ended = threading.Event()
    given = connections, message, ended
    thread = threading.Thread(target=_watch, args=given, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _watch(
    connections: Sequence[socket.socket], message: str, ended: threading.Event
) -> None:
    heard = dict.fromkeys(connections, time.monotonic())
    for each in connections:
        each.setblocking(False)
    while not ended.wait(_INTERVAL):
        alive = all(_is_alive(each, heard) for each in connections)
        if not alive and not ended.wait(_GRACE):
            end_with(message)


def _is_alive(connection: socket.socket, heard: dict[socket.socket, float]) -> bool:
    try:
        connection.send(b".")
        if not connection.recv(4096):
            return False
        heard[connection] = time.monotonic()
    except BlockingIOError:
        # Nothing has come since the last time, or nothing can be sent.
        pass
    except OSError:
        return False
    return time.monotonic() - heard[connection] < _PATIENCE


def end_with(message: str) -> NoReturn:
    """End this process at once with a line and status 2.

    JAX's own end would wait for the lost process, and abort with a stack trace.
    """
    sys.stdout.flush()
    sys.stderr.write(f"jaxthermo: {message}\n")
    sys.stderr.flush()
    os._exit(2)
