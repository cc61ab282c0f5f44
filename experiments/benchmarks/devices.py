"""A full volume on devices of one process and on two processes, compared with one.

Each arrangement has processes of its own, which wait for each other's turns, so that
all see the same state of the machine, and must give the same temperatures. Where there
are no other devices, those of one process are parts of its processor; a device alone
uses all cores. Besides, what larger bodies would take on many devices, on paper.
"""

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, NamedTuple, TypedDict

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.host_memory import readable_bytes
from jaxthermo.integrate.explicit import RKL2Stepper, stable_length
from jaxthermo.integrate.run.plan import Plan, initial_state, plan_run
from jaxthermo.integrate.run.segments import begin_run, run_segments
from jaxthermo.parallel.devices import provide_devices
from jaxthermo.parallel.meeting import Group, free_port
from jaxthermo.parallel.processes import join, watching_others
from jaxthermo.scene.compile.on_devices import on_devices
from jaxthermo.structures.structure import AbstractStructure

from ..harness.agreement import largest_difference
from ..harness.measurement import (
    MeasuredResult,
    Measurement,
    compared,
    plain_rows,
    time_unit,
)
from ..harness.meshes import STEEL
from ..harness.present import show, table_of
from .scaling_model import PaperRow, on_paper


QUICK = {"shape": (24, 56, 24), "repeats": 2, "steps": 6}
_PITCH = 1e-3
_ASKED = 0.9
"""Speed relative to one device that two processes must reach."""
_LARGEST_SHARE = 0.6
"""Share of the lattice that a process of two may have."""
_SAMPLES = 1000
"""Number of nodes that are compared."""
_MAX_DIFFERENCE = 1e-3
"""Largest difference of their temperatures after a turn, from a range of 100 K [K]."""
_RKL2 = "conduction, stages of RKL2"
_TERMS: dict[str, tuple[jt.Convection, ...]] = {
    "conduction": (),
    "conduction and convection": (jt.Convection(50.0, 280.0),),
    _RKL2: (),
}


class _Arrangement(NamedTuple):
    name: str
    devices: int
    processes: int


class _Reply(TypedDict, total=False):
    """Report of a process: its lattice when it is ready, then each turn's time."""

    lattice_bytes: int
    sample: dict[str, float]
    """Temperatures of some nodes of its part after a turn, by their numbers [K]."""
    step_s: float


class _Row(TypedDict):
    """Times of one arrangement."""

    scene: str
    arrangement: str
    devices: int
    processes: int
    step_s: list[float]
    lattice_bytes: int


class _Result(MeasuredResult):
    rows: list[_Row]
    on_paper: list[PaperRow]


_ALONE = _Arrangement("one device", 1, 1)
_ARRANGEMENTS = (
    _ALONE,
    _Arrangement("two devices, one process", 2, 1),
    _Arrangement("two processes", 2, 2),
    _Arrangement("four devices, one process", 4, 1),
)


def run(
    folder: Path,
    shape: Sequence[int] = (228, 550, 228),
    repeats: int = 5,
    steps: int = 20,
    scenes: Sequence[str] = tuple(_TERMS),
) -> _Result:
    """Time of an explicit step or a stage of RKL2, and the lattice that a process has.

    Args:
        folder: of the result.
        shape: of the box, in voxels.
        repeats: of every turn.
        steps: of a turn; with RKL2 about the number of stages of its one step.
        scenes: to measure.
    """
    results = [
        row
        for surface in scenes
        for row in _measured(surface, shape=shape, repeats=repeats, steps=steps)
    ]
    columns = [
        ("scene", "{scene}"),
        ("arrangement", "{arrangement}"),
        ("step or stage", lambda row: f"{1e3 * min(row['step_s']):.3g} ms"),
        ("lattice of a process", lambda row: readable_bytes(row["lattice_bytes"])),
    ]
    voxels = " x ".join(map(str, shape))
    show(table_of(results, columns, f"Steps or stages of a box of {voxels} voxels"))
    paper = on_paper()
    _show_paper(paper)
    measurements = plain_rows(_measurements(results))
    return {"rows": results, "on_paper": paper, "measurements": measurements}


