"""The start of a scene of the parts of a mesh file, as YAML with hints."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from ..config.schema.material import material_names
from ..config.strict_yaml import write_flow
from ..geometry.files.file_mesh import ABSENT
from ..geometry.mesh import Mesh
from ..geometry.part_names import matching_parts, short_names
from ..geometry.wall_thickness import wall_thickness
from .touching_parts import DividedPart, touching_parts


_HEAD = """\
# The start of a scene: one rule for all parts of a material, the first match wins.
# Run it with: jaxthermo simulate FILE --set assembly.temperature='20 degC'
"""

_JOINTS = """\
# Parts that touch: delete those that do not conduct into each other; a number is a
# conductance in W/(m^2 K).
joints:
  pairs:
"""

_END = """\
terms:
  - {kind: convection, heat_transfer_coefficient: 10, temperature: 20 degC}
  - {kind: surroundings, temperature: 15 degC}
time: {end: 10 min, save_every: 1 min}
"""

_MATERIAL = "carbon_steel"
"""Material of parts whose material in the file is none of ours."""
_SHEET_THICKNESS = 1e-3
"""Thickness of surfaces that have none in the file [m]."""
_CELLS_OF_SHEET = 40
"""Number of cells along the longest edge of the assembly."""
_VOXELS_THROUGH = 4
_MAX_VOXELS = 200_000
"""Number of voxels in the bounding box of a part with a rule of its own."""
_FINER = 2.0
"""Pitch of so many voxels of a part over that of its rule, at most [-]."""


class _Group(NamedTuple):
    """Properties that the parts of one rule share."""

    word: str
    """Material in the file, or node."""
    pitch: float | None
    """Edge of the voxels of parts that enclose a volume; None for sheets [m]."""

    @property
    def is_solid(self) -> bool:
        """True for parts that enclose a volume."""
        return self.pitch is not None


def scene_start(file: Mapping[str, object], meshes: Mapping[str, Mesh]) -> str:
    """Write rules for all parts: solids where they enclose a volume, else sheets.

    Args:
        file: `path`, `unit` or `height`, and `up` of the mesh file.
        meshes: its parts by name [m].
    """
    names = dict(zip(meshes, short_names(list(meshes)), strict=True))
    by_word: dict[tuple[str, bool], list[str]] = defaultdict(list)
    without_extent: list[str] = []
    for name, mesh in meshes.items():
        if not mesh.has_extent:
            without_extent.append(names[name])
            continue
        word = name.split("/")[-1].split("#")[0]
        by_word[word, mesh.encloses_volume].append(name)
    groups: dict[_Group, list[str]] = {}
    for (word, is_solid), of_word in by_word.items():
        if is_solid:
            for pitch, alike in _by_pitch({name: meshes[name] for name in of_word}):
                groups.setdefault(_Group(word, pitch), []).extend(alike)
        else:
            groups[_Group(word, pitch=None)] = of_word
    corners = np.concatenate([mesh.bounds for mesh in meshes.values()])
    extent = float(np.ptp(corners, axis=0).max())
    lines = [_HEAD, "assembly:\n", f"  mesh: {write_flow(file)}\n"]
    cell = _two_digits(extent / _CELLS_OF_SHEET)
    lines.append(f"  pitch: {cell:g}\n  parts:\n")
    divided: dict[str, DividedPart] = {}
    # The largest group of a material comes last, and matches all that is left of it.
    order = sorted(groups, key=lambda group: len(groups[group]))
    last = {group.word: group for group in order}
    for group in order:
        members = groups[group]
        match: str | list[str] = [names[name] for name in members]
        of_word = [
            n for other in order if other.word == group.word for n in groups[other]
        ]
        is_word = group.word not in names.values() and set(
            matching_parts(group.word, meshes)
        ) == set(of_word)
        if is_word and last[group.word] == group:
            match = group.word
        parts = [meshes[name] for name in members]
        rule = {"match": match, **_rule(group)}
        lines.append(f"    - {write_flow(rule)}{_hint(group, parts)}\n")
        pitch = group.pitch or cell
        for name in members:
            divided[names[name]] = DividedPart(meshes[name], pitch, not group.is_solid)
    if without_extent:
        lines.append(f"    - {ignoring_rule(without_extent)}  # no extent\n")
    return "".join([*lines, *_joints(divided), _END])


def ignoring_rule(names: list[str]) -> str:
    """A rule that leaves parts out."""
    return write_flow({"match": names, "ignore": True})


def _joints(parts: Mapping[str, DividedPart]) -> Iterator[str]:
    """Lines of joints of the parts that touch, few ones: each part with several."""
    names = list(parts)
    pairs = [
        (names[i], names[j]) for i, j in touching_parts([parts[name] for name in names])
    ]
    if pairs:
        yield _JOINTS
    while pairs:
        counts = Counter(name for pair in pairs for name in pair)
        # The first of those that touch most parts.
        hub = max(names, key=lambda name: counts[name])
        neighbours = [b if a == hub else a for a, b in pairs if hub in (a, b)]
        pairs = [pair for pair in pairs if hub not in pair]
        ends = [hub, neighbours if neighbours[1:] else neighbours[0]]
        yield f"    - {write_flow({'parts': ends, 'conductance': 'bonded'})}\n"


def _rule(group: _Group) -> dict[str, object]:
    material = group.word if group.word in material_names() else _MATERIAL
    if group.is_solid:
        return {"material": material, "pitch": group.pitch}
    layer = {"material": material, "thickness": _SHEET_THICKNESS}
    return {"sheet": {"layers": [layer]}}


def _by_pitch(meshes: Mapping[str, Mesh]) -> Iterator[tuple[float, list[str]]]:
    """Names of solids by the pitch that they share: some voxels through the thinnest.

    A small part does not give a large one far too many voxels.
    """
    coarsest = {}
    own_pitch = {}
    for name, mesh in meshes.items():
        size = np.maximum(np.ptp(mesh.bounds, axis=0), 1e-9)
        coarsest[name] = float(np.prod(size) / _MAX_VOXELS) ** (1 / 3)
        own_pitch[name] = max(float(size.min()) / _VOXELS_THROUGH, coarsest[name])
    left = [*meshes]
    while left:
        pitch = min(own_pitch[name] for name in left)
        yield (
            _two_digits(pitch),
            [name for name in left if coarsest[name] <= _FINER * pitch],
        )
        left = [name for name in left if coarsest[name] > _FINER * pitch]


def _hint(group: _Group, parts: list[Mesh]) -> str:
    known = group.word in material_names()
    in_file = "none" if group.word == ABSENT else repr(group.word)
    hints = [] if known else [f"material: the file has {in_file}"]
    if not group.is_solid:
        hints.append("thickness: the file has none")
    walls = [wall_thickness(mesh) if group.is_solid else None for mesh in parts]
    thin = [wall for wall in walls if wall is not None]
    if thin:
        hints.append(f"closed walls of {min(thin):.2g} m: see their voxels")
    return f"  # {'; '.join(hints)}" if hints else ""


def _two_digits(value: float) -> float:
    digits = 1 - math.floor(math.log10(value))
    return round(value, digits)
