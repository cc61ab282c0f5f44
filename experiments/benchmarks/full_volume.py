"""Full volume with its surface in sun and air, compared with the same in numba.

Cut voxels, open areas and loads are the same. A cube that a cache holds and a statue
that none does; explicit steps and RKL2, as stencils of XLA and with kernels of numba;
besides a copy of the state, and, in bodies that are not too large, the links that both
stand for.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

import numpy as np

import jaxthermo as jt
from jaxthermo.integrate.run.plan import initial_state, plan_run
from jaxthermo.timing import Spans, interleaved
from jaxthermo.voxels.grid import VoxelGrid

from ..front.linear_body import Run
from ..harness.agreement import largest_difference
from ..harness.measurement import MeasuredResult, Measurement, plain_rows
from ..harness.meshes import standard_scene, statue
from ..harness.scenes import stable_step
from .loops import (
    kernel_rows,
    last_surface,
    loop_of,
    numba_explicit,
    numba_rkl2,
    per_item,
)


QUICK = {"height": 60, "repeats": 2, "work": 2e7}

_CUBE = 64
_CUBE_PITCH = 0.002
"""Voxels along each edge, and their size [m]."""
_STAGES = 11
_STABLE_STEPS = 32.4
"""Stages of a step of RKL2, and its length in stable steps: they would cover 32.5."""
_FEWEST = 22
_MOST = 1100
"""Numbers of evaluations of a call."""
_MOST_LINKED = 4_000_000
"""Nodes up to which there are links, which take a hundred bytes each to set up."""
_COPIES = 10
_MAX_DIFFERENCE = 1e-2
"""Largest difference of surface temperatures of two forms at the end [K]."""
_BOUND = 0.75
"""Speed relative to numba that a kernel must have."""


class _Method(NamedTuple):
    """A way to step, with its number of evaluations."""

    end: float
    solver: Any
    steps: int
    peer: Callable[[jt.Scene], Run]


class _Row(TypedDict):
    """Times of one task in one body."""

    body: str
    what: str
    nodes: int
    evaluations: int
    step_s: Spans
    largest_difference_K: float


class _Result(MeasuredResult):
    rows: list[_Row]


def run(
    folder: Path, height: int = 548, repeats: int = 5, work: float = 2.5e8
) -> _Result:
    """Times of an explicit step and of a stage of RKL2 in both bodies.

    Args:
        folder: of the result.
        height: of the statue, in voxels.
        repeats: of every call.
        work: nodes times evaluations of a call.
    """
    name, voxels = statue(height)
    edge = _CUBE_PITCH * _CUBE
    cube = jt.voxelize(jt.shapes.box((edge, edge, edge)), _CUBE_PITCH)
    shape = " x ".join(map(str, voxels.lattice.shape))
    bodies = {f"cube, {_CUBE}^3, in cache": cube, f"{name}, {shape}": voxels}
    measurements = []
    results = []
    for label, grid in bodies.items():
        rows, body_results = _measured(label, grid=grid, repeats=repeats, work=work)
        measurements += rows
        results += body_results
    return {"rows": results, "measurements": plain_rows(measurements)}


def _scene(structure: jt.FullVolume) -> jt.Scene:
    return standard_scene(structure, sunset=None)


def _methods(stable: float, count: int) -> dict[str, _Method]:
    """Explicit steps and RKL2 of about `count` evaluations."""
    dt = _STABLE_STEPS * stable
    steps = max(1, count // _STAGES)
    end = count * stable
    long = steps * dt
    return {
        "explicit step": _Method(
            end=end,
            solver=jt.ForwardEuler(),
            steps=count,
            peer=lambda scene: numba_explicit(scene, end),
        ),
        "stage of RKL2": _Method(
            end=long,
            solver=jt.SuperTimeStepping(dt=dt),
            steps=steps * _STAGES,
            peer=lambda scene: numba_rkl2(scene, long, dt),
        ),
    }


def _measured(
    label: str, grid: VoxelGrid, repeats: int, work: float
) -> tuple[list[Measurement], list[_Row]]:
    scenes = {
        "ours": _scene(jt.FullVolume(grid)),
        "kernels": _scene(jt.FullVolume(grid, kernels="numba")),
    }
    nodes = grid.solid_count
    if nodes <= _MOST_LINKED:
        scenes["links"] = _scene(jt.FullVolume(grid, stencil=False))
    scene = scenes["ours"]
    count = int(np.clip(work / nodes, _FEWEST, _MOST))
    rows: list[Measurement] = []
    results: list[_Row] = []
    for task, method in _methods(stable_step(scene), count).items():
        plans = {
            name: plan_run(form, t1=method.end, save_at=None, solver=method.solver)
            for name, form in scenes.items()
        }
        peer = method.peer(scene)
        state = np.asarray(initial_state(plans["ours"]).theta[0])
        calls = {
            **{name: loop_of(plan) for name, plan in plans.items()},
            "numba": peer.call,
            "copy": _copies(state),
        }
        # A run without times to save has saved its end.
        surfaces = {"numba": peer.call()[-1]}
        surfaces |= {name: last_surface(plan) for name, plan in plans.items()}
        difference = largest_difference(
            f"{label}: surface after {task}s",
            surfaces,
            tolerance=_MAX_DIFFERENCE,
            unit="K",
        )
        steps = {**dict.fromkeys(calls, method.steps), "copy": _COPIES}
        spans = per_item(interleaved(calls, repeats), steps)
        cells = len(grid.fragment_area)
        note = (
            f"{nodes:,} nodes, {cells:,} surface cells; all surfaces agree to "
            f"{difference:.1g} K"
        )
        peers = {"copy": "copy of the state, one thread", "links": "its links"}
        rows += kernel_rows(
            name=f"{label}: {task}",
            spans=spans,
            bound=_BOUND,
            notes={"ours": note, "kernels": note},
            slower_forms={form: peer for form, peer in peers.items() if form in spans},
        )
        results.append(
            {
                "body": label,
                "what": task,
                "nodes": nodes,
                "evaluations": method.steps,
                "step_s": spans,
                "largest_difference_K": difference,
            }
        )
    return rows, results


def _copies(state: np.ndarray) -> Callable[[], None]:
    copy = np.empty_like(state)

    def copies() -> None:
        for _ in range(_COPIES):
            np.copyto(copy, state)

    return copies
