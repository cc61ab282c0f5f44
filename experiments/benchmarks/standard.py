"""The standard scene: a statue with the sun from +x for half of the time, and air."""

from collections.abc import Callable
from typing import Any

import jaxthermo as jt

from ..thesis.meshes import HEIGHT, thesis_meshes


STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0, absorptivity=1.0)
COPPER = jt.Material(401.0, density=8960.0, specific_heat=385.0, absorptivity=1.0)
"""29 times as stiff."""

START = 293.15
SAVE_AT = (30.0, 60.0, 90.0, 135.0, 180.0)
END = 180.0


def standard_scene(
    material: jt.Material,
    structure: Callable[..., Any],
    height: int,
    sun_until: float = 90.0,
) -> tuple[jt.Scene, str]:
    """The Happy Buddha, or what stands in for it, and its name.

    Args:
        material: of the body.
        structure: made of its voxels.
        height: in voxels.
        sun_until: when the sun goes down [s].
    """
    name, mesh = next(iter(thesis_meshes().items()))
    grid = jt.voxelize(mesh, HEIGHT / height)
    body = jt.Body(structure(grid), material, temperature=START)
    terms = (
        jt.Sun((-1.0, 0.0, 0.0), jt.Until(5000.0, sun_until)),
        jt.Convection(10.0, START),
    )
    return jt.Scene((body,), terms), name