def _show_paper(rows: list[PaperRow]) -> None:
    columns = [
        ("voxels", "{voxels:.0e}"),
        ("machine", "{machine}"),
        ("fewest devices", "{fewest:,}"),
        ("step", lambda row: _time(row["step_on_fewest_s"])),
        ("useful devices", "{useful:,}"),
        ("step", lambda row: _time(row["step_on_useful_s"])),
        ("planes", lambda row: _time(row["planes_s"])),
        ("of blocks", lambda row: _time(row["blocks_s"])),
    ]
    show(table_of(rows, columns, "On paper: explicit steps of a cube in sections"))


def _time(seconds: float) -> str:
    unit, factor = time_unit(seconds)
    return f"{factor * seconds:.3g} {unit}"


def _measurements(results: list[_Row]) -> list[Measurement]:
    measurements = []
    references = [row for row in results if row["arrangement"] == _ALONE.name]
    alone_by_scene = {row["scene"]: row for row in references}
    for row in results:
        if row in references:
            continue
        alone = alone_by_scene[row["scene"]]
        share = row["lattice_bytes"] / alone["lattice_bytes"]
        is_pair = row["processes"] == 2
        name = f"{row['scene']}: {row['arrangement']}"
        measurements += compared(
            name=name,
            ours=row["step_s"],
            peers={_ALONE.name: alone["step_s"]},
            bound=_ASKED if is_pair else None,
            note=f"{100 * share:.0f} % of the lattice in each process",
        )
        if is_pair:
            percent = [100 * share]
            bound = 100 * _LARGEST_SHARE
            measurements.append(
                Measurement(f"{name}: lattice", "%", percent, bound=bound)
            )
    return measurements


class _Worker(NamedTuple):
    """A process that takes its turn when it is told."""

    turns: IO[str]
    results: IO[str]

    def begin(self, words: str) -> None:
        self.turns.write(words + "\n")
        self.turns.flush()

    def reply(self) -> _Reply:
        # Libraries may print besides.
        for line in self.results:
            if line.startswith("{"):
                return json.loads(line)
        raise RuntimeError("a process of the benchmark ended; see above")


def _measured(
    surface: str, shape: Sequence[int], repeats: int, steps: int
) -> list[_Row]:
    with ExitStack() as stack:
        workers = {}
        for arrangement in _ARRANGEMENTS:
            port = free_port()
            workers[arrangement] = [
                _start(
                    stack,
                    arrangement=arrangement,
                    port=port,
                    process=process,
                    surface=surface,
                    shape=shape,
                    steps=steps,
                )
                for process in range(arrangement.processes)
            ]
        ready = {
            arrangement: [worker.reply() for worker in processes]
            for arrangement, processes in workers.items()
        }
        samples = {
            arrangement: {k: v for row in replies for k, v in row["sample"].items()}
            for arrangement, replies in ready.items()
        }
        numbers = sorted(samples[_ALONE])
        largest_difference(
            f"{surface}: temperatures",
            {
                arrangement.name: [sample.get(cell, np.nan) for cell in numbers]
                for arrangement, sample in samples.items()
            },
            tolerance=_MAX_DIFFERENCE,
            unit="K",
        )
        spans: dict[_Arrangement, list[float]] = {
            arrangement: [] for arrangement in workers
        }
        for _ in range(repeats):
            for arrangement, processes in workers.items():
                for worker in processes:
                    worker.begin("go")
                spans[arrangement].append(
                    max(worker.reply()["step_s"] for worker in processes)
                )
        for processes in workers.values():
            for worker in processes:
                worker.begin("end")
    return [
        {
            "scene": surface,
            "arrangement": arrangement.name,
            "devices": arrangement.devices,
            "processes": arrangement.processes,
            "step_s": spans[arrangement],
            "lattice_bytes": max(row["lattice_bytes"] for row in ready[arrangement]),
        }
        for arrangement in workers
    ]


