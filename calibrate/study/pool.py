"""Processes that evaluate cases: this one, those of a local cluster, or a scheduler's.

A task holds everything but mesh files, which workers on other machines find under the
same paths.
"""

import importlib
import logging
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

from jaxthermo.errors import InputError
from jaxthermo.extras import missing_package
from jaxthermo.host_memory import available_bytes

from ..problem.reference import program_hash
from .case import Case
from .evaluate import Evaluated, Truth, evaluate_group, failed


_LIBRARY = "distributed"
_WAIT_S = 20.0
"""Time to wait for a scheduler, and for its first worker [s]."""
_AHEAD = 2
"""Tasks per worker that are handed out at once."""
_POLL_S = 1.0
"""Interval in which a lost connection is noticed [s]."""
_MEMORY_FRACTION = 0.8
"""Fraction of the memory that is free now, for all local workers."""


class Task(NamedTuple):
    """Cases that are evaluated together, and the references of their loads."""

    cases: tuple[Case, ...]
    truths: dict[str, Truth]


_Results = Iterator[tuple[Task, list[Evaluated]]]
Pool = Callable[[Sequence[Task]], _Results]
"""Function that evaluates tasks and yields each result when it is ready."""


def _in_this_process(tasks: Sequence[Task], devices: int = 1) -> _Results:
    """Evaluate tasks one after the other; devices share the cases of each."""
    for task in tasks:
        yield task, evaluate_group(task.cases, truths=task.truths, devices=devices)


@contextmanager
def open_pool(workers: int, scheduler: str | None, devices: int = 1) -> Iterator[Pool]:
    """Start local workers, or connect to a scheduler.

    Args:
        workers: number of local processes; this one only for 0 and 1.
        scheduler: address of a running one, such as tcp://10.0.0.1:8786.
        devices: of this process; workers have one each.

    Raises:
        InputError: if the library is missing, or the scheduler cannot be reached or
            has no workers.
    """
    if scheduler is None and workers <= 1:
        yield partial(_in_this_process, devices=devices)
        return
    try:
        library = importlib.import_module(_LIBRARY)
        settings = importlib.import_module("dask").config
    except ModuleNotFoundError as error:
        raise missing_package(
            "--workers and --scheduler need",
            package=str(error.name),
            extra="sweep",
            otherwise="give --workers 1",
        ) from error
    # Its own messages about lost connections are many lines long.
    for name in [n for n in logging.root.manager.loggerDict if n.startswith(_LIBRARY)]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    one_thread = {
        "OMP_NUM_THREADS": "1",
        # The number of threads of XLA's own pool.
        "NPROC": "1",
        "XLA_FLAGS": os.environ.get("XLA_FLAGS", "")
        + " --xla_cpu_multi_thread_eigen=false",
    }
    # Before a worker imports anything, which reads these variables once.
    with settings.set({"distributed.nanny.pre-spawn-environ": one_thread}):
        cluster = None if scheduler is not None else _local(library, workers)
        try:
            with _client(library, cluster or scheduler) as client:
                yield lambda tasks: _distributed(client, tasks)
        finally:
            if cluster is not None:
                cluster.close()


def _local(library: Any, workers: int) -> Any:
    memory = int(_MEMORY_FRACTION * available_bytes() / workers)
    # A terminal sends Ctrl-C to all processes: workers inherit that it is ignored, and
    # end with this one.
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        return library.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=memory,
            dashboard_address=None,
            # Else its web server takes a fixed port, which a second sweep wants too.
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
            silence_logs=logging.CRITICAL,
        )
    finally:
        signal.signal(signal.SIGINT, handler)


@contextmanager
def _client(library: Any, target: Any) -> Iterator[Any]:
    try:
        client = library.Client(target, timeout=_WAIT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise InputError(
            f"--scheduler {target}: cannot be reached ({reason}): start one with "
            "`dask scheduler`, and workers with `dask worker ADDRESS`"
        ) from error
    try:
        try:
            client.wait_for_workers(1, timeout=_WAIT_S)
        except (TimeoutError, OSError) as error:
            raise InputError(
                f"--scheduler {target}: has no workers: start some with "
                f"`dask worker {target}`"
            ) from error
        yield client
    finally:
        # Tasks that were handed out and are not needed end with it.
        client.close(timeout=2)


def _distributed(client: Any, tasks: Sequence[Task]) -> _Results:
    waiting = list(tasks)
    running: dict[Any, Task] = {}
    ready = threading.Event()
    while waiting or running:
        if client.status != "running":
            raise _lost()
        ready.clear()
        try:
            workers = client.scheduler_info(n_workers=-1)["workers"]
            while waiting and len(running) < _AHEAD * max(len(workers), 1):
                task = waiting.pop(0)
                future = client.submit(_work, task, program_hash(), pure=False)
                future.add_done_callback(lambda _: ready.set())
                running[future] = task
        except OSError as error:
            raise _lost() from error
        # Not for ever: a connection that is lost sets nothing.
        if not any(future.done() for future in running):
            ready.wait(_POLL_S)
        for future in [future for future in running if future.done()]:
            task = running.pop(future)
            try:
                evaluated = _result(future, task)
            except OSError as error:
                # It may be lost while a result is on its way.
                raise _lost() from error
            yield task, evaluated


def _result(future: Any, task: Task) -> list[Evaluated]:
    if future.cancelled():
        raise _lost()
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, InputError):
        raise error
    # A worker that was killed several times over the same task ran out of memory.
    return [failed(case, error) for case in task.cases]


def _lost() -> InputError:
    return InputError(
        "--scheduler: the connection was lost; finished rows are kept, and the same "
        "command goes on from there"
    )


def _work(task: Task, program: str) -> list[Evaluated]:
    """Evaluate a task in a worker, which must run the same program."""
    if program_hash() != program:
        raise InputError(
            "--scheduler: its workers run another version of this program: install "
            "the same one there, and start them again"
        )
    return evaluate_group(task.cases, task.truths)
