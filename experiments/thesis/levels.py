"""Claims on structures: C11 equilibrium, C12 detours, C13 levels, C14 holes.

All weights are 1. Errors are those of `surface_error` against the full volume of the
same voxels: of a statue in steel, one side in the sun for half of three minutes.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Int

import jaxthermo as jt
from jaxthermo.geometry.shapes import figurine
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.structures.surface_map import AbstractSurfaceMap

from ..harness.case import Bound, Case, Check, Group, Value
from ..harness.meshes import (
    END,
    HEIGHT,
    SAVE_AT,
    START,
    STEEL,
    thesis_meshes,
    voxels_high,
)
from ..harness.report import PageTexts
from ..harness.run import run_cases


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
_LEVELS = (1, 2, 5, 10, 20, 40)
"""Numbers of levels beside all that there are."""
_LIMB_LEVELS = (1, 2, 3)
_EVEN_HEIGHT, _LIMB_HEIGHT = 32, 125
"""Voxels along up of the insulated body and of the figurine with its sleeves."""

_KEPT = 1e-6
"""Relative difference up to which capacities and means are the same."""
_ROUNDING = 1e-4
"""Change of an error that is rounding [%]."""
_TIME_CONSTANTS = 40.0
"""Duration over the time constant of a bar of the body's height, H^2 / (pi^2 alpha):
e^-40 is below float64's digits, with room for what evens out more slowly."""

_IRRADIANCE, _SUNSET = 5000.0, 90.0
_SUN = jt.Sun((-1.0, 0.0, 0.0), jt.Until(_IRRADIANCE, _SUNSET))
# Read where the full volume's nodes are.
_AT_VOXELS = jt.FluxCorrectedMap(at="voxel")

_TEXTS = PageTexts(
    "Structures: the thesis' claims",
    (
        "Errors are root mean squares over the surface of the difference from the "
        "full volume of the same voxels, at the worst of five saved times.",
        "C07 and C08, the run times, are beside the front of a sweep (`experiments run "
        "front configs/sweeps/structures.yaml`); C15, the capacity, is in `experiments "
        "run counting`.",
    ),
)


@dataclass(frozen=True)
class Sunlit:
    """A body in the sun and in air, as any structure of its voxels."""

    mesh: jt.Mesh
    voxels_high: int

    @cached_property
    def grid(self) -> jt.VoxelGrid:
        """Its voxels."""
        return voxels_high(self.mesh, self.voxels_high)

    @cached_property
    def full(self) -> jt.Solution:
        """The full volume in its own stable steps."""
        return self.solve(jt.FullVolume(self.grid), surface_map=jt.ConstantMap())

    def solve(
        self,
        structure: AbstractStructure,
        step: float | None = None,
        surface_map: AbstractSurfaceMap = _AT_VOXELS,
    ) -> jt.Solution:
        """Run in explicit steps [s], the stable ones if none are given."""
        body = jt.Body(structure, STEEL, temperature=START, surface_map=surface_map)
        scene = jt.Scene((body,), (_SUN, jt.Convection(10.0, START)))
        return jt.simulate(scene, END, SAVE_AT, solver=jt.ForwardEuler(dt=step))

    def error(self, structure: AbstractStructure, step: float | None = None) -> float:
        """Error against the full volume [%]."""
        found = jt.surface_error(self.solve(structure, step), self.full)
        return float(found.worst_rms_percent)


def _equilibrium(mesh: jt.Mesh, height: int) -> Iterator[Check]:
    """C11: the rise of the mean at the end, over the full volume's."""
    grid = Sunlit(mesh, height).grid
    _, whole = _rise(grid, jt.FullVolume)
    for name, build in _STRUCTURES.items():
        capacity, rise = _rise(grid, build)
        # The same heat in another capacity must end at another mean.
        keeps = abs(capacity - 1) < _KEPT
        text = name if keeps else f"{name}, {capacity:.4f} of the capacity"
        tolerance = _KEPT * whole if keeps else None
        yield Value(f"rise of the mean: {text}", "K", whole, rise, tolerance)


def _rise(grid: jt.VoxelGrid, build: Build) -> tuple[float, float]:
    """Capacity over the body's, and rise of its mean long after the sun [K]."""
    body = jt.Body(build(grid), STEEL, temperature=START)
    scene = jt.Scene((body,), (_SUN,), dtype="float64")
    alpha = float(STEEL.diffusivity)
    end = _TIME_CONSTANTS * HEIGHT**2 / (math.pi**2 * alpha)
    found = jt.simulate(scene, end, [end], solver=jt.ForwardEuler())
    rise = float(found.mean_temperature[0, 0]) - START
    return float(found.receipt.capacity_ratios[0]), rise