def _start(
    stack: ExitStack,
    arrangement: _Arrangement,
    port: int,
    process: int,
    surface: str,
    shape: Sequence[int],
    steps: int,
) -> _Worker:
    options = [*arrangement, port, process, surface, list(shape), steps]
    # Of the processes of a group each makes its own devices.
    flags = re.sub(r"--xla_force\S*", "", os.environ.get("XLA_FLAGS", ""))
    worker = stack.enter_context(
        subprocess.Popen(
            [sys.executable, "-m", __name__, json.dumps(options)],
            env={"TF_CPP_MIN_LOG_LEVEL": "3", **os.environ, "XLA_FLAGS": flags},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
    )
    assert worker.stdin is not None and worker.stdout is not None
    return _Worker(worker.stdin, worker.stdout)


def _work(
    name: str,
    devices: int,
    processes: int,
    port: int,
    process: int,
    surface: str,
    shape: Sequence[int],
    steps: int,
) -> None:
    """Take the steps of a turn for every line that comes."""
    provide_devices(devices // processes)
    if processes > 1:
        join(Group(f"localhost:{port}", processes, process), name)
    x, y, z = (_PITCH * n for n in shape)
    grid = jt.voxelize(jt.shapes.box((x, y, z)), _PITCH, "dominant_axis")
    body = jt.Body(jt.FullVolume(grid), STEEL, temperature=_warm_in_stripes)
    scene = on_devices(jt.Scene((body,), _TERMS[surface]), devices)
    plan, count = _plan(scene, surface == _RKL2, steps)
    state = initial_state(plan).theta[0]
    local_bytes = sum(shard.data.nbytes for shard in state.addressable_shards)
    sample = _sample(_take(plan).state, plan.scene.bodies[0].structure)
    reply: _Reply = {"lattice_bytes": local_bytes, "sample": sample}
    sys.stdout.write(json.dumps(reply) + "\n")
    sys.stdout.flush()
    # They end together: JAX reports one that is gone before the others as a failure.
    with watching_others("run the benchmark again"):
        while sys.stdin.readline().strip() == "go":
            result = {"step_s": _take(plan).seconds / count}
            sys.stdout.write(json.dumps(result) + "\n")
            sys.stdout.flush()


def _plan(scene: jt.Scene, in_stages: bool, steps: int) -> tuple[Plan, int]:
    """Plan of a turn, and its number of steps or stages."""
    stable = plan_run(scene, t1=1.0, save_at=None, solver=jt.ForwardEuler()).stable_step
    assert stable is not None
    if not in_stages:
        dt = 0.9 * stable
        solver = jt.ForwardEuler(dt)
        plan = plan_run(scene, t1=steps * dt, save_at=None, solver=solver)
        return plan, steps
    dt = 0.9 * stable_length(steps) * stable
    plan = plan_run(scene, t1=dt, save_at=None, solver=jt.SuperTimeStepping(dt))
    assert isinstance(plan.stepper, RKL2Stepper)
    return plan, plan.stepper.stages_taken


def _warm_in_stripes(points: np.ndarray) -> np.ndarray:
    """Temperatures of 250 to 350 K that change along every axis, in some voxels."""
    return 300.0 + 50.0 * np.sin(points.sum(axis=1) / (2 * _PITCH))


class _Taken(NamedTuple):
    """All steps of a plan."""

    state: jax.Array
    """State of the body at their end."""
    seconds: float


def _sample(state: jax.Array, structure: AbstractStructure) -> dict[str, float]:
    """Values of some nodes in this process' part of a state, by their numbers."""
    nodes = np.linspace(0, structure.node_count - 1, _SAMPLES).astype(int)
    address = np.stack([axis[nodes] for axis in structure.node_address()])
    sample = {}
    for shard in state.addressable_shards:
        values = np.asarray(shard.data)
        corner = np.array([[axis.start or 0] for axis in shard.index])
        local = address - corner
        is_local = ((local >= 0) & (local < np.array(values.shape)[:, None])).all(
            axis=0
        )
        sampled = values[tuple(local[:, is_local])]
        sample |= dict(zip(map(str, nodes[is_local]), sampled.tolist(), strict=True))
    return sample


def _take(plan: Plan) -> _Taken:
    """Take all steps of a plan."""
    ready = begin_run(plan)
    jax.block_until_ready(ready.state.theta)
    clock = time.perf_counter()
    *_, last = run_segments(plan, ready, seconds=jnp.inf)
    jax.block_until_ready(last.state.theta)
    seconds = time.perf_counter() - clock
    return _Taken(last.state.theta[0], seconds)


if __name__ == "__main__":
    _work(*json.loads(sys.argv[1]))
