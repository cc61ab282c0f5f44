"""Radiation and averages of convection (V23, V24, V25, A14, A15), a frame (A17)."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxthermo.arrays import precision
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.geometry.shapes import sphere
from jaxthermo.image.camera import Camera
from jaxthermo.image.render import render
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.material.material import Material
from jaxthermo.physics.boundary import FixedTemperature
from jaxthermo.physics.convection.cross_flow import local_nusselt
from jaxthermo.physics.convection.nusselt import AVERAGES
from jaxthermo.physics.heat_source import HeatSource
from jaxthermo.physics.radiation.area_source import polygon_view_factor
from jaxthermo.physics.radiation.emission import Surroundings
from jaxthermo.physics.radiation.radiative_exchange import RadiativeExchange
from jaxthermo.reference import radiation as forms
from jaxthermo.reference.view_factor import (
    disc_rule,
    rectangle_rule,
    view_factor,
    view_factor_to_polygon,
)
from jaxthermo.scene.scene import Body, Scene
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.selection import Everything, FragmentMask
from jaxthermo.voxels.voxelize import voxelize

from ..harness.case import Bound, Case, Row, Value, result, values
from .bodies import bar
from .walls import solid, solve


X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)
POINTS = 24
"""Quadrature points along each edge of a rectangle."""

PLATES, SPHERES = 441.0291215, 20.78300772
"""[W/m^2], [W]"""
PEERS_CONSTANT = 5.670367e-8
"""Stefan and Boltzmann's, as A15 has it: CODATA 2014 [W/(m^2 K^4)]."""
REYNOLDS, PRANDTL = 6071.0, 0.7
NUSSELT = {"churchill_bernstein": 40.63709, "sanitjai_goldstein": 40.38327}


def _measure_view_factors() -> Row:
    """V23: Lambert's formula for polygons, integrated over the patch that emits."""
    floor = rectangle_rule(ORIGIN, X, Y, POINTS)
    ceiling = np.array([Z, Z + Y, Z + X + Y, Z + X])
    wall = np.array([ORIGIN, Y, Y + Z, Z])
    across, beside = (view_factor_to_polygon(floor, p) for p in (ceiling, wall))
    discs = view_factor(disc_rule(ORIGIN, Z, 1.0, 16), disc_rule(Z, -Z, 1.0, 16))
    found = (
        ("parallel unit squares, gap 1", 0.1998248957, across),
        ("unit squares that share an edge", 0.2000437761, beside),
        ("the six sides of a cube in all", 1.0, across + 4 * beside),
        ("coaxial discs, r1 = r2 = H", 0.3819660113, discs),
        ("element under a disc, R = H", 0.5, _seen(_disc(1.0))),
    )
    return result(tuple(Value(name, "", e, c, 1e-6) for name, e, c in found))


def _disc(radius: float, corners: int = 8192) -> np.ndarray:
    """A polygon for a disc 1 m above an element, seen from below [m]."""
    turn = -2 * np.pi * np.arange(corners) / corners
    rim = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.column_stack([rim, np.ones(corners)])


def _seen(corners: np.ndarray) -> float:
    """From an element at the origin that looks up."""
    return float(polygon_view_factor(ORIGIN[None], Z[None], corners)[0])


def _measure_enclosures() -> Row:
    """V24 in closed form."""
    plates = forms.between_plates(400.0, 300.0, 0.8, 0.5)
    spheres = forms.between_spheres(0.05, 0.1, 400.0, 300.0, 0.8, 0.5)
    return result(
        (
            Value("endless plates", "W/m^2", PLATES, plates, 1e-6),
            Value("concentric spheres", "W", SPHERES, spheres, 1e-6),
        )
    )


def _measure_sun() -> Row:
    """V25 in closed form."""
    angle = np.pi * (forms.SUN_RADIUS / forms.ASTRONOMICAL_UNIT) ** 2
    found = (
        ("irradiance, 5772 K", "W/m^2", 1361.1632, forms.solar_irradiance(5772.0)),
        ("irradiance, 5800 K", "W/m^2", 1387.768, forms.solar_irradiance(5800.0)),
        ("solid angle", "sr", 6.794274e-5, angle),
    )
    return result(tuple(Value(n, u, e, c, 1e-6 * e) for n, u, e, c in found))