def _detours(body: Sunlit) -> Iterator[Check]:
    """C12: the error falls from shell to levels to irregular levels."""
    # Ten of 250 voxels: as many in a coarser body would fill it.
    count = max(1, 10 * body.voxels_high // 250)
    built = {
        "single shell": jt.SingleShell(body.grid),
        f"{count} levels": jt.MultiLevel(body.grid, levels=count),
        "irregular levels": jt.IrregularMultiLevel(body.grid, levels=7),
    }
    errors = {name: body.error(structure) for name, structure in built.items()}
    yield Value("error of single shell", "%", 0.0, errors["single shell"], None)
    for coarse, fine in pairwise(errors):
        name = f"error of {fine}, below that of {coarse}"
        yield Bound(name, errors[fine], errors[coarse], unit="%")


def _more_levels(body: Sunlit, counts: tuple[int, ...]) -> Iterator[Check]:
    """C13: the more levels, the more precise, up to the full volume."""
    # At the full volume's own step, so that all levels are the full volume.
    step = body.full.run.stable_step
    for hollow in ("empty", "innermost"):
        found = {n: _level_error(body, n, hollow, step) for n in counts}
        first = counts[0]
        yield Value(f"hollow {hollow}, {first} levels", "%", 0, found[first], None)
        for one, more in pairwise(counts):
            limit = found[one] + _ROUNDING
            yield Bound(f"hollow {hollow}, {more} levels", found[more], limit, unit="%")
        # No body is deeper than its box is wide.
        error = _level_error(body, max(body.grid.solid.shape), hollow, step)
        yield Bound(f"hollow {hollow}, all levels", error, 1e-3, unit="%")


def _level_error(
    body: Sunlit, levels: int, hollow: Literal["empty", "innermost"], step: float | None
) -> float:
    return body.error(jt.MultiLevel(body.grid, levels=levels, hollow=hollow), step)


def _limbs(body: Sunlit) -> Iterator[Check]:
    """C14: the error where the levels do not reach the middle, over that elsewhere."""
    thick, area = thickness(body.grid), body.grid.fragment_area
    shown = int(np.argmin(np.abs(np.array(SAVE_AT) - _SUNSET)))
    for levels in _LIMB_LEVELS:
        found = body.solve(jt.MultiLevel(body.grid, levels=levels))
        kelvin = [each.surface_temperature[shown] for each in (found, body.full)]
        difference = np.asarray(kelvin[0] - kelvin[1])
        # Levels from both sides meet in the middle of what is thinner.
        filled = thick <= 2 * levels
        filled_K, hollow_K = (
            float(np.sqrt(np.average(difference[part] ** 2, weights=area[part])))
            for part in (filled, ~filled)
        )
        name = f"{levels} levels: error where they do not meet, above where they do"
        yield Bound(name, hollow_K, lowest=filled_K, unit="K")


def thickness(grid: jt.VoxelGrid) -> Int[np.ndarray, " s"]:
    """Number of solid voxels in a row under each fragment, along its axis."""
    found = np.zeros(len(grid.fragment_axis), np.int64)
    for axis in range(3):
        here = grid.fragment_axis == axis
        run = _run_length(np.moveaxis(grid.solid, axis, -1))
        voxel = np.moveaxis(grid.fragment_voxel[here], 1, 0)
        x, y, z = (*np.delete(voxel, axis, axis=0), voxel[axis])
        found[here] = run[x, y, z]
    return found


def _run_length(solid: Bool[np.ndarray, "a b c"]) -> Int[np.ndarray, "a b c"]:
    # Along the last axis, around each voxel: the distance between the last empty voxel
    # before it and the first one after it.
    count = solid.shape[-1]
    index = np.arange(count, dtype=np.int32)
    before = np.maximum.accumulate(np.where(solid, -1, index), axis=-1)
    backward = np.where(solid, count, index)[..., ::-1]
    after = np.minimum.accumulate(backward, axis=-1)[..., ::-1]
    return np.where(solid, after - before - 1, 0).astype(np.int32)


def claims(mesh: jt.Mesh, bust: jt.Mesh, height: int) -> tuple[Case, ...]:
    """The claims as cases, each measured when it is run.

    Args:
        mesh: of the statue.
        bust: of the insulated body.
        height: voxels of the statue along up.
    """
    high = f"{height} voxels high"
    sunlit = Sunlit(mesh, height)
    limbs = lambda: _limbs(Sunlit(figurine(HEIGHT), _LIMB_HEIGHT))
    even = lambda: _equilibrium(bust, _EVEN_HEIGHT)
    counts = tuple(n for n in _LEVELS if n < height)
    return (
        Case(
            "C11", "Equilibrium", "thesis, 5.5",
            "an insulated body ends at the full volume's mean temperature, where its "
            "structure keeps the capacity",
            f"{_EVEN_HEIGHT} voxels high, insulated after the sun, in float64", even,
        ),
        Case(
            "C12", "The longer way round", "thesis, 5.5",
            "the error falls from shell to levels to irregular levels", high,
            lambda: _detours(sunlit),
        ),
        Case(
            "C13", "More levels", "thesis, 5.5",
            "more levels are more precise, up to the full volume",
            f"{high}, at the full volume's step", lambda: _more_levels(sunlit, counts),
        ),
        Case(
            "C14", "Holes inside", "thesis, 5.5",
            "holes inside break the multi-level structure (the sleeves)",
            f"figurine, {_LIMB_HEIGHT} voxels high", limbs,
        ),
    )  # fmt: skip


def run(folder: Path, height: int = 250, cases: str | None = None) -> dict[str, Any]:
    """C11 to C14 on the thesis' statues, or those claims that `cases` names."""
    meshes = thesis_meshes()
    mesh = next(iter(meshes.values()))
    found = claims(mesh, meshes.get("Max Planck", mesh), height)
    group = Group("Claims of the thesis on structures", found)
    return run_cases((group,), cases, folder, _TEXTS)
