"""Voxels, time of a step and error of the thesis' structures over the resolution.

Two counts are told apart. Occupied: voxels, cells or texels that stand for a piece of
the body. Allocated: all that arrays hold, which the thesis' textures compute as well:
the whole box of the full volume, and every texel of the packed layers along x, y and z.
"""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np

import jaxthermo as jt
from jaxthermo.structures.structure import AbstractStructure

from ..benchmarks.mixed import Runner, scene_runner
from ..benchmarks.steps import conduction_call
from ..harness.present import Rows
from ..harness.timing import interleaved, ratio_of
from .bodies import statue
from .counting import count_structures
from .levels import Sunlit


FULL = "full volume"
KINDS: Mapping[str, Callable[[jt.VoxelGrid], AbstractStructure]] = {
    "single shell": jt.SingleShell,
    "irregular levels": jt.IrregularMultiLevel,
    "ten levels": lambda grid: jt.MultiLevel(grid, levels=10),
    FULL: jt.FullVolume,
}
"""The thesis' four structures; it does not say how many levels its multi-level has."""

# Nodes times steps of a timed call, and its largest number of steps.
_WORK, _MOST_STEPS = 4e7, 400
_REPEATS = 3
# A step of a whole scene takes as long whatever its length [s]. Its calls are short, so
# that some of many are not disturbed by what else the machine does.
_DT, _SCENE_WORK, _MOST_SCENE_STEPS = 1e-3, 5e5, 60


@cache
def counts(name: str, height: int) -> dict[str, Any]:
    """Occupied and allocated counts of a mesh so many voxels high, by its name."""
    grid = _body(name, height).grid
    found = count_structures(grid, height)
    axes = range(3)
    view = [grid.lattice.cells // grid.lattice.shape[axis] for axis in axes]
    texels = lambda layers: int(np.dot(layers, view))
    packed = texels(grid.layers.packed)
    # Each level is said to be stored as the one before at half the resolution.
    levels = sum(0.25**level for level in range(found["irregular_levels"]))
    return {
        **found,
        "mesh": name,
        "layers_peeled": list(grid.layers.peeled),
        "layers_packed": list(grid.layers.packed),
        "fragments": len(grid.fragment_area),
        "texels_occupied": sum(int(grid.is_packed(a).sum()) for a in axes),
        "texels_peeled": texels(grid.layers.peeled),
        "texels_shell": packed,
        "texels_irregular": round(packed * levels),
    }


@cache
def _body(name: str, height: int) -> Sunlit:
    found = statue(name)
    assert found is not None, name
    return Sunlit(found.mesh, height)


@cache
def step_times(name: str, height: int) -> dict[str, Any]:
    """Times of a step of conduction of the four structures, measured in turn [s]."""
    grid = _body(name, height).grid
    built = {kind: make(grid) for kind, make in KINDS.items()}
    steps = {
        kind: int(np.clip(_WORK / each.node_count, 4, _MOST_STEPS)) // 2 * 2
        for kind, each in built.items()
    }
    calls = {k: conduction_call(each, steps[k]) for k, each in built.items()}
    spans = interleaved(calls, _REPEATS, there_and_back=True)
    step = {kind: np.array(spans[kind]) / steps[kind] for kind in built}
    return {
        "mesh": name,
        "height": height,
        "nodes": {kind: each.node_count for kind, each in built.items()},
        "step_s": {kind: each.tolist() for kind, each in step.items()},
        "times_faster": {k: ratio_of(step[FULL], each) for k, each in step.items()},
    }


def timed_runner(scene: jt.Scene) -> Runner:
    """Steps of a whole scene, as many as its nodes leave time for."""
    nodes = sum(body.structure.node_count for body in scene.bodies)
    steps = int(np.clip(_SCENE_WORK / nodes, 4, _MOST_SCENE_STEPS)) // 2 * 2
    return scene_runner(scene, _DT, steps)


HIGHEST_WITH_ERROR = 250
"""Voxels along up, above which no error is measured: a full volume takes n^5 for it."""


@cache
def errors(name: str, height: int) -> dict[str, float]:
    """Errors of the structures against the full volume in `levels`' scene [%]."""
    body = _body(name, height)
    return {k: body.error(make(body.grid)) for k, make in KINDS.items() if k != FULL}


def count_rows(names: list[str], heights: tuple[int, ...]) -> Rows:
    """Counts of each mesh at each height, with their ratios."""
    return [_with_ratios(counts(name, h)) for name in names for h in heights]


def _with_ratios(row: dict[str, Any]) -> dict[str, Any]:
    of_box = lambda key: row[key] / row["box"]
    return {
        **row,
        "texels_shell_of_box": of_box("texels_shell"),
        "texels_irregular_of_box": of_box("texels_irregular"),
        "fill": row["texels_occupied"] / row["texels_shell"],
    }
