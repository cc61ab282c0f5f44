"""From a validated config to the objects that are simulated."""

from collections.abc import Callable

import numpy as np

from ..errors import InputError
from ..geometry import shapes
from ..geometry.load import load_mesh
from ..geometry.mesh import Mesh
from ..integrate.solvers import (
    TRBDF2,
    AbstractSolver,
    BackwardEuler,
    CrankNicolson,
    ForwardEuler,
    SuperTimeStepping,
)
from ..scene.scene import Body, Scene
from ..voxels.voxelize import voxelize
from . import schema_geometry as geometry
from .build_material import build_materials
from .build_pose import build_pose
from .build_structure import build_structure, build_surface_map
from .build_terms import build_term
from .schema import SceneConfig
from .schema_solver import SolverConfig


_SOLVERS: dict[str, Callable[..., AbstractSolver] | None] = {
    "auto": None,
    "forward_euler": ForwardEuler,
    "super_time_stepping": SuperTimeStepping,
    "backward_euler": BackwardEuler,
    "trbdf2": TRBDF2,
    "crank_nicolson": CrankNicolson,
}


def build_scene(config: SceneConfig) -> Scene:
    """Loads the meshes, voxelizes them and puts the scene together."""
    return Scene(
        bodies=tuple(build_body(body) for body in config.bodies),
        terms=tuple(build_term(term) for term in config.terms),
        dtype=config.dtype,
    )


def build_mesh(config: geometry.BodyConfig) -> Mesh:
    """The body's mesh, from its file or as a shape, in metres and z up."""
    if config.mesh is not None:
        mesh = config.mesh
        return load_mesh(mesh.path, unit=mesh.unit, height=mesh.height, up=mesh.up)
    match config.shape:
        case geometry.Box(size=size):
            return shapes.box(size)
        case geometry.Sphere(radius=radius):
            return shapes.sphere(radius)
        case geometry.Cylinder(radius=radius, height=height):
            return shapes.cylinder(radius, height)
        case geometry.Slab(thickness=thickness, width=width, length=length):
            return shapes.slab(thickness, width, length)
        case geometry.Figurine(height=height):
            return shapes.figurine(height)
        case _:
            raise InputError("bodies: a body needs a `mesh` or a `shape`")


def build_body(config: geometry.BodyConfig) -> Body:
    """One body, voxelized."""
    mesh = build_mesh(config)
    pitch = config.pitch
    if pitch is None:
        height = float(np.ptp(mesh.bounds[:, 2]))
        pitch = height / float(config.voxels_high or 1)
    return Body(
        build_structure(config.structure, voxelize(mesh, pitch=pitch)),
        build_materials(config),
        temperature=config.temperature,
        pose=build_pose(config.pose),
        surface_map=build_surface_map(config.surface_map),
    )


def build_solver(config: SolverConfig) -> AbstractSolver | None:
    """How time is stepped; None to have it chosen."""
    given = config.model_dump(exclude={"kind"})
    made = _SOLVERS[config.kind]
    return None if made is None else made(**given)
