"""Laws of convection compared with Nusselt numbers that others measured.

| body | Nusselt number | range |
|---|---|---|
| upright cylinder in still air | 0.67 Ra^0.25, 0.0782 Ra^0.357 | Ra 1e7, 1e9 to 1e11 |
| lying cylinder in still air | C Ra^n by ranges | Ra 1e-10 to 1e12 |
| sphere in wind | 2 + 1.3 Pr^0.15 + 0.66 Pr^0.31 Re^0.5 | Re 0.4 to 2100 |
| cylinder in wind | 0.42 Pr^0.20 + 0.57 Pr^0.33 Re^0.5 | Re 5 to 1e3 |

The upright cylinders of Griffiths and Davis (1922) were 0.1743 m thick and up to 2.6 m
high, in air; the lying ones are those of many authors, both as correlated by Morgan
(1975, Advances in Heat Transfer 11, 199) and kept in the package `ht`. Kramers (1946,
Physica 12, 61) measured spheres in air, water and oil, and correlated the cylinders of
others. None of them is a law of the package.
"""

import functools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.physics.convection.air import (
    conductivity,
    kinematic_viscosity,
    prandtl,
)
from jaxthermo.physics.occluder import Occluder
from jaxthermo.physics.surface import Binding, BodySurface, Surface


AIR = 300.0  # [K]
_WARM = 340.0  # [K]
_GRAVITY = 9.80665  # [m/s^2]


class _Film(NamedTuple):
    """Air between a warm surface and its surroundings."""

    viscosity: float
    """Kinematic [m^2/s]."""
    conductivity: float
    """[W/(m K)]"""
    prandtl: float


@functools.cache
def film() -> _Film:
    """Properties of the film."""
    with precision("float64"):
        kelvin = jnp.asarray((AIR + _WARM) / 2)
        return _Film(
            float(kinematic_viscosity(kelvin)),
            conductivity=float(conductivity(kelvin)),
            prandtl=float(prandtl(kelvin)),
        )


class Comparison(NamedTuple):
    """Nusselt numbers of one body."""

    number: float
    """Rayleigh or Reynolds number [-]."""
    computed: float
    measured: float

    @property
    def deviation(self) -> float:
        """Computed over measured number, less 1 [-]."""
        return self.computed / self.measured - 1


def rayleigh(length: float) -> float:
    """Rayleigh number of a length [-]."""
    buoyancy = _GRAVITY * (_WARM - AIR) * 2 / (_WARM + AIR)
    return buoyancy * length**3 * film().prandtl / film().viscosity ** 2


def _reynolds(speed: float, length: float) -> float:
    """Reynolds number of a speed [m/s] and a length [-]."""
    return speed * length / film().viscosity


def griffiths_davis(ra: float) -> float:
    """Upright cylinders in still air."""
    return 0.67 * ra**0.25 if ra < 1e9 else 0.0782 * ra**0.357


_MORGAN = (
    (1e-2, 0.675, 0.058),
    (1e2, 1.02, 0.148),
    (1e4, 0.850, 0.188),
    (1e7, 0.480, 0.250),
    (1e12, 0.125, 0.333),
)
"""Largest Ra of each range, C and n."""


def morgan(ra: float) -> float:
    """Lying cylinders in still air."""
    return next(c * ra**n for highest, c, n in _MORGAN if ra < highest)


def kramers_sphere(re: float) -> float:
    """Spheres in wind."""
    pr = film().prandtl
    return 2 + 1.3 * pr**0.15 + 0.66 * pr**0.31 * re**0.5


def kramers_cylinder(re: float) -> float:
    """Cylinders across the wind."""
    pr = film().prandtl
    return 0.42 * pr**0.20 + 0.57 * pr**0.33 * re**0.5


def _coefficient(term: Any, grid: jt.VoxelGrid, axis: int | None) -> float:
    """Mean h of a warm body [W/(m^2 K)], without the ends across an axis."""
    count = len(grid.fragment_area)
    body = BodySurface(
        body=0,
        grid=grid,
        pose=jt.Pose(),
        position=grid.fragment_position,
        normal=grid.fragment_normal,
        area=grid.fragment_area,
        exposed_fraction=np.ones(count),
        natural=np.ones(count, bool),
        emissivity=np.asarray(0.9),
        absorptivity=np.asarray(0.9),
        occluders=(Occluder.of_triangles(grid.mesh.triangles),),
        dtype=np.dtype("float64"),
    )
    surface = Surface((body,), (AIR,), half_cell=np.full(count, 1e3))
    with precision("float64"):
        (binding,) = term.bind(surface)
        assert isinstance(binding, Binding)
        flux = binding.law.flux(jnp.asarray(0.0), jnp.full(count, _WARM - AIR))
    weight = grid.fragment_area
    if axis is not None:
        weight = weight * (np.abs(grid.fragment_normal[:, axis]) < 0.5)
    mean = float(np.average(np.broadcast_to(np.asarray(flux), count), weights=weight))
    return mean / (AIR - _WARM)


def _comparison(
    h: float, length: float, number: float, law: Callable[[float], float]
) -> Comparison:
    nusselt = h * length / film().conductivity
    return Comparison(number, computed=nusselt, measured=law(number))


def upright_cylinders() -> Iterator[Comparison]:
    """Heights of 0.2 to 2.6 m in still air."""
    term = jt.FreeConvection(AIR, body_shape="cylinder")
    diameter = 0.1743
    for height in (0.2, 0.5, 0.8, 1.3, 2.6):
        grid = jt.voxelize(jt.shapes.cylinder(diameter / 2, height), diameter / 8)
        h = _coefficient(term, grid, axis=2)
        yield _comparison(h, height, rayleigh(height), griffiths_davis)


def lying_cylinders() -> Iterator[Comparison]:
    """Diameters of 1 mm to 0.5 m in still air."""
    for diameter in (1e-3, 1e-2, 0.05, 0.15, 0.5):
        axis = jt.Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), diameter)
        term = jt.FreeConvection(AIR, cylinders=(axis,))
        mesh = jt.shapes.cylinder(diameter / 2, 3 * diameter)
        h = _coefficient(term, jt.voxelize(mesh, diameter / 8), axis=2)
        yield _comparison(h, diameter, rayleigh(diameter), morgan)


def spheres_in_wind() -> Iterator[Comparison]:
    """Spheres of 10 mm in wind."""
    diameter = 0.01
    grid = jt.voxelize(jt.shapes.sphere(diameter / 2), diameter / 8)
    for speed in (0.05, 0.2, 1.0, 3.0):
        term = jt.Wind((speed, 0.0, 0.0), AIR, body_shape="sphere")
        h = _coefficient(term, grid, axis=None)
        number = _reynolds(speed, diameter)
        yield _comparison(h, diameter, number, kramers_sphere)


def cylinders_in_wind() -> Iterator[Comparison]:
    """Cylinders of 2 mm across the wind."""
    diameter = 2e-3
    mesh = jt.shapes.cylinder(diameter / 2, 4 * diameter)
    grid = jt.voxelize(mesh, diameter / 8)
    for speed in (0.1, 0.5, 2.0, 8.0):
        term = jt.Wind((speed, 0.0, 0.0), AIR, body_shape="cylinder")
        h = _coefficient(term, grid, axis=2)
        number = _reynolds(speed, diameter)
        yield _comparison(h, diameter, number, kramers_cylinder)
