"""What a mesh is worth to the solver, as plain data and as one line."""

import numpy as np

from .connectivity import edges_of, is_closed, part_labels
from .mesh import Mesh
from .winding import part_volumes


def describe_mesh(mesh: Mesh) -> dict:
    """Facts about a mesh as plain types, ready for JSON.

    `area` [m^2], `volume` [m^3] (None if the mesh is open: it has no inside), `size`
    along x, y, z [m]; `bodies` counts the connected parts that point outward or are
    open, `cavities` the closed ones that point inward.
    """
    labels = part_labels(mesh.faces)
    parts = int(labels.max(initial=-1)) + 1
    closed = is_closed(edges_of(mesh.faces), labels, parts)
    cavities = int((closed & (part_volumes(mesh, labels, parts) < 0.0)).sum())
    return {
        "name": mesh.name,
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "watertight": mesh.is_watertight,
        "open_edges": mesh.open_edges,
        "volume": mesh.volume if mesh.is_watertight else None,
        "area": mesh.area,
        "size": [float(side) for side in np.ptp(mesh.bounds, axis=0)],
        "bodies": parts - cavities,
        "cavities": cavities,
        "axes": list(mesh.axes),
        "repairs": dict(mesh.repairs),
    }


def verdict_line(mesh: Mesh) -> str:
    """One line for the terminal: closed or not, how large, what was mended."""
    facts = describe_mesh(mesh)
    width, depth, height = facts["size"]
    if facts["watertight"]:
        state = f"watertight, volume {facts['volume']:.4g} m^3"
    else:
        state = f"open ({_count(facts['open_edges'], 'open edge')}), no volume"
    parts = _count(facts["bodies"], "body", "bodies")
    if facts["cavities"]:
        parts += f" with {_count(facts['cavities'], 'cavity', 'cavities')}"
    repairs = ", ".join(
        f"{number} {kind.replace('_', ' ')}"
        for kind, number in facts["repairs"].items()
    )
    return (
        f"{facts['name']}: {facts['faces']} faces, {state}, area {facts['area']:.4g} "
        f"m^2, {width:.4g} x {depth:.4g} x {height:.4g} m, {parts}; "
        f"repaired: {repairs or 'nothing'}"
    )


def _count(number: int, one: str, many: str | None = None) -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"
