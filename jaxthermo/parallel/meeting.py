"""First meeting of the processes of a run, before JAX connects them.

JAX aborts a process with a stack trace where others do not come, and waits for ever
where one was started twice: so they meet at the same address first, and all of them end
with the same line if they do not fit.
"""

import socket
import time
from contextlib import ExitStack
from typing import NamedTuple

from ..errors import InputError


class Group(NamedTuple):
    """Processes of a run, as each of them is started."""

    coordinator: str
    """Address of the first process, HOST:PORT."""
    processes: int
    process: int
    """Number of this one, from 0."""

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of the first process."""
        host, _, port = self.coordinator.rpartition(":")
        return host, int(port)


def free_port() -> int:
    """A port of this machine that nothing listens on."""
    with socket.create_server(("", 0)) as server:
        return server.getsockname()[1]


def group_of(
    coordinator: str | None, processes: int, process: int, devices: int
) -> Group | None:
    """The group that a command line names; None for a process alone.

    Raises:
        InputError: if the numbers or the address do not fit.
    """
    if coordinator is None:
        if processes != 1 or process != 0:
            raise InputError(
                f"--processes {processes} --process {process}: give the address of "
                "process 0 too, --coordinator HOST:PORT"
            )
        return None
    host, _, port = coordinator.rpartition(":")
    if not (host and port.isdigit() and 0 < int(port) < 2**16):
        raise InputError(
            f"--coordinator {coordinator}: give the address of process 0, HOST:PORT"
        )
    if processes < 2 or not 0 <= process < processes:
        raise InputError(
            f"--process {process} of --processes {processes}: give 2 or more, and "
            "number them from 0"
        )
    if devices < processes or devices % processes:
        raise InputError(
            f"--devices {devices}: {processes} processes have the same number of "
            f"devices each; give a multiple of {processes}"
        )
    return Group(coordinator, processes, process)


def meet(group: Group, key: str, seconds: float) -> list[socket.socket]:
    """Wait until all processes are here, and check that they run the same.

    Args:
        group: the processes.
        key: what must be the same in all of them, such as versions, in a line.
        seconds: how long to wait.

    Returns:
        Connections of the first process to all others, or of another to the first.

    Raises:
        InputError: in all of them, if one does not come or differs.
    """
    deadline = time.monotonic() + seconds
    with ExitStack() as stack:
        if group.process == 0:
            reply = _receive(group, key=key, deadline=deadline, stack=stack)
        else:
            reply = _announce(group, key=key, deadline=deadline, stack=stack)
        refusal, connections = reply
        if refusal:
            raise InputError(refusal)
        # The connections stay open.
        stack.pop_all()
    return connections


def _receive(
    group: Group, key: str, deadline: float, stack: ExitStack
) -> tuple[str, list[socket.socket]]:
    """Wait for all others and send them the refusal, if there is one."""
    _, port = group.address
    refusal = ""
    lines = {0: key}
    connections = []
    try:
        server = socket.create_server(("", port))
    except OSError as error:
        raise InputError(
            f"--coordinator {group.coordinator}: cannot listen on port {port}: "
            f"{(error.strerror or str(error)).lower()}; give another"
        ) from error
    with server:
        while len(lines) < group.processes and not refusal:
            server.settimeout(max(deadline - time.monotonic(), 0.01))
            try:
                connection = stack.enter_context(server.accept()[0])
                connection.settimeout(5.0)
                number, _, text = _line(connection).partition(" ")
            except OSError:
                missing = sorted(set(range(group.processes)) - lines.keys())
                refusal = f"process {missing[0]} of {group.processes} did not come"
                break
            connections.append(connection)
            if not number.isdigit() or int(number) >= group.processes:
                refusal = f"process {number} is none of {group.processes}"
            elif int(number) in lines:
                refusal = f"process {number} was started twice"
            elif text != key:
                refusal = f"process {number} runs {text}, process 0 {key}"
            lines[int(number) if number.isdigit() else -1] = text
    if refusal:
        refusal += "; start all of them again, with the same command"
    for connection in connections:
        connection.sendall(f"{refusal}\n".encode())
    return refusal, connections


def _line(connection: socket.socket) -> str:
    with connection.makefile() as received:
        line = received.readline()
    if not line:
        raise ConnectionResetError
    return line.strip()


def _announce(
    group: Group, key: str, deadline: float, stack: ExitStack
) -> tuple[str, list[socket.socket]]:
    """Tell the first process, and return its refusal."""
    while time.monotonic() < deadline:
        try:
            first = socket.create_connection(group.address, timeout=2.0)
            stack.enter_context(first)
            first.sendall(f"{group.process} {key}\n".encode())
            first.settimeout(max(deadline - time.monotonic(), 1.0))
            return _line(first), [first]
        # Not there yet.
        except OSError:
            time.sleep(0.2)
    refusal = "process 0 cannot be reached; start it too, or give its address"
    return f"--coordinator {group.coordinator}: {refusal}", []
