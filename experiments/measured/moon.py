"""The Moon's day: sunlight, emission, and regolith that varies with T and depth.

    k = k_z [1 + 2.7 (T / 350 K)^3],    k_z = 3.4e-3 - 2.66e-3 exp(-z / H) [W/(m K)],
    rho = 1800 - 700 exp(-z / H) [kg/m^3],    H = 0.07 m,    c_p a polynomial in T

(Hayne et al. 2017, JGR Planets 122, 2371; c_p by Hemingway et al. 1981). The albedo
grows with the angle of incidence i,

    A = A_0 + 0.06 (4 i / pi)^3 + 0.25 (2 i / pi)^8

(Keihm 1984; Vasavada et al. 2012). Their authors found H, k and these albedos from
Diviner's temperatures: there the case tests the solution alone. The means of Apollo's
probes in the ground are independent.

The measured numbers are those of Hayne et al. (2017), table A2 and figure A2, as kept
in the repository heat1d of their first author (commit f7f87ae7).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

import jaxthermo as jt


LUNATION = 29.53059 * 86400.0  # [s]
_SOLAR_CONSTANT = 1361.0  # [W/m^2]
_HEAT_FLOW = 0.018  # [W/m^2], from below
_SCALE = 0.07  # [m]
_DEPTH = 0.9  # [m]
_PITCH = 4e-3  # [m]
_DENSITY = 1800.0  # [kg/m^3], far below
_CONDUCTIVITY = 3.4e-3  # [W/(m K)], far below
_SPACE = 3.0  # [K]
_START = 250.0  # [K]
_TEMPERATURES = np.array([80, 110, 140, 180, 220, 260, 300, 335, 370, 400.0])
_HEAT_CAPACITY = (8.9093e-9, -1.234e-5, 2.3616e-3, 2.7431, -3.6125)
"""Coefficients of c_p [J/(kg K)] by falling powers of T."""
_SUN_TIMES = 720
"""Values of the sunlight in a lunation."""


class _Site(NamedTuple):
    """A place on the Moon."""

    name: str
    latitude: float
    """[deg]"""
    albedo: float
    """A_0 at normal incidence [-]."""
    depth: float
    """Depth of a probe in the ground [m]."""


EQUATOR = _Site("equator", 0.0, albedo=0.12, depth=0.5)
APOLLO_15 = _Site("Apollo 15", 26.0, albedo=0.07, depth=0.83)
APOLLO_17 = _Site("Apollo 17", 20.0, albedo=0.07, depth=0.13)
SITES = (EQUATOR, APOLLO_15, APOLLO_17)

UNCERTAINTY = 5.0  # [K], of each number below
NOON = 385.0  # [K]
MIDNIGHT = 101.0  # [K]
LEAST = 95.0  # [K]
NIGHT = np.array(
    (
        (8.48, 107.50),
        (9.48, 104.60),
        (10.46, 102.39),
        (11.51, 100.38),
        (12.48, 98.95),
        (13.48, 97.67),
        (14.49, 96.31),
        (15.49, 95.09),
        (16.49, 94.13),
    )
)
"""Hours after noon, 24 a lunation, and temperatures of ground without rocks at the
equator [K]."""
APOLLO_MEANS = {
    "Apollo 15, surface": 211.0,
    "Apollo 15, 0.83 m": 252.0,
    "Apollo 17, surface": 216.0,
    "Apollo 17, 0.13 m": 256.0,
}
"""Means over a lunation [K]."""


class _Day(NamedTuple):
    """One lunation of one site, from noon to noon."""

    hour: Float[np.ndarray, " t"]
    """24ths of a lunation since midnight before the first noon, 12 to 36."""
    surface: Float[np.ndarray, " t"]
    """[K]"""
    ground: Float[np.ndarray, " t"]
    """Temperature of the probe [K]."""

    def after_noon(self, hours: Float[np.ndarray, "*h"]) -> Float[np.ndarray, "*h"]:
        """Temperatures of the surface hours after noon [K]."""
        return np.interp(hours + self.hour[0], self.hour, self.surface)

    @property
    def surface_mean(self) -> float:
        """Mean temperature of the surface [K]."""
        return float(self.surface[1:].mean())

    @property
    def ground_mean(self) -> float:
        """Mean temperature of the probe [K]."""
        return float(self.ground[1:].mean())


def _looseness(depth: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """exp(-z / H)."""
    return np.exp(-depth / _SCALE)


def density(depth: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Density at depths [kg/m^3]."""
    return _DENSITY - 700.0 * _looseness(depth)


