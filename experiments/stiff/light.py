"""Sources that graze a surface, stand behind it or touch it (S19)."""

from collections.abc import Iterator

import numpy as np

import jaxthermo as jt

from .bodies import COLD, STEEL, block
from .case import Case, Check, Row, broken
from .methods import damping
from .solved import Method, run_nodes, stable_step


PITCH = 0.01
PLACES = {
    "grazing, in the plane of the top": (1.0, 0.0, 0.03),
    "behind the top": (0.0, 0.0, -1.0),
    "on the surface": (0.005, 0.005, 0.03),
    "1 nm above it": (0.005, 0.005, 0.03 + 1e-9),
}
LEAST = 0.01
"""Distance from on which a source is a point [m]."""


def sources() -> Iterator[Row]:
    """S19."""
    grid = block(6, 6, 6, PITCH)
    top = grid.fragment_normal[:, 2] > 0.9
    for what, place in PLACES.items():
        try:
            source = jt.PointSource(place, 1.0, min_distance=LEAST)
            found = source.exposure(
                grid.mesh.triangles,
                grid.fragment_position,
                grid.fragment_normal,
                grid.pitch,
            )
        except Exception as error:
            yield broken(what, error)
            continue
        most = float(found[top].max())
        dark = 0.0 if "above" not in what else 1 / LEAST**2
        checks = (
            Check("exposure of the top", most, dark, 0.0),
            Check("anywhere", float(found.max()), 1 / LEAST**2, 0.0),
        )
        yield Row(what, seen=f"top at most {most:.4g} 1/m^2", checks=checks)
    body = jt.Body(jt.FullVolume(grid), STEEL, temperature=COLD)
    lamp = jt.PointSource((1.0, 0.0, 0.03), 100.0, min_distance=LEAST)
    scene = jt.Scene((body,), (lamp,), dtype="float64")
    for method in damping(stable_step(scene), ratio=100.0)[:3]:
        yield _grazed(scene, method, grid)


def _grazed(scene: jt.Scene, method: Method, grid: jt.VoxelGrid) -> Row:
    """A lamp in the plane of the top: energy closes, and nothing cools."""
    try:
        ran = run_nodes(scene, method.solver, method.end)
    except Exception as error:
        return broken("a lamp that grazes", error, method.name, scene.dtype)
    cooled = COLD - float(ran.nodes[0].min())
    checks = (
        Check("energy", ran.residual, 1e-12),
        Check("cooled", cooled, 1e-8),
        Check("not finite", float(not np.isfinite(ran.nodes[0]).all()), 0),
    )
    return Row(
        "a lamp that grazes",
        method.name,
        scene.dtype,
        energy_residual=ran.residual,
        compile_s=ran.compile_s,
        run_s=ran.run_s,
        result=ran.result,
        checks=checks,
    )


CASES = (
    Case(
        "S19",
        "a point source that grazes, stands behind or touches a surface",
        "max(0, L . n) is 0 there; 1 / R^2 stops at the least distance",
        "I max(0, L . n) / max(R, R_0)^2",
        sources,
    ),
)
