"""Scenes of cases, which reuse voxels and bodies of the last ones."""

import json
import time
from functools import lru_cache
from typing import NamedTuple

from jaxthermo.arrays import precision
from jaxthermo.config.loader import resolved
from jaxthermo.config.schema.body import BodyConfig
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.integrate.run.plan import Plan, plan_once
from jaxthermo.scene.scene import Body, Scene
from jaxthermo.voxels.grid import VoxelGrid


_VOXELS = ("mesh", "shape", "solid", "pitch", "voxels_high", "surface_cells")
"""Fields of a body's config that its voxels follow from."""


class Built(NamedTuple):
    """A scene of a case, and the times to build its bodies [s]."""

    scene: Scene
    voxels_s: float
    structures_s: float


class _Bodies(NamedTuple):
    bodies: tuple[Body, ...]
    voxels_s: float
    structures_s: float


class _Key:
    # Configs by their values, since a model with a mapping in it has no hash.
    def __init__(self, configs: tuple[BodyConfig, ...], fields: tuple[str, ...] = ()):
        self.configs = configs
        plain = [resolved(config) for config in configs]
        selected = [{k: v for k, v in p.items() if k in (fields or p)} for p in plain]
        self.text = json.dumps(selected, default=str)

    def __eq__(self, key: object) -> bool:
        return isinstance(key, _Key) and self.text == key.text

    def __hash__(self) -> int:
        return hash(self.text)


def build_case(config: SceneConfig) -> Built:
    """Build a scene.

    Raises:
        InputError: for files or values that cannot be used.
    """
    # Choices of one resolution, and the loads of a choice, differ in little.
    built = _bodies(_Key(tuple(config.bodies)))
    clock = time.perf_counter()
    scene = config.scene(built.bodies, config.build_terms())
    structures_s = built.structures_s + time.perf_counter() - clock
    return Built(scene, built.voxels_s, structures_s)


def plan_case(config: SceneConfig, scene: Scene) -> Plan:
    """Plan the run of a case, with its error in time controlled as by default.

    A `simulate` of the same scene finds this plan.

    Raises:
        InputError: for a solver that the scene cannot have.
    """
    span = config.time
    solver = config.solver.build()
    with precision(scene.dtype):
        return plan_once(scene, t1=span.end, save_at=span.save_times, solver=solver)


def loop_size(plan: Plan) -> tuple[int, ...] | None:
    """Sizes that are equal for plans whose loops take the same time.

    Loads that differ in numbers only have loops of one size. None where the run itself
    finds what it takes: its error in time is controlled, or something moves.
    """
    if plan.control is not None or len(plan.compiled.programs) > 1:
        return None
    receipt = plan.compiled.receipt
    return (receipt.nodes, receipt.links, receipt.memory_bytes, plan.steps)


@lru_cache(maxsize=2)
def _bodies(key: _Key) -> _Bodies:
    bodies = []
    voxels_s = 0.0
    structures_s = 0.0
    for config in key.configs:
        grid, seconds = _grid(_Key((config,), _VOXELS))
        clock = time.perf_counter()
        bodies.append(config.build(grid))
        voxels_s += seconds
        structures_s += time.perf_counter() - clock
    return _Bodies(tuple(bodies), voxels_s, structures_s)


@lru_cache(maxsize=3)
def _grid(key: _Key) -> tuple[VoxelGrid, float]:
    clock = time.perf_counter()
    grid = key.configs[0].build_grid()
    return grid, time.perf_counter() - clock
