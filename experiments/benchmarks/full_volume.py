"""Full volume with its surface in the sun and in air, beside the same scene in numba.

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
from ..harness.measurement import Measurement, PlainMeasurement, plain_rows
from ..harness.meshes import HEIGHT, START, STEEL, thesis_meshes
from .loops import NUMBA, largest_difference, loop_of, numba_explicit, numba_rkl2


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
_BOUND = 0.75
"""Speed relative to numba that a kernel must have."""


class _Method(NamedTuple):
    """A way to step, for so many evaluations."""

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


class _Result(TypedDict):
    rows: list[_Row]
    measurements: list[PlainMeasurement]


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
    name, mesh = next(iter(thesis_meshes().items()))
    edge = _CUBE_PITCH * _CUBE
    cube = jt.voxelize(jt.shapes.box((edge, edge, edge)), _CUBE_PITCH)
    statue = jt.voxelize(mesh, HEIGHT / height)
    shape = " x ".join(map(str, statue.lattice.shape))
    bodies = {f"cube, {_CUBE}^3, in cache": cube, f"{name}, {shape}": statue}
    measurements = []
    results = []
    for label, grid in bodies.items():
        rows, body_results = _measured(label, grid=grid, repeats=repeats, work=work)
        measurements += rows
        results += body_results
    return {"rows": results, "measurements": plain_rows(measurements)}


def _scene(structure: Any) -> jt.Scene:
    body = jt.Body(structure, STEEL, temperature=START)
    terms = jt.Sun((-1.0, 0.0, 0.0), 5000.0), jt.Convection(10.0, START)
    return jt.Scene((body,), terms)


def _methods(stable: float, count: int) -> dict[str, _Method]:
    """Explicit steps and RKL2 of about so many evaluations."""
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
    scene = _scene(jt.FullVolume(grid))
    nodes = grid.solid_count
    count = int(np.clip(work / nodes, _FEWEST, _MOST))
    stable = plan_run(scene, t1=1.0, save_at=None, solver=jt.ForwardEuler()).stable_step
    assert stable is not None
    rows: list[Measurement] = []
    results: list[_Row] = []
    for task, method in _methods(stable, count).items():
        plan = plan_run(scene, t1=method.end, save_at=None, solver=method.solver)
        peer = method.peer(scene)
        state = np.asarray(initial_state(plan).theta[0])
        compiled = _scene(jt.FullVolume(grid, kernels="numba"))
        inside = plan_run(compiled, t1=method.end, save_at=None, solver=method.solver)
        calls = {
            "ours": loop_of(plan),
            "kernels": loop_of(inside),
            "numba": peer.call,
            "copy": _copies(state),
        }
        if nodes <= _MOST_LINKED:
            linked = _scene(jt.FullVolume(grid, stencil=False))
            calls["links"] = loop_of(
                plan_run(linked, t1=method.end, save_at=None, solver=method.solver)
            )
        difference = max(
            largest_difference(own_plan, peer) for own_plan in (plan, inside)
        )
        spans = _per_step(interleaved(calls, repeats), method.steps)
        cells = len(grid.fragment_area)
        note = (
            f"{nodes:,} nodes, {cells:,} surface cells; all surfaces agree to "
            f"{difference:.1g} K"
        )
        rows += _rows(f"{label}: {task}", spans, note)
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


def _per_step(spans: Spans, steps: int) -> Spans:
    counts = {"copy": _COPIES}
    return {
        name: [span / counts.get(name, steps) for span in call_spans]
        for name, call_spans in spans.items()
    }


def _rows(name: str, spans: Spans, note: str) -> list[Measurement]:
    ours = spans["ours"]
    copy = "copy of the state, one thread"
    within = f"{name}, kernels of numba"
    peer = spans["numba"]
    rows = [
        Measurement(
            name=name,
            unit="s",
            ours=ours,
            peer_name=NUMBA,
            peer=peer,
            bound=_BOUND,
            note=note,
        ),
        Measurement(
            name=within,
            unit="s",
            ours=spans["kernels"],
            peer_name=NUMBA,
            peer=peer,
            bound=_BOUND,
            note=note,
        ),
        Measurement(
            name=name,
            unit="s",
            ours=ours,
            peer_name=copy,
            peer=spans["copy"],
            overhead=True,
        ),
    ]
    if "links" in spans:
        rows.append(
            Measurement(
                name=name,
                unit="s",
                ours=ours,
                peer_name="its links",
                peer=spans["links"],
            )
        )
    return rows