def conductivity(depth: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Conductivity k_z at depths, without the share that radiates [W/(m K)]."""
    return _CONDUCTIVITY - (_CONDUCTIVITY - 7.4e-4) * _looseness(depth)


def packed(depth: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Thickness of the ground above these depths at the density far below [m]."""
    return depth - 700.0 / _DENSITY * _SCALE * (1 - _looseness(depth))


def _link_weight(depth: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """k_z rho at depths over that of the surface [-].

    By the packed thickness m, with dm = rho / rho_d dz, the ground is of one density:

        rho_d c_p dT/dt = d/dm (k rho / rho_d dT/dm)
    """
    surface = np.zeros(1)
    at_surface = conductivity(surface) * density(surface)
    return conductivity(depth) * density(depth) / at_surface


def regolith() -> jt.Material:
    """The ground by its packed thickness, with the conductivity of its surface."""
    surface = np.zeros(1)
    packed_conductivity = (conductivity(surface) * density(surface))[0] / _DENSITY
    rise = 1 + 2.7 * (_TEMPERATURES / 350.0) ** 3
    return jt.Material(
        jt.Property(_TEMPERATURES, packed_conductivity * rise),
        density=_DENSITY,
        specific_heat=jt.Property(
            _TEMPERATURES, np.polyval(_HEAT_CAPACITY, _TEMPERATURES)
        ),
        emissivity=0.95,
        absorptivity=1.0,
    )


def columns(count: int, pitch: float) -> jt.FullVolume:
    """Columns side by side, whose lattices count the packed thickness."""
    nodes = round(packed(np.full(1, _DEPTH))[0] / pitch)
    solid = np.zeros((2 * count - 1, 1, nodes), bool)
    solid[::2] = True
    grid = jt.grid_from_voxels(solid, pitch, origin=(0.0, 0.0, -nodes * pitch))
    bare = jt.FullVolume(grid)
    links = bare.links()
    height = bare.nodes().centre[:, 2]
    face = -(height[links.src] + height[links.dst]) / 2
    depths = np.linspace(0.0, 2 * _DEPTH, 20_001)
    weight = _link_weight(np.interp(face, packed(depths), depths))
    return jt.FullVolume(grid, weights=jt.ConductionWeights(links=weight))


def sunlight(site: _Site, time: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
    """Absorbed sunlight (1 - A) S cos i of level ground [W/m^2]; noon at time 0."""
    turned = np.cos(2 * np.pi * time / LUNATION)
    height = np.maximum(np.cos(np.radians(site.latitude)) * turned, 0.0)
    incidence = np.arccos(height)
    albedo = site.albedo + 0.06 * (4 * incidence / np.pi) ** 3
    albedo = albedo + 0.25 * (2 * incidence / np.pi) ** 8
    return (1 - albedo) * _SOLAR_CONSTANT * height


def _scene(sites: tuple[_Site, ...], lunations: int) -> jt.Scene:
    """A column of regolith for each site, all of one body; they start at noon."""
    structure = columns(len(sites), _PITCH)
    bottom, top = structure.grid.mesh.bounds[:, 2]
    body = jt.Body(structure, regolith(), temperature=_START)
    time = np.linspace(0.0, lunations * LUNATION, lunations * _SUN_TIMES + 1)
    sky = jt.Side((0.0, 0.0, 1.0))
    terms: list[jt.Sun | jt.Surroundings | jt.HeatFlux] = [
        jt.Surroundings(_SPACE, on=sky),
        jt.HeatFlux(_HEAT_FLOW, on=jt.Side((0.0, 0.0, -1.0))),
    ]
    probes = {}
    for n, site in enumerate(sites):
        middle = (2 * n + 0.5) * _PITCH
        column = jt.Region(
            (middle - _PITCH, 0.0, bottom), upper=(middle + _PITCH, _PITCH, top)
        )
        probe = float(packed(np.full(1, site.depth))[0])
        light = jt.Table(time, sunlight(site, time))
        terms.append(jt.Sun((0.0, 0.0, -1.0), light, on=column & sky))
        probes[site.name] = (middle, _PITCH / 2, -probe)
    return jt.Scene(
        (body,),
        tuple(terms),
        probes=probes,
        dtype="float64",
        allow_extreme_temperatures=True,
    )


def last_days(
    sites: tuple[_Site, ...] = SITES, lunations: int = 40
) -> tuple[_Day, ...]:
    """The last of several lunations, of each site."""
    hour = np.linspace(12.0, 36.0, 193)
    saves = (lunations - 1 + (hour - 12.0) / 24.0) * LUNATION
    solver = jt.SuperTimeStepping(dt=LUNATION / _SUN_TIMES)
    moon = _scene(sites, lunations)
    solution = jt.simulate(moon, float(saves[-1]), saves.tolist(), solver=solver)
    grid = moon.bodies[0].structure.grid
    tops = np.flatnonzero(grid.fragment_normal[:, 2] > 0.5)
    tops = tops[np.argsort(grid.fragment_position[tops, 0])]
    surface = np.asarray(solution.surface_temperature)[:, tops]
    ground = np.asarray(jt.probe(solution))
    return tuple(
        _Day(hour, surface=surface[:, n], ground=ground[:, n])
        for n in range(len(sites))
    )
