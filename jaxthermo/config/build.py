"""From a validated config to the objects that are simulated."""

import math
from typing import Any, assert_never

import numpy as np

from ..errors import InputError
from ..geometry import shapes
from ..geometry.load import load_mesh
from ..geometry.mesh import Mesh
from ..integrate.euler import ForwardEuler
from ..material import Material
from ..materials import materials
from ..physics.boundary import Convection, FixedTemperature, HeatFlux
from ..physics.emission import Surroundings
from ..physics.source import Sun
from ..physics.term import AbstractTerm
from ..physics.values import Table, Until
from ..scene.scene import Body, MaterialMap, Pose, Scene
from ..voxels.select import AbstractSelection, Region, Side
from ..voxels.voxelize import voxelize
from . import (
    schema_geometry as geometry,
    schema_material as material,
    schema_terms as terms,
    schema_time as time,
)
from .build_structure import build_structure, build_surface_map
from .schema import SceneConfig, SolverConfig


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
    base = build_material(config.material)
    painted = tuple(
        (Region(lower=paint.lower, upper=paint.upper), build_material(paint.material))
        for paint in config.regions
    )
    return Body(
        build_structure(config.structure, voxelize(mesh, pitch=pitch)),
        MaterialMap(base, painted) if painted else base,
        temperature=config.temperature,
        pose=build_pose(config.pose),
        surface_map=build_surface_map(config.surface_map),
    )


def build_material(config: material.MaterialConfig) -> Material:
    """The named material, with the properties that the config states in its place."""
    stated = config.model_dump(exclude={"name"}, exclude_none=True)
    if config.name is None:
        return Material(**stated)
    named = materials[config.name]
    table = {
        "conductivity": named.conductivity,
        "density": named.density,
        "specific_heat": named.specific_heat,
        "emissivity": named.emissivity,
        "absorptivity": named.own_absorptivity,
    }
    return Material(**{**table, **stated})


def build_pose(config: geometry.PoseConfig) -> Pose:
    """The rotation matrix by Rodrigues' formula, and the translation."""
    turn = config.rotation
    if turn is None:
        return Pose(translation=config.translation)
    x, y, z = np.asarray(turn.axis) / math.hypot(*turn.axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = math.sin(turn.angle), math.cos(turn.angle)
    matrix = np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)
    rows = [(float(a), float(b), float(c)) for a, b, c in matrix]
    return Pose(translation=config.translation, rotation=tuple(rows))


def build_term(config: terms.TermConfig) -> AbstractTerm:
    """What heats or cools the bodies."""
    match config:
        case terms.SunConfig():
            irradiance = build_value(config.irradiance, config.until)
            return Sun(direction=config.direction, irradiance=irradiance)
        case terms.ConvectionConfig():
            return Convection(
                build_value(config.heat_transfer_coefficient),
                build_value(config.temperature),
                on=build_selection(config.on),
            )
        case terms.SurroundingsConfig():
            return Surroundings(temperature=build_value(config.temperature))
        case terms.HeatFluxConfig():
            flux = build_value(config.heat_flux, config.until)
            return HeatFlux(flux, on=build_selection(config.on))
        case terms.FixedTemperatureConfig():
            temperature = build_value(config.temperature)
            return FixedTemperature(temperature, on=build_selection(config.on))
        case _:
            assert_never(config)


def build_value(value: float | time.Table, until: float | None = None) -> Any:
    """A number as it is, a table as a function of time; switched off at `until`."""
    tabled = isinstance(value, time.Table)
    built = Table(value.times, value.values) if tabled else value
    return built if until is None else Until(built, until)


def build_selection(config: terms.WhereConfig | None) -> AbstractSelection | None:
    """The part of the surface on which a term acts; None for all of it."""
    if config is None:
        return None
    if config.side is not None:
        return Side(normal=config.side.normal, body=config.side.body)
    if config.region is None:
        return None
    box = config.region
    return Region(lower=box.lower, upper=box.upper, body=box.body)


def build_solver(config: SolverConfig) -> ForwardEuler:
    """How time is stepped."""
    return ForwardEuler(dt=config.dt)
