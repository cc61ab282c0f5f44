"""Voxelizing beside trimesh at the same pitch, in one run; cold and warm."""

import multiprocessing
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import trimesh

import jaxthermo as jt
from jaxthermo.timing import Timing, measure as measure_warm
from jaxthermo.user_cache import without_cache

from ..harness.meshes import thesis_meshes
from ..harness.present import show, table_of
from ..harness.timing import timed_call, timing_of


# Voxels along z: the thesis' 550 less a margin of one at each end.
_CELLS = 548


def _first_call(mesh: jt.Mesh, pitch: float) -> tuple[float, float]:
    # Wall and processor time [s] of a process' first voxelization, compiling it.
    processor = time.process_time()
    wall = timed_call(lambda: jt.voxelize(mesh, pitch))[1]
    return wall, time.process_time() - processor


def _cold(mesh: jt.Mesh, pitch: float, repeats: int) -> tuple[Timing, float]:
    """First calls in fresh processes, and the median of their processor time [s]."""
    fresh = multiprocessing.get_context("spawn")
    spans = []
    for _ in range(repeats):
        with ProcessPoolExecutor(1, mp_context=fresh) as pool:
            spans.append(pool.submit(_first_call, mesh, pitch).result())
    wall, processor = zip(*spans, strict=True)
    return timing_of(wall), statistics.median(processor)


def _peer(mesh: jt.Mesh, pitch: float, repeats: int) -> tuple[Timing, int]:
    """trimesh: surface voxels by cutting triangles up, then filled; and how many."""
    other = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    # Nothing of it is compiled, and one call takes long: no warm-up.
    cut = lambda: other.voxelized(pitch)
    fill = lambda: 0 if (voxels := cut()) is None else voxels.fill().filled_count
    calls = [timed_call(fill) for _ in range(repeats)]
    return timing_of([span for _, span in calls]), int(calls[-1][0])


def _measure(
    mesh: jt.Mesh, pitch: float, repeats: int = 5, peer_repeats: int = 1
) -> dict[str, Any]:
    """Times [s] of both, and the voxels that each finds.

    Args:
        mesh: the body.
        pitch: edge of a voxel [m].
        repeats: of ours; it is also run in up to three fresh processes.
        peer_repeats: of trimesh, which compiles nothing and takes long.
    """
    cold, cold_processor = _cold(mesh, pitch, min(repeats, 3))
    # Processor time counts all threads: how much of the speed is parallel.
    clock = time.process_time()
    with without_cache():
        warm = measure_warm(lambda: jt.voxelize(mesh, pitch), repeats)
    processor = (time.process_time() - clock) / (repeats + 1)
    grid = jt.voxelize(mesh, pitch)
    peer, filled = _peer(mesh, pitch, peer_repeats)
    rows = {"jaxthermo, first call": cold, "jaxthermo": warm, "trimesh": peer}
    columns = [
        ("", "{name}"),
        ("time (fastest-slowest)", lambda row: row["time"].text()),
        ("trimesh takes", lambda row: f"{peer.median / row['time'].median:.1f} x"),
    ]
    size = " x ".join(map(str, grid.lattice.shape))
    title = f"{mesh.name}, {len(mesh.faces)} triangles, to {size} voxels"
    lines = [{"name": name, "time": span} for name, span in rows.items()]
    show(table_of(lines, columns, title))
    return {
        "mesh": mesh.name,
        "faces": len(mesh.faces),
        "shape": list(grid.lattice.shape),
        "time_s": {name: row._asdict() for name, row in rows.items()},
        "processor_time_s": {"first call": cold_processor, "warm": processor},
        "solid_voxels": {"jaxthermo": grid.solid_count, "trimesh": filled},
        "times_faster": {
            "warm": peer.median / warm.median,
            "first call": peer.median / cold.median,
        },
    }


def run() -> dict[str, Any]:
    """The Happy Buddha, or what stands in for it, at the thesis' resolution."""
    mesh = next(iter(thesis_meshes().values()))
    return _measure(mesh, float(np.ptp(mesh.bounds[:, 2])) / _CELLS)
