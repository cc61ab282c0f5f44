"""5.2 and 6.1: the mean at equilibrium, and holes where levels do not meet."""

import math
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from jaxtyping import Bool, Int

import jaxthermo as jt
from jaxthermo.geometry.shapes import figurine
from jaxthermo.structures.structure import AbstractStructure

from ...harness.meshes import HEIGHT, SAVE_AT, START, STEEL, voxels_high
from ..bodies import buddha, required_statue
from ..exhibit import Finding, Numbers, exhibit, judged, rms
from ..sunlit import SUN, SUNSET, Sunlit


Build = Callable[[jt.VoxelGrid], AbstractStructure]
_STRUCTURES: dict[str, Build] = {
    "single shell": jt.SingleShell,
    "hollow shell": partial(jt.SingleShell, capacity="own"),
    "10 levels": partial(jt.MultiLevel, levels=10),
    "10 levels over a core": partial(jt.MultiLevel, levels=10, hollow="innermost"),
    "irregular levels": partial(jt.IrregularMultiLevel, levels=7),
    "irregular, capacity kept": partial(
        jt.IrregularMultiLevel, levels=7, keep_capacity=True
    ),
    "octree": jt.Octree,
    "aggregate x2": partial(jt.Aggregate, factor=2),
    "aggregate x4": partial(jt.Aggregate, factor=4),
    "shell over core": partial(jt.ShellOverCore, layers=1, factor=4),
}
_LIMB_LEVELS = (1, 2, 3)
# Voxels along up of the insulated body and of the figurine with its sleeves.
_EVEN_HEIGHT = 32
_LIMB_HEIGHT = 125
# Relative difference up to which capacities and means are the same.
_SAME = 1e-6
# Duration over the time constant of a bar of the body's height, H^2 / (pi^2 alpha):
# e^-40 is below float64's digits, with room for what evens out more slowly.
_TIME_CONSTANTS = 40.0


@exhibit("section-5.2-equilibrium", "5.2")
def _mean_at_equilibrium(_: bool) -> Finding:
    """Find the mean temperature of an insulated body long after the sun."""
    try:
        body = required_statue("Max Planck")
    except jt.InputError:
        body = buddha()
    grid = voxels_high(body.mesh, _EVEN_HEIGHT)
    _unit, full_rise = _capacity_and_rise(grid, jt.FullVolume)
    rows: dict[str, Numbers] = {}
    for name, build in _STRUCTURES.items():
        capacity, rise = _capacity_and_rise(grid, build)
        # The same heat in another capacity must end at another mean.
        is_met: bool | None = None
        if abs(capacity - 1) < _SAME:
            is_met = abs(rise - full_rise) <= _SAME * full_rise
        rows[name] = {"capacity": capacity, "rise_K": rise, "met": is_met}
    return _judged(rows, {"mesh": body.name, "full_volume_K": full_rise}, "structures")


def _judged(
    rows: Mapping[str, Mapping[str, object]],
    numbers: Mapping[str, str | float],
    name: str,
) -> Finding:
    outcomes = [row["met"] for row in rows.values()]
    verdicts = [bool(is_met) for is_met in outcomes if is_met is not None]
    return Finding(
        judged(all(verdicts)),
        {
            **numbers,
            "all_met": all(verdicts),
            "met": sum(verdicts),
            "judged": len(verdicts),
            name: rows,
        },
    )


def _capacity_and_rise(grid: jt.VoxelGrid, build: Build) -> tuple[float, float]:
    """Capacity over the body's, and rise of its mean long after the sun [K]."""
    body = jt.Body(build(grid), STEEL, temperature=START)
    scene = jt.Scene((body,), (SUN,), dtype="float64")
    end = _TIME_CONSTANTS * HEIGHT**2 / (math.pi**2 * float(STEEL.diffusivity))
    solution = jt.simulate(scene, end, [end], solver=jt.ForwardEuler())
    rise = float(solution.mean_temperature[0, 0]) - START
    return float(solution.receipt.capacity_ratios[0]), rise


@exhibit("section-6.1-holes", "6.1")
def _holes_in_limbs(_: bool) -> Finding:
    """Compare the error where levels do not reach the middle with that elsewhere."""
    body = Sunlit(voxels_high(figurine(HEIGHT), _LIMB_HEIGHT))
    thick = thickness(body.grid)
    area = body.grid.fragment_area
    sunset = SAVE_AT.index(SUNSET)
    rows: dict[str, Mapping[str, float | bool]] = {}
    for levels in _LIMB_LEVELS:
        solution = body.solve(jt.MultiLevel(body.grid, levels=levels))
        error = np.asarray(solution.surface_temperature[sunset]) - np.asarray(
            body.full.surface_temperature[sunset]
        )
        # Levels from both sides meet in the middle of what is thinner.
        is_filled = thick <= 2 * levels
        filled, hollow = (
            rms(error[region], area[region]) for region in (is_filled, ~is_filled)
        )
        rows[str(levels)] = {
            "where they meet_K": filled,
            "where they do not meet_K": hollow,
            "met": hollow >= filled,
        }
    return _judged(rows, {}, "levels")


def thickness(grid: jt.VoxelGrid) -> Int[np.ndarray, " s"]:
    """Number of solid voxels in a row under each fragment, along its axis."""
    counts = np.zeros(len(grid.fragment_axis), np.int64)
    for axis in range(3):
        on_axis = grid.fragment_axis == axis
        run = _run_length(np.moveaxis(grid.solid, axis, -1))
        voxel = np.moveaxis(grid.fragment_voxel[on_axis], 1, 0)
        x, y, z = (*np.delete(voxel, axis, axis=0), voxel[axis])
        counts[on_axis] = run[x, y, z]
    return counts


def _run_length(solid: Bool[np.ndarray, "a b c"]) -> Int[np.ndarray, "a b c"]:
    # Along the last axis, around each voxel: the distance between the last empty voxel
    # in front of it and the first one behind it.
    count = solid.shape[-1]
    index = np.arange(count, dtype=np.int32)
    in_front = np.maximum.accumulate(np.where(solid, -1, index), axis=-1)
    backward = np.where(solid, count, index)[..., ::-1]
    behind = np.minimum.accumulate(backward, axis=-1)[..., ::-1]
    return np.where(solid, behind - in_front - 1, 0).astype(np.int32)
