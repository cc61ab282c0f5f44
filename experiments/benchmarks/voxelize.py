"""Voxelizing beside trimesh at the same pitch, in one run; cold and warm."""

import multiprocessing
import os
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from rich.console import Console

from jaxthermo.geometry.load import load_mesh
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.geometry.shapes import figurine
from jaxthermo.report.table import Table
from jaxthermo.timing import Timing, measure as measure_warm
from jaxthermo.voxels.voxelize import voxelize

from ..harness.timing import timing_of


CELLS = 548
"""Voxels along z: the thesis' 550 less a margin of one at each end."""


def _standard_mesh() -> Mesh:
    """The Happy Buddha where it is at hand, else the built-in figurine."""
    folder = Path(os.environ.get("JAXTHERMO_MESHES", "../shared/meshes"))
    path = folder / "happy-buddha.obj"
    return load_mesh(path, height=0.5, up="y") if path.is_file() else figurine(0.5)


def _first_call(mesh: Mesh, pitch: float) -> tuple[float, float]:
    """Wall and processor time [s] of a process' first voxelization, compiling it."""
    clock, processor = time.perf_counter(), time.process_time()
    voxelize(mesh, pitch)
    return time.perf_counter() - clock, time.process_time() - processor


def _cold(mesh: Mesh, pitch: float, repeats: int) -> tuple[Timing, float]:
    """First calls in fresh processes, and the median of their processor time [s]."""
    fresh = multiprocessing.get_context("spawn")
    spans = []
    for _ in range(repeats):
        with ProcessPoolExecutor(1, mp_context=fresh) as pool:
            spans.append(pool.submit(_first_call, mesh, pitch).result())
    wall, processor = zip(*spans, strict=True)
    return timing_of(wall), statistics.median(processor)


def _peer(mesh: Mesh, pitch: float, repeats: int) -> tuple[Timing, int]:
    """trimesh: surface voxels by cutting triangles up, then filled; and how many."""
    other = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    spans, filled = [], 0
    for _ in range(repeats):
        clock = time.perf_counter()
        voxels = other.voxelized(pitch)
        filled = int(voxels.fill().filled_count) if voxels is not None else 0
        spans.append(time.perf_counter() - clock)
    return timing_of(spans), filled


def measure(
    mesh: Mesh, pitch: float, repeats: int = 5, peer_repeats: int = 1
) -> dict[str, Any]:
    """Times [s] of both, and the voxels that each finds.

    Args:
        mesh: the body.
        pitch: edge of a voxel [m].
        repeats: of ours; it is also run in up to three fresh processes.
        peer_repeats: of trimesh, which compiles nothing and takes long.
    """
    cold, cold_processor = _cold(mesh, pitch, min(repeats, 3))
    clock = time.process_time()
    warm = measure_warm(lambda: voxelize(mesh, pitch), repeats)
    processor = (time.process_time() - clock) / (repeats + 1)
    grid = voxelize(mesh, pitch)
    peer, filled = _peer(mesh, pitch, peer_repeats)
    rows = {"jaxthermo, first call": cold, "jaxthermo": warm, "trimesh": peer}
    _show(mesh, grid.lattice.shape, rows)
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
    """The standard mesh at the thesis' resolution."""
    mesh = _standard_mesh()
    return measure(mesh, float(np.ptp(mesh.bounds[:, 2])) / CELLS)


def _show(mesh: Mesh, shape: tuple[int, int, int], rows: dict[str, Timing]) -> None:
    size = " x ".join(str(n) for n in shape)
    lines = [
        [name, row.text(), f"{rows['trimesh'].median / row.median:.1f} x"]
        for name, row in rows.items()
    ]
    columns = ("", "time (fastest-slowest)", "trimesh takes")
    title = f"{mesh.name}, {len(mesh.faces)} triangles, to {size} voxels"
    Console().print(Table(columns, lines, title).rich())
