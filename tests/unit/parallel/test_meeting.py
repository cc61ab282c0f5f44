"""Processes of a run meet before JAX connects them; threads stand for them here."""

import re
import socket
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

import jaxthermo as jt
from jaxthermo.parallel import processes as module
from jaxthermo.parallel.meeting import Group, free_port, group_of, meet


def meeting(*processes: tuple[int, str], seconds: float = 5.0) -> list[str]:
    """Refusals of these processes, of three, each with a number and a key."""
    address = f"localhost:{free_port()}"

    def one(process: tuple[int, str]) -> str:
        number, key = process
        try:
            for connection in meet(Group(address, 3, number), key, seconds):
                connection.close()
        except jt.InputError as error:
            return str(error)
        return ""

    with ThreadPoolExecutor(len(processes)) as pool:
        return list(pool.map(one, processes))


def test_all_come_and_run_the_same():
    assert meeting((2, "v1"), (0, "v1"), (1, "v1")) == ["", "", ""]


def test_another_version_ends_all_with_one_line():
    refusals = meeting((0, "v1"), (1, "v2"))
    assert refusals[0] == refusals[1]
    assert refusals[0].startswith("process 1 runs v2, process 0 v1; start all")


def test_one_that_does_not_come():
    first, second = meeting((0, "v1"), (1, "v1"), seconds=0.5)
    assert first.startswith("process 2 of 3 did not come; start all of them again")
    assert second == first or "process 0 cannot be reached" in second


def test_one_that_was_started_twice():
    refusals = meeting((0, "v1"), (1, "v1"), (1, "v1"))
    assert all(
        refusal.startswith("process 1 was started twice") for refusal in refusals
    )


def test_no_first_process():
    (refusal,) = meeting((1, "v1"), seconds=0.3)
    assert "process 0 cannot be reached; start it too" in refusal


def test_a_port_that_is_taken():
    with socket.create_server(("", 0)) as server:
        address = f"localhost:{server.getsockname()[1]}"
        with pytest.raises(jt.InputError, match="address already in use"):
            meet(Group(address, 2, 0), "v1", 0.5)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((None, 2, 0, 2), "--processes 2 --process 0: give the address of process 0"),
        (("node1", 2, 0, 2), "--coordinator node1: give the address"),
        (("node1:x", 2, 0, 2), "--coordinator node1:x: give the address"),
        (("node1:7700", 1, 0, 1), "--process 0 of --processes 1: give 2 or more"),
        (("node1:7700", 2, 2, 2), "--process 2 of --processes 2: give 2 or more, and"),
        (("node1:7700", 2, 0, 3), "--devices 3: 2 processes have the same number"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(given, message):
    with pytest.raises(jt.InputError, match=re.escape(message)):
        group_of(*given)


def test_a_process_alone_is_no_group():
    assert group_of(None, 1, 0, 4) is None
    assert group_of("node1:7700", 2, 1, 4) == Group("node1:7700", 2, 1)


def test_a_silent_process_is_noticed_and_one_that_is_there_is_not(monkeypatch):
    monkeypatch.setattr(module, "_INTERVAL", 0.02)
    monkeypatch.setattr(module, "_PATIENCE", 0.3)
    monkeypatch.setattr(module, "_GRACE", 0.1)
    said = []
    lost = threading.Event()

    def end_with(message: str) -> None:
        said.append(message)
        lost.set()

    monkeypatch.setattr(module, "_end_with", end_with)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        with module._watched([ours], "here"), module._watched([theirs], "there"):
            assert not lost.wait(0.6)
        with module._watched([ours], "gone"):
            assert lost.wait(5.0)
    assert said[0] == "gone"
