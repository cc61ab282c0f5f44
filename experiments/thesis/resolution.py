"""Voxels, time of a step and error of the thesis' structures over the resolution.

Two counts are told apart. Occupied: voxels, cells or texels that stand for a piece of
the body. Allocated: all that arrays hold, which the thesis' textures compute as well:
the whole box of the full volume, and every texel of the packed layers along x, y and z.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

import jaxthermo as jt
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.timing import Spread, interleaved, ratio_of

from ..benchmarks.mixed import Runner, scene_runner
from ..benchmarks.steps import conduction_call
from ..harness.meshes import voxels_high
from ..harness.power_law import power
from .bodies import required_statue
from .exhibit import Numbers
from .sunlit import Sunlit
from .table_6_1 import FULL, IRREGULAR, SHELL, TEN


def _ten_levels(grid: jt.VoxelGrid) -> AbstractStructure:
    return jt.MultiLevel(grid, levels=10)


BUILDS: Mapping[str, Callable[[jt.VoxelGrid], AbstractStructure]] = {
    SHELL: jt.SingleShell,
    IRREGULAR: jt.IrregularMultiLevel,
    TEN: _ten_levels,
    FULL: jt.FullVolume,
}
"""The thesis' four structures."""

# Nodes times steps of a timed call, and its largest number of steps.
_WORK = 4e7
_MAX_STEPS = 400
_REPEATS = 3
# A step of a whole scene takes as long whatever its length [s]. Its calls are short, so
# that some of many are not disturbed by what else the machine does.
_DT = 1e-3
_SCENE_WORK = 5e5
_MAX_SCENE_STEPS = 60


@cache
def counts(mesh_name: str, height: int) -> Numbers:
    """Occupied and allocated counts of a mesh that is `height` voxels high."""
    grid = _body(mesh_name, height).grid
    box = grid.lattice.cells
    body = grid.solid_count
    shell = jt.SingleShell(grid).node_count
    irregular = jt.IrregularMultiLevel(grid)
    view_cells = [box // size for size in grid.lattice.shape]
    texels_peeled = int(np.dot(grid.layers.peeled, view_cells))
    texels_packed = int(np.dot(grid.layers.packed, view_cells))
    occupied = sum(int(grid.is_packed(axis).sum()) for axis in range(3))
    # Each level is said to be stored as the one above at half the resolution.
    levels = sum(0.25**level for level in range(irregular.level_count))
    texels_irregular = round(texels_packed * levels)
    return {
        "mesh": mesh_name,
        "height_voxels": height,
        "lattice_shape": list(grid.lattice.shape),
        "box": box,
        "body": body,
        "shell": shell,
        "shell_of_body": shell / body,
        "shell_of_box": shell / box,
        "irregular": irregular.node_count,
        "irregular_levels": irregular.level_count,
        "irregular_of_body": irregular.node_count / body,
        "irregular_of_box": irregular.node_count / box,
        "layers_peeled": list(grid.layers.peeled),
        "layers_packed": list(grid.layers.packed),
        "fragments": len(grid.fragment_area),
        "texels_occupied": occupied,
        "texels_peeled": texels_peeled,
        "texels_shell": texels_packed,
        "texels_irregular": texels_irregular,
        "texels_shell_of_box": texels_packed / box,
        "texels_irregular_of_box": texels_irregular / box,
        "fill": occupied / texels_packed,
    }


@cache
def _body(mesh_name: str, height: int) -> Sunlit:
    return Sunlit(voxels_high(required_statue(mesh_name).mesh, height))


class StepTimes(NamedTuple):
    """Times of a step of conduction at one resolution, by structure."""

    mesh: str
    height: int
    """Voxels along up."""
    nodes: dict[str, int]
    step_s: dict[str, list[float]]
    """Every repeat."""
    times_faster: dict[str, Spread]
    """Ratio of the full volume's time to that of each."""

    def median(self, structure: str) -> float:
        """Median time of a step of a structure [s]."""
        return float(np.median(self.step_s[structure]))


@cache
def step_times(mesh_name: str, height: int) -> StepTimes:
    """Times of a step of conduction of the four structures, measured in turn [s]."""
    grid = _body(mesh_name, height).grid
    structures = {name: build(grid) for name, build in BUILDS.items()}
    nodes = {name: structure.node_count for name, structure in structures.items()}
    steps = {
        name: int(np.clip(_WORK / count, 4, _MAX_STEPS)) // 2 * 2
        for name, count in nodes.items()
    }
    calls = {
        name: conduction_call(structure, steps[name])
        for name, structure in structures.items()
    }
    spans = interleaved(calls, _REPEATS, there_and_back=True)
    step = {name: np.array(spans[name]) / steps[name] for name in BUILDS}
    return StepTimes(
        mesh=mesh_name,
        height=height,
        nodes=nodes,
        step_s={name: times.tolist() for name, times in step.items()},
        times_faster={
            name: ratio_of(step[FULL], times) for name, times in step.items()
        },
    )


def power_of_time(times: Sequence[StepTimes], structure: str) -> float:
    """Power of the resolution that the time grows with between the last two."""
    finest = times[-2:]
    heights = [row.height for row in finest]
    return power(heights, [row.median(structure) for row in finest])


def timed_runner(scene: jt.Scene) -> Runner:
    """Steps of a whole scene, whose number falls with the nodes."""
    nodes = sum(body.structure.node_count for body in scene.bodies)
    steps = int(np.clip(_SCENE_WORK / nodes, 4, _MAX_SCENE_STEPS)) // 2 * 2
    return scene_runner(scene, _DT, steps)


HIGHEST_WITH_ERROR = 250
"""Voxels along up, above which no error is measured: a full volume takes n^5 for it."""


@cache
def errors(mesh_name: str, height: int) -> dict[str, float]:
    """Errors of the structures against the full volume of a sunlit body [%]."""
    body = _body(mesh_name, height)
    return {
        name: body.error(build(body.grid))
        for name, build in BUILDS.items()
        if name != FULL
    }


def time_table(
    times: Sequence[StepTimes],
    error_percent: Mapping[int, Mapping[str, float]],
) -> list[Numbers]:
    """Nodes, time of a step, speed and error of each structure at each height."""
    return [
        {
            "height": row.height,
            "structure": name,
            "nodes": row.nodes[name],
            "step_ms": 1e3 * row.median(name),
            "times faster": row.times_faster[name].median,
            "error_percent": error_percent.get(row.height, {}).get(name),
        }
        for row in times
        for name in BUILDS
    ]