def _measure_plate() -> Row:
    """A14: black plates of 1000 degC, 1 m above an element."""
    black = STEFAN_BOLTZMANN * 1273.15**4 / 1e3
    square = np.array([[-1, 1, 1], [1, 1, 1], [1, -1, 1], [-1, -1, 1]], float)
    strip = square * np.array([1e5, 1.0, 1.0])
    found = [black * _seen(p) for p in (square, strip, _disc(1.0))]
    listed = (82.554, 105.345, 74.490)
    names = ("plate of 2 x 2 m", "endless strip of 2 m", "disc of 2 m")
    return result(values(names, "kW/m^2", listed, found, 1e-3))


def _net_emission(emissivity: float, kelvin: float, around: float) -> float:
    """Net emission of a voxel in its first millisecond [W/m^2]."""
    row = bar(1, 1.0)
    metal = Material(1e9, 8000.0, 500.0, emissivity)
    body = Body(FullVolume(row.grid), metal, temperature=kelvin)
    scene = Scene((body,), (Surroundings(around),), dtype="float64")
    solution = simulate(scene, 1e-3, solver=ForwardEuler(1e-3))
    heat = float(solution.energy.mechanisms["emission"][0])
    return -heat / 1e-3 / float(row.grid.fragment_area.sum())


def _measure_emission() -> Row:
    """A15: emission of a body, by the heat that it loses."""
    found = [_net_emission(1.0, 400.0, 0.0), _net_emission(0.85, 400.0, 305.0)]
    listed = ((1451.614, 5e-4), (816.7822, 5e-5))
    names = ("black, 400 K", "0.85, 400 K among 305 K")
    newer = STEFAN_BOLTZMANN / PEERS_CONSTANT
    rows = zip(names, listed, found, strict=True)
    return result(
        tuple(
            Value(name, "W/m^2", old * newer, now, digit)
            for name, (old, digit), now in rows
        )
    )


def _measure_nusselt() -> Row:
    """A15: averages of cross-flow, and of the local numbers around a cylinder."""
    averages, checks = {a.name: a.nusselt for a in AVERAGES}, []
    with jax.enable_x64(True):
        one = lambda x: jnp.full((64,), x, jnp.float64)
        cosine = jnp.asarray(np.cos(2 * np.pi * np.arange(64) / 64), jnp.float64)
        for name, listed in NUSSELT.items():
            found = float(averages[name](one(REYNOLDS), one(PRANDTL))[0])
            checks.append(Value(name, "", listed, found, 5e-6))
        for name, average in averages.items():
            around = local_nusselt(cosine, one(REYNOLDS), one(PRANDTL), average)
            mean = float(around.mean())
            checks.append(Bound(f"local numbers on {name}", mean, 50.0, 40.0))
    return result(tuple(checks))


INNER, OUTER, OUTSIDE = 0.05, 0.1, 0.12
"""Radii of the ball, the hollow and the body around it [m]."""
HOT_BALL, COLD_SHELL = 400.0, 300.0
CONDUCTIVITY = 1e6
"""So that each surface has one temperature [W/(m K)]."""


def _hollow(inner: float, outer: float) -> Mesh:
    hole, ball = sphere(inner), sphere(outer)
    return Mesh(
        np.concatenate([ball.vertices, hole.vertices]),
        np.concatenate([ball.faces, hole.faces[:, ::-1] + len(ball.vertices)]),
        "hollow ball",
    )


