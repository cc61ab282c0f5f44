"""V24 as bodies: a ball of voxels in a hollow one, by patches and radiosity."""

import numpy as np

from jaxthermo.geometry.mesh import Mesh
from jaxthermo.geometry.shapes import sphere
from jaxthermo.physics.boundary import FixedTemperature
from jaxthermo.physics.heat_source import HeatSource
from jaxthermo.physics.radiation.radiative_exchange import RadiativeExchange
from jaxthermo.scene.scene import Body
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.selection import Everything, FragmentMask
from jaxthermo.voxels.voxelize import voxelize

from .case import Case, Measured, Value
from .radiation import SPHERES
from .walls import solid, solve


INNER, OUTER, OUTSIDE = 0.05, 0.1, 0.12
"""Radii of the ball, the hollow and the body around it [m]."""
HOT, COLD = 400.0, 300.0
CONDUCTIVITY = 1e6
"""So that each surface has one temperature [W/(m K)]."""


def _hollow(inner: float, outer: float) -> Mesh:
    hole, ball = sphere(inner), sphere(outer)
    return Mesh(
        np.concatenate([ball.vertices, hole.vertices]),
        np.concatenate([ball.faces, hole.faces[:, ::-1] + len(ball.vertices)]),
        "hollow ball",
    )


def measure_spheres() -> Measured:
    """V24: the ball's temperature at the heat of the closed form."""
    ball = voxelize(sphere(INNER), 0.005)
    around = voxelize(_hollow(OUTER, OUTSIDE), 0.005)
    outside = np.linalg.norm(around.fragment_position, axis=1) > (OUTER + OUTSIDE) / 2
    bodies = (
        Body(FullVolume(ball), solid(CONDUCTIVITY, 0.8), temperature=HOT),
        Body(FullVolume(around), solid(CONDUCTIVITY, 0.5), temperature=COLD),
    )
    volume = ball.solid_count * ball.voxel_volume
    terms = (
        RadiativeExchange(COLD, max_patches=64, directions=32),
        FixedTemperature(COLD, on=FragmentMask(outside, body=1)),
        HeatSource(SPHERES / volume, Everything(body=0)),
    )
    solution = solve(bodies, terms)
    kelvin = np.asarray(solution.mean_temperature)[0]
    # What would flow at exactly 100 K of difference, by the exchange that was found.
    gap = (HOT**4 - COLD**4) / (kelvin[0] ** 4 - kelvin[1] ** 4)
    return Measured(
        (
            Value(
                "ball at the heat of the closed form", "K", HOT, float(kelvin[0]), None
            ),
            Value("heat at 400 and 300 K", "W", SPHERES, SPHERES * float(gap), None),
        )
    )


CASES = (
    Case(
        "V24, bodies",
        "concentric spheres of voxels",
        "Incropera 13.21",
        "1e-6 is of the closed form; none is stated for voxels: not judged",
        "ball of 10 voxels' radius in a hollow one, 64 patches each; steady",
        measure_spheres,
    ),
)
