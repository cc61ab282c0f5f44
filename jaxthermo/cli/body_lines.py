"""Lines and rows about the bodies of a scene: of many, one for all that are alike."""

import math
import re
from typing import NamedTuple

from ..geometry.mesh import mesh_summary
from ..host_memory import readable_bytes
from ..report.numbers import count
from ..scene.air import bodies_with_surface
from ..scene.body_mass import body_mass
from ..scene.compile.body_names import body_labels
from ..scene.scene import Body, Scene
from ..structures.kinds.sheet import Sheet
from ..structures.report import StructureReport


# Smaller deviations of the capacity ratio from 1 are rounding [-].
_CAPACITY_TOLERANCE = 1e-6


MAX_BODIES = 8
"""Number of bodies up to which each has its own lines."""
_MAX_KINDS = 20
"""Number of kinds of bodies, of equal structure and size, that are described."""
_MAX_NAMES = 3
"""Number of bodies of a kind that are named."""


def described(body: Body, report: StructureReport) -> list[str]:
    """Lines about a body: its mesh, its cells, its structure, and its sizes."""
    grid = body.structure.grid
    edge = f"{grid.pitch * 1e3:.4g} mm"
    if isinstance(body.structure, Sheet):
        cells = f"{count(body.structure.surface_cells, 'cell')} of {edge} on a surface"
    else:
        shape = " x ".join(str(n) for n in grid.lattice.shape)
        voxels = count(body.structure.voxels.solid_count, "solid voxel")
        cells = f"{voxels} of {edge} in {shape}"
    return [
        mesh_summary(grid.mesh),
        f"{cells}, {len(grid.fragment_area):,} surface fragments",
        *structure_lines(report),
        _sizes(body),
    ]


def body_lines(scene: Scene, descriptions: list[list[str]]) -> list[str]:
    """Lines about all bodies; of many, one for each kind."""
    bodies = bodies_with_surface(scene)
    labels = body_labels(scene)[: len(bodies)]
    if len(labels) <= MAX_BODIES:
        lines = []
        for body, label, (mesh, *details) in zip(
            bodies, labels, descriptions, strict=True
        ):
            lines.append(f"{label}: {mesh}" if body.name else mesh)
            lines += [f"  {detail}" for detail in details]
        return lines
    alike: dict[str, list[str]] = {}
    for label, (_, *details) in zip(labels, descriptions, strict=True):
        alike.setdefault("; ".join(details), []).append(label)
    kinds = sorted(alike.items(), key=lambda kind: -len(kind[1]))
    lines = [f"{len(labels):,} bodies of {count(len(kinds), 'kind')}:"]
    lines += [
        f"  {_some(of_kind)}: {details}" for details, of_kind in kinds[:_MAX_KINDS]
    ]
    if len(kinds) > _MAX_KINDS:
        others = sum(len(of_kind) for _, of_kind in kinds[_MAX_KINDS:])
        lines.append(
            f"  and {others:,} more of {len(kinds) - _MAX_KINDS:,} other kinds"
        )
    return lines


def _some(labels: list[str], noun: str = "bodies") -> str:
    """Some labels of many: "4 bodies (body 1 (a), body 2 (b), ..)"."""
    if len(labels) == 1:
        return labels[0]
    dots = ", .." if len(labels) > _MAX_NAMES else ""
    return f"{len(labels):,} {noun} ({', '.join(labels[:_MAX_NAMES])}{dots})"


class ReceiptRow(NamedTuple):
    """A mechanism on a body, or on two in contact."""

    mechanism: str
    where: str
    area: float
    """[m^2]"""
    share: float
    """Fraction of the surface [-]; NaN for that of several bodies."""
    volume: float
    """[m^3]"""
    heat_rate: float
    """At the start [W]; NaN for conduction."""
    is_of_pair: bool = False

    @property
    def cells(self) -> tuple[str, ...]:
        """Texts of a table, with nothing for what there is not."""
        return (
            self.mechanism,
            self.where,
            f"{self.area:.4g} m2" if self.area else "",
            ""
            if not self.area or math.isnan(self.share)
            else f"{100 * self.share:.3g} %",
            f"{self.volume:.4g} m3" if self.volume else "",
            "" if math.isnan(self.heat_rate) else f"{self.heat_rate:.4g} W",
        )


def summed(rows: list[ReceiptRow]) -> list[ReceiptRow]:
    """One row for each mechanism, on all of its bodies."""
    by_mechanism: dict[str, list[ReceiptRow]] = {}
    for row in rows:
        by_mechanism.setdefault(row.mechanism, []).append(row)
    return [
        ReceiptRow(
            mechanism,
            where=_some(
                [row.where for row in same],
                noun="pairs" if same[0].is_of_pair else "bodies",
            ),
            area=sum(row.area for row in same),
            share=math.nan,
            volume=sum(row.volume for row in same),
            heat_rate=sum(row.heat_rate for row in same),
        )
        for mechanism, same in by_mechanism.items()
    ]


def _sizes(body: Body) -> str:
    structure = body.structure
    return (
        f"{body_mass(body):.4g} kg, {structure.volume:.4g} m3, "
        f"{float(structure.grid.fragment_area.sum()):.4g} m2"
    )


def structure_lines(report: StructureReport) -> list[str]:
    """Lines about a structure: its nodes, links and memory, and the heat it holds."""
    name = re.sub(r"(?<!^)(?=[A-Z])", " ", report["kind"]).lower()
    factor = report["options"].get("factor")
    if factor is not None:
        edge = factor * report["pitch_m"] * 1e3
        name += f" x{factor} (blocks of {edge:.4g} mm)"
    nodes = count(report["nodes"], "node")
    links = count(report["links"], "link")
    size = readable_bytes(report["bytes_float32"]["total"])
    lines = [f"{name}: {nodes}, {links}, {size}"]
    ratio = report["capacity_ratio"]
    if abs(ratio - 1) > _CAPACITY_TOLERANCE:
        # Two digits of the deviation from 100 %: 62 %, but 99.95 % and not 100 %.
        decimals = max(0, 1 - math.floor(math.log10(100 * abs(ratio - 1))))
        percent = f"{100 * ratio:.{decimals}f}"
        lines.append(f"the structure holds {percent} % of the body's heat capacity")
    return lines
