"""Voxelization compared with trimesh at the same pitch, cold and warm, in one run.

Ours are the voxels whose centre is inside; trimesh's are all that the surface touches,
and those within. The errors of both volumes are stated against that of the mesh, which
must lie between trimesh's voxels within and all of them.
"""

import time
from typing import NamedTuple

import numpy as np
import trimesh

import jaxthermo as jt
from jaxthermo.timing import interleaved, timed_call

from ..harness.agreement import require_within
from ..harness.measurement import MeasuredResult, compared, plain_rows
from ..harness.meshes import thesis_meshes
from ..harness.processes import in_new_process


QUICK = {"height": 100, "repeats": 2}

# Voxels along z: the thesis' 550 less a margin of one at each end.
_CELLS = 548
_MAX_ERROR = 1.0
"""Largest error of the volume of our voxels [%]."""


def _first_call(mesh: jt.Mesh, pitch: float) -> tuple[float, float]:
    # Wall and processor time [s] of a process' first voxelization, compiling it.
    processor = time.process_time()
    wall = timed_call(lambda: jt.voxelize(mesh, pitch))[1]
    return wall, time.process_time() - processor


class _Filled(NamedTuple):
    """Voxels of trimesh."""

    touched: int
    """Number of voxels that the surface touches."""
    filled: int
    """Number of these and of those within."""
    seconds: float


def _peer(mesh: jt.Mesh, pitch: float) -> _Filled:
    """Voxels that trimesh cuts and fills."""
    peer_mesh = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)

    def fill() -> tuple[int, int]:
        voxels = peer_mesh.voxelized(pitch)
        if voxels is None:
            return 0, 0
        touched = int(voxels.filled_count)
        return touched, int(voxels.fill().filled_count)

    (touched, filled), seconds = timed_call(fill)
    return _Filled(touched=touched, filled=filled, seconds=seconds)


class _Result(MeasuredResult):
    mesh: str
    faces: int
    shape: list[int]
    processor_time_s: dict[str, float | list[float]]
    solid_voxels: dict[str, int]
    volume_error_percent: dict[str, float]


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
    peer = _peer(mesh, pitch)
    errors = _volume_errors(mesh, grid, peer)
    size = " x ".join(map(str, grid.lattice.shape))
    counts = f"{grid.solid_count:,} solid voxels, of the peer {peer.filled:,}"
    volumes = (
        f"error of the volume {errors['jaxthermo']:+.2g} %, of the peer "
        f"{errors['trimesh']:+.2g} %"
    )
    note = f"{len(mesh.faces):,} triangles; {counts}; {volumes}"
    name = f"{mesh.name} to {size} voxels"
    peers = {"trimesh, filled, once": [peer.seconds]}
    measured = [
        *compared(name=f"{name}: first call", ours=cold, peers=peers, note=note),
        *compared(f"{name}: further calls", warm, peers),
    ]
    return {
        "mesh": mesh.name,
        "faces": len(mesh.faces),
        "shape": list(grid.lattice.shape),
        "processor_time_s": {"first call": cold_processor, "warm": processor},
        "solid_voxels": {"jaxthermo": grid.solid_count, "trimesh": peer.filled},
        "volume_error_percent": errors,
        "measurements": plain_rows(measured),
    }


def _volume_errors(
    mesh: jt.Mesh, grid: jt.VoxelGrid, peer: _Filled
) -> dict[str, float]:
    """Error of the volume of whole voxels against that of the mesh [%].

    Raises:
        DisagreementError: if ours is too large, or the volume of the mesh is not
            between that of trimesh's voxels within and that of all of them.
    """
    exact = mesh.volume / grid.pitch**3
    ours = 100 * (grid.solid_count / exact - 1)
    require_within("error of the volume", abs(ours), tolerance=_MAX_ERROR, unit="%")
    within = peer.filled - peer.touched
    require_within("voxels of trimesh within", within, tolerance=exact)
    require_within("voxels in the volume", exact, tolerance=peer.filled)
    return {"jaxthermo": ours, "trimesh": 100 * (peer.filled / exact - 1)}
