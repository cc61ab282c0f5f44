"""A case: one choice of structure, voxels and solver under one load.

Cases whose programs have arrays of the same shapes run together, see `evaluate`.
"""

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, Generic, NamedTuple, TypedDict, TypeVar

from jaxthermo.archive import text_hash
from jaxthermo.arrays import precision
from jaxthermo.config.loader import config_hash, resolved
from jaxthermo.config.schema.body import BodyConfig
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.integrate.run.plan import Plan, plan_run
from jaxthermo.scene.scene import Body, Scene
from jaxthermo.voxels.abstract_grid import AbstractGrid

from ..config.schema import AbsoluteReference, Changes
from ..problem.reference import program_hash, reference_key


_T = TypeVar("_T")


@dataclass(frozen=True)
class Keyed(Generic[_T]):
    """A value that a cache finds by its key alone."""

    key: str
    value: _T = field(compare=False)


class _Head(TypedDict):
    id: str
    choice: dict[str, str]
    """Label by axis."""
    load: str
    set: Changes


@dataclass(frozen=True)
class Case:
    """A scene with the changes of a choice and of a load."""

    config: SceneConfig
    names: tuple[tuple[str, str], ...]
    """The choice: the label of its value on each axis."""
    load: str
    truth: AbsoluteReference
    set: tuple[tuple[str, Any], ...] = ()
    """Changes of the choice by dotted key."""

    @cached_property
    def id(self) -> str:
        """Hash of the resolved scene, its names, the reference and the program."""
        # A changed program gives other errors, and another case; two choices that
        # come to the same scene are two cases.
        scene = config_hash(_run_part(self.config))
        names = json.dumps([self.names, self.load])
        truth = self.truth.model_dump_json()
        text = " ".join((scene, names, truth, program_hash()))
        return text_hash(text)

    @cached_property
    def truth_key(self) -> str:
        """Hash of the reference: equal for cases with a common reference."""
        return reference_key(self.config, self.truth)

    @property
    def shares_voxels(self) -> bool:
        """True if the reference has the same voxels: their error is in both."""
        reference = self.truth
        key = "pitch" if reference.voxels_high is None else "voxels_high"
        # So many voxels along z are of another size in another body.
        single = key == "pitch" or len(self.config.bodies) == 1
        return single and all(
            getattr(body, key) == getattr(reference, key)
            and (body.surface_cells or "crossings") == reference.surface_cells
            for body in self.config.bodies
        )

    @cached_property
    def shape_key(self) -> str:
        """Equal text for cases with arrays of the same shapes.

        Cases with the same text may still differ in shape: `evaluate_group` looks.
        """
        plain = resolved(_run_part(self.config))
        for body in plain["bodies"]:
            body["structure"].pop("weights", None)
            for key in ("material", "temperature", "coatings", "regions"):
                body[key] = _kinds(body.get(key))
        plain["terms"] = _kinds(plain["terms"])
        return json.dumps(plain, sort_keys=True, default=str)

    @property
    def head(self) -> _Head:
        """First fields of the case's row."""
        return {
            "id": self.id,
            "choice": dict(self.names),
            "load": self.load,
            "set": dict(self.set),
        }


def _run_part(config: SceneConfig) -> SceneConfig:
    """Config without what has no effect on temperatures."""
    fields = type(config).model_fields
    defaults = {key: fields[key].default for key in ("camera", "image", "truth")}
    return config.model_copy(update={"name": None, **defaults})


def _kinds(value: Any) -> Any:
    """Plain values with every number replaced: the rest decides shapes."""
    if isinstance(value, Mapping):
        return {key: _kinds(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_kinds(item) for item in value]
    return value if isinstance(value, str | bool | type(None)) else "number"


_VOXELS = ("mesh", "shape", "solid", "pitch", "voxels_high", "surface_cells", "sheet")
"""Fields of a body's config that its voxels, or the cells of a sheet, follow from."""


class _Built(NamedTuple):
    """A scene of a case, and the times to build its bodies [s]."""

    scene: Scene
    voxels_s: float
    structures_s: float


class _Bodies(NamedTuple):
    bodies: tuple[Body, ...]
    voxels_s: float
    structures_s: float


def build_case(config: SceneConfig) -> _Built:
    """Build a scene.

    Raises:
        InputError: for files or values that cannot be used.
    """
    # Choices of one resolution, and the loads of a choice, differ in little.
    key = json.dumps([resolved(body) for body in config.bodies], default=str)
    built = _bodies(Keyed(key, tuple(config.bodies)))
    clock = time.perf_counter()
    scene = config.scene(config.with_air(built.bodies), config.build_terms())
    structures_s = built.structures_s + time.perf_counter() - clock
    return _Built(scene, built.voxels_s, structures_s)


def plan_case(config: SceneConfig, scene: Scene) -> Plan:
    """Plan the run of a case, with its error in time controlled as by default.

    Raises:
        InputError: for a solver that the scene cannot have.
    """
    span = config.time
    solver = config.solver.build()
    with precision(scene.dtype):
        return plan_run(
            scene,
            t1=span.end,
            save_at=span.save_times,
            solver=solver,
            control_error=True,
        )


def has_fixed_steps(plan: Plan) -> bool:
    """False where a run controls its error in time, or something moves."""
    return plan.control is None and len(plan.compiled.programs) == 1


def loop_size(plan: Plan) -> tuple[int, ...] | None:
    """Sizes that are equal for plans whose loops take the same time.

    Loads that differ in numbers only have loops of one size. None where the run itself
    finds what it takes.
    """
    if not has_fixed_steps(plan):
        return None
    receipt = plan.compiled.receipt
    return (receipt.nodes, receipt.links, receipt.memory_bytes, plan.steps)


@lru_cache(maxsize=2)
def _bodies(configs: Keyed[tuple[BodyConfig, ...]]) -> _Bodies:
    bodies = []
    voxels_s = 0.0
    structures_s = 0.0
    for config in configs.value:
        plain = resolved(config)
        sizes = {name: plain[name] for name in _VOXELS if name in plain}
        grid, seconds = _grid(Keyed(json.dumps(sizes, default=str), config))
        clock = time.perf_counter()
        bodies.append(config.build(grid))
        voxels_s += seconds
        structures_s += time.perf_counter() - clock
    return _Bodies(tuple(bodies), voxels_s, structures_s)


@lru_cache(maxsize=3)
def _grid(config: Keyed[BodyConfig]) -> tuple[AbstractGrid, float]:
    clock = time.perf_counter()
    grid = config.value.build_grid()
    return grid, time.perf_counter() - clock
