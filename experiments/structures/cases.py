"""From the config to voxels, scenes and structures."""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxthermo.config.schema.structure import SurfaceMapConfig
from jaxthermo.errors import InputError
from jaxthermo.geometry.mesh import Pose
from jaxthermo.material.material import Material
from jaxthermo.physics.radiation.source import Sun
from jaxthermo.physics.time_varying import Until
from jaxthermo.scene.compile.compile import body_geometry
from jaxthermo.scene.scene import Body, Scene, SolvedSurface
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.structures.surface_map import AbstractSurfaceMap, ConstantMap
from jaxthermo.voxels.grid import VoxelGrid
from jaxthermo.voxels.voxelize import voxelize

from .config import (
    FULL,
    LINKS,
    ComparedBody,
    ComparisonConfig,
    EntryConfig,
    structure_identity,
)


@dataclass(frozen=True, eq=False)
class Subject:
    """A voxelized body, and the scenes that it is put into."""

    name: str
    grid: VoxelGrid
    config: ComparisonConfig

    @property
    def lattice_voxels(self) -> int:
        """Voxels of the bounding box, empty ones included, over which the loop runs."""
        return int(self.grid.solid.size)

    def scene(
        self,
        structure: AbstractStructure,
        surface_map: AbstractSurfaceMap,
        load: str,
    ) -> Scene:
        """A structure in the sun from the side that the load names."""
        body = self.body(structure, surface_map)
        others = (term.build() for term in self.config.terms)
        return Scene((body,), (self.sun(load), *others))

    def body(
        self, structure: AbstractStructure, surface_map: AbstractSurfaceMap
    ) -> Body:
        """The structure with the material and start of the config."""
        return Body(
            structure,
            self.material,
            temperature=self.config.temperature,
            surface_map=surface_map,
        )

    @property
    def surface(self) -> SolvedSurface:
        """The body's shape; black, since only temperatures are looked at."""
        one = jnp.ones((), jnp.float32)
        return SolvedSurface(body_geometry(self.grid, Pose()), one, one)

    @property
    def material(self) -> Material:
        """The material of the whole body."""
        return self.config.material.build()

    def sun(self, load: str) -> Sun:
        """Rays onto the side that the load names."""
        sun = self.config.sun
        strength: Any = sun.irradiance
        if sun.until is not None:
            strength = Until(strength, sun.until)
        return Sun(direction=rays(self.grid.mesh.axes, load), irradiance=strength)


def rays(axes: tuple[str, str, str], load: str) -> tuple[float, float, float]:
    """The way the rays travel onto a side named in the file's axes."""
    way = np.zeros(3)
    for i, name in enumerate(axes):
        if name[-1] == load[-1]:
            way[i] = 1.0 if (name[0] == "-") != (load[0] == "-") else -1.0
    x, y, z = (float(v) for v in way)
    return x, y, z


def load_subject(
    body: ComparedBody, config: ComparisonConfig, voxels_high: int
) -> Subject:
    """The body's mesh, voxelized to so many voxels along up."""
    given = body.mesh or body.shape
    if given is None:
        raise InputError("bodies: a body needs a `mesh` or a `shape`")
    mesh = given.build()
    pitch = float(np.ptp(mesh.bounds[:, 2])) / voxels_high
    return Subject(body.name, voxelize(mesh, pitch), config)


@dataclass(frozen=True)
class Case:
    """One line of the comparison: what it is called, and how it is made."""

    label: str
    kind: str
    entry: EntryConfig | None = None

    @property
    def identity(self) -> Any:
        """Plain values that distinguish it from all others."""
        options = structure_identity(self.entry.structure) if self.entry else {}
        return [self.label, self.kind, options]

    def make(self, grid: VoxelGrid) -> AbstractStructure:
        """The structure of a body's voxels."""
        if self.entry is None:
            return FullVolume(grid, stencil=self.kind != LINKS)
        return self.entry.structure.build(grid)


def all_cases(config: ComparisonConfig) -> tuple[Case, ...]:
    """The full volume, as links too if asked for, and the config's structures."""
    full = [Case(FULL, FULL)]
    if config.full_volume_as_links:
        full.append(Case(LINKS, LINKS))
    entries = (Case(e.label, e.structure.kind, e) for e in config.structures)
    return (*full, *entries)


def case_loads(case: Case, config: ComparisonConfig) -> tuple[str, ...]:
    """Those that a case is run under.

    As links the full volume says what a link costs, under any load: one will do.
    """
    return (config.picture.load,) if case.kind == LINKS else config.loads


def make_map(config: SurfaceMapConfig) -> AbstractSurfaceMap:
    """Build the surface map of all structures but the full volume."""
    return config.build()


NEAREST = ConstantMap()
"""Surface map of the full volume: a voxel's temperature is that of its centre."""
