"""Threads, spawned and forked processes, interrupts: later results have the same bits.

Each process here starts without any program, so that the disturbance meets the search
in geometry, the trace and the compilation.
"""

import multiprocessing
import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

from tests.undisturbed import NAMES, simulated


ROOT = Path(__file__).resolve().parents[3]

# The bits of every scene, with its numbers and with others.
LAST = """
for name in ("block", "contact"):
    for factor in (1.0, 1.1):
        print(simulated(name, factor))
"""


def printed(code: str) -> list[str]:
    """Words that a new process prints, which first runs this code and then `LAST`."""
    lines = ("from tests.undisturbed import *", code, LAST)
    ended = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | {"JAX_ENABLE_X64": "1"},
        timeout=300,
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.split()


@pytest.fixture(scope="module")
def undisturbed() -> list[str]:
    """Bits of a process that does nothing else."""
    bits = printed("")
    assert len(set(bits)) == len(bits) == 4
    return bits


THREADS = """
# As in a notebook: an event loop runs, and its threads work at once.
import asyncio
import threading

start = threading.Barrier(len(NAMES))


def at_once(call, *arguments):
    start.wait()
    return call(*arguments)


async def all_of(calls):
    return await asyncio.gather(*(asyncio.to_thread(at_once, *call) for call in calls))


print(*asyncio.run(all_of((simulated, name) for name in NAMES)))
# One compiled simulation, which all threads call with other numbers.
run = compiled("contact")
factors = (1.0, 1.1, 1.0, 1.1)
calls = [(lambda f: bits(run(scene("contact", f))), factor) for factor in factors]
print(*asyncio.run(all_of(calls)))
"""


def test_threads_that_simulate_at_once(undisturbed):
    """The same scene and different ones, not yet compiled; then other numbers."""
    block, _, contact, warmer_contact = undisturbed
    words = printed(THREADS)
    assert words[:4] == [block, contact, block, contact]
    assert words[4:8] == [contact, warmer_contact] * 2
    assert words[8:] == undisturbed


@pytest.mark.slow
@pytest.mark.slice
def test_a_pool_of_spawned_processes(undisturbed, monkeypatch):
    """In a process in which JAX has started, as in a notebook."""
    block, _, contact, _ = undisturbed
    monkeypatch.setenv("JAX_ENABLE_X64", "1")
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=spawn) as pool:
        bits = list(pool.map(simulated, NAMES))
    assert bits == [block, contact, block, contact]


INTERRUPTS = """
import signal

import jax

# Imports all packages: one whose import is interrupted may be unusable in its process,
# since Python keeps those of its modules that were complete.
simulated("contact")
jax.clear_caches()
interrupts = 0
replaced = 0


def interrupt(*_):
    if running:
        raise KeyboardInterrupt


def completes(call, delay):
    # True if a call ends before it is interrupted [s].
    global running, interrupts, replaced
    running = True
    signal.setitimer(signal.ITIMER_REAL, delay)
    try:
        call()
        running = False
        return True
    except KeyboardInterrupt:
        interrupts += 1
        return False
    except Exception:
        # numpy may raise a TypeError in place of an interrupt, and the caches of JAX a
        # RecursionError until they are cleared.
        replaced += 1
        if replaced > interrupts:
            raise
        jax.clear_caches()
        return False
    finally:
        running = False
        signal.setitimer(signal.ITIMER_REAL, 0)


signal.signal(signal.SIGALRM, interrupt)
"""

FIRST_CALLS = """
for name in ("contact", "block"):
    delay = 0.005
    while not completes(lambda: simulated(name), delay):
        delay *= {growth}
print(interrupts)
"""


@pytest.mark.parametrize(
    ("growth", "least_interrupts"),
    [(2.0, 6), pytest.param(1.1, 30, marks=pytest.mark.slow)],
)
def test_interrupts_of_the_first_call(undisturbed, growth, least_interrupts):
    """In the search, the trace and the compilation, each time a little later."""
    words = printed(INTERRUPTS + FIRST_CALLS.format(growth=growth))
    assert int(words[0]) >= least_interrupts
    assert words[1:] == undisturbed


STEPS = """
run = compiled("contact")
long = jt.compile_simulation(scene("contact"), 1e4, solver=jt.ForwardEuler(dt=0.5))
long()
for delay in (0.001, 0.003, 0.01, 0.02, 0.04, 0.08):
    completes(lambda: long().surface_temperature.block_until_ready(), delay)
    print(bits(run()))
print(interrupts)
"""


def test_interrupts_of_the_steps(undisturbed):
    """The compiled simulation stays right, and others too."""
    words = printed(INTERRUPTS + STEPS)
    contact = undisturbed[2]
    assert words[:6] == [contact] * 6
    assert int(words[6]) >= 4
    assert words[7:] == undisturbed


FORK = """
import os
import warnings

simulated("block")
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    child = os.fork()
    if child == 0:
        os._exit(0)
os.waitpid(child, 0)
print(sum("os.fork" in str(warning.message) for warning in caught))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks do not exist here")
def test_a_fork_leaves_the_parent_right(undisturbed):
    """JAX warns that the child may hang; the child computes nothing here."""
    words = printed(FORK)
    assert int(words[0]) == 1
    assert words[1:] == undisturbed