def _measure_spheres() -> Row:
    """V24: the ball's temperature at the heat of the closed form."""
    ball = voxelize(sphere(INNER), 0.005)
    around = voxelize(_hollow(OUTER, OUTSIDE), 0.005)
    outside = np.linalg.norm(around.fragment_position, axis=1) > (OUTER + OUTSIDE) / 2
    bodies = (
        Body(FullVolume(ball), solid(CONDUCTIVITY, 0.8), temperature=HOT_BALL),
        Body(FullVolume(around), solid(CONDUCTIVITY, 0.5), temperature=COLD_SHELL),
    )
    volume = ball.solid_count * ball.voxel_volume
    terms = (
        RadiativeExchange(COLD_SHELL, max_patches=64, directions=32),
        FixedTemperature(COLD_SHELL, on=FragmentMask(outside, body=1)),
        HeatSource(SPHERES / volume, Everything(body=0)),
    )
    solution = solve(bodies, terms)
    kelvin = np.asarray(solution.mean_temperature)[0]
    # What would flow at exactly 100 K of difference, by the exchange that was found.
    gap = (HOT_BALL**4 - COLD_SHELL**4) / (kelvin[0] ** 4 - kelvin[1] ** 4)
    return result(
        (
            Value(
                "ball at the heat of the closed form",
                "K",
                HOT_BALL,
                float(kelvin[0]),
                None,
            ),
            Value("heat at 400 and 300 K", "W", SPHERES, SPHERES * float(gap), None),
        )
    )


APPARENT = 296.4424


def _measure_apparent() -> Row:
    """A17: a box of 300 K in surroundings of 250 K, at the worst pixel."""
    grey = Material(1.0, 1000.0, 1000.0, emissivity=0.91)
    body = Body(FullVolume(bar(2, 0.1).grid), grey, temperature=300.0)
    scene = Scene((body,), (Surroundings(250.0),), dtype="float64")
    camera = Camera((1.0, -1.0, 0.5), (0.0, 0.0, 0.0), width=64, height=48)
    # The frame is in double precision, and so is what is computed from it.
    with precision("float64"):
        image = render(simulate(scene, 0.0, [0.0]), camera)
        seen = np.asarray(image.apparent_temperature)
    seen = seen[np.asarray(image.object_id) == 0]
    worst = float(seen[np.argmax(np.abs(seen - APPARENT))])
    return result((Value("apparent temperature", "K", APPARENT, worst, 5e-5),))


CASES = (
    Case(
        "V23",
        "view factors",
        "Incropera, table 13.2",
        "1e-6",
        "Lambert's formula for polygons under quadrature; discs: both quadratures",
        _measure_view_factors,
    ),
    Case(
        "V24",
        "two grey surfaces, closed forms",
        "Incropera 13.19 to 13.21",
        "1e-6",
        "reference/radiation",
        _measure_enclosures,
    ),
    Case(
        "V25",
        "the sun",
        "nominal radius, astronomical unit",
        "1e-6",
        "reference/radiation; expected to 7 digits",
        _measure_sun,
    ),
    Case(
        "A14",
        "FDS plate_view_factor: an element under hot plates",
        "closed forms (FDS prints 81.8, which is 0.9 % low)",
        "none stated; 1e-3, its digits",
        "Lambert's formula for polygons",
        _measure_plate,
    ),
    Case(
        "A15, emission",
        "grey emission",
        "ht tests/test_radiation.py",
        "none stated; half its last digit",
        "one voxel, its first millisecond; 1451.614 and 816.7822 are listed, with "
        "the constant of 2014",
        _measure_emission,
    ),
    Case(
        "A15, cross-flow",
        "average Nusselt numbers of a cylinder, Re 6071, Pr 0.7",
        "ht tests/test_conv_external.py",
        "none stated; half the last digit; ours within 40 to 50",
        "physics/convection",
        _measure_nusselt,
    ),
    Case(
        "V24, bodies",
        "concentric spheres of voxels",
        "Incropera 13.21",
        "1e-6 is of the closed form; none is stated for voxels: not judged",
        "ball of 10 voxels' radius in a hollow one, 64 patches each; steady",
        _measure_spheres,
    ),
    Case(
        "A17",
        "ThRend: apparent temperature of a grey surface",
        "ThRend main.cpp",
        "none stated; half its last digit",
        "frame of a box of emissivity 0.91 at 300 K, 250 K around",
        _measure_apparent,
    ),
)
