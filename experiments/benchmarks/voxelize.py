"""Voxelization compared with trimesh at the same pitch, cold and warm, in one run."""

import time

import numpy as np
import trimesh

import jaxthermo as jt
from jaxthermo.timing import interleaved, timed_call

from ..harness.measurement import MeasuredResult, compared, plain_rows
from ..harness.meshes import thesis_meshes
from ..harness.processes import in_new_process


QUICK = {"height": 100, "repeats": 2}

# Voxels along z: the thesis' 550 less a margin of one at each end.
_CELLS = 548


def _first_call(mesh: jt.Mesh, pitch: float) -> tuple[float, float]:
    # Wall and processor time [s] of a process' first voxelization, compiling it.
    processor = time.process_time()
    wall = timed_call(lambda: jt.voxelize(mesh, pitch))[1]
    return wall, time.process_time() - processor


def _peer(mesh: jt.Mesh, pitch: float) -> tuple[int, float]:
    """Voxels that trimesh cuts and fills, and how long it takes [s]."""
    peer_mesh = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)

    def fill() -> int:
        voxels = peer_mesh.voxelized(pitch)
        return 0 if voxels is None else int(voxels.fill().filled_count)

    return timed_call(fill)


class _Result(MeasuredResult):
    mesh: str
    faces: int
    shape: list[int]
    processor_time_s: dict[str, float | list[float]]
    solid_voxels: dict[str, int]


def run(height: int = _CELLS, repeats: int = 5) -> _Result:
    """Times of both for the Happy Buddha, or what stands in for it."""
    mesh = next(iter(thesis_meshes().values()))
    pitch = float(np.ptp(mesh.bounds[:, 2])) / height
    first_calls = [
        in_new_process(_first_call, mesh, pitch) for _ in range(min(repeats, 3))
    ]
    cold, cold_processor = map(list, zip(*first_calls, strict=True))
    # Processor time counts all threads: how much of the speed is parallel.
    clock = time.process_time()
    spans = interleaved({"warm": lambda: jt.voxelize(mesh, pitch)}, repeats)
    warm = spans["warm"]
    processor = (time.process_time() - clock) / (repeats + 1)
    grid = jt.voxelize(mesh, pitch)
    # Once: nothing of it is compiled, and a call takes half a minute.
    filled, span = _peer(mesh, pitch)
    size = " x ".join(map(str, grid.lattice.shape))
    counts = f"{grid.solid_count:,} solid voxels, of the peer {filled:,}"
    note = f"{len(mesh.faces):,} triangles; {counts}"
    name = f"{mesh.name} to {size} voxels"
    peers = {"trimesh, filled, once": [span]}
    measured = [
        *compared(name=f"{name}: first call", ours=cold, peers=peers, note=note),
        *compared(f"{name}: further calls", warm, peers),
    ]
    return {
        "mesh": mesh.name,
        "faces": len(mesh.faces),
        "shape": list(grid.lattice.shape),
        "processor_time_s": {"first call": cold_processor, "warm": processor},
        "solid_voxels": {"jaxthermo": grid.solid_count, "trimesh": filled},
        "measurements": plain_rows(measured),
    }
