"""From counted to true: how much area and volume fragments and voxels stand for."""

from typing import NamedTuple

from ..geometry.mesh import Mesh


TRUSTED_RATIO = 2.0
"""A ratio beyond this means that parts are lost, not that a surface is rounded off."""

TRUSTED_OVERLAP = 2e-3
"""Share of the surface that may lie inside the body before its volume is doubted."""


class Scaling(NamedTuple):
    """Factors from counted to true area and volume; 1 if they cannot be trusted."""

    area_ratio: float
    volume_ratio: float
    unscaled_because: str
    """Empty if the ratios apply."""


def true_scaling(mesh: Mesh, area: float, volume: float, hidden_area: float) -> Scaling:
    """The scaling that gives back the mesh's own area and volume.

    Args:
        mesh: the body.
        area: of all fragments kept [m^2].
        volume: of all solid voxels [m^3].
        hidden_area: of the fragments inside the body [m^2].
    """
    doubt = _doubt(mesh, area, volume, hidden_area)
    if doubt:
        return Scaling(1.0, 1.0, doubt)
    return Scaling(mesh.area / area, mesh.volume / volume, "")


def _doubt(mesh: Mesh, area: float, volume: float, hidden_area: float) -> str:
    edges = mesh.open_edges
    if edges:
        return f"the mesh is open ({edges} open edges): it has no volume of its own"
    overlap = hidden_area / (area + hidden_area)
    if overlap > TRUSTED_OVERLAP:
        return f"parts overlap or touch: {overlap:.1%} of the surface lies inside"
    for what, ratio in ("area", mesh.area / area), ("volume", mesh.volume / volume):
        if not 1 / TRUSTED_RATIO < ratio < TRUSTED_RATIO:
            return (
                f"the mesh has {ratio:.2g} times the {what} of what was voxelized: "
                "parts of it are too thin for this pitch"
            )
    return ""
