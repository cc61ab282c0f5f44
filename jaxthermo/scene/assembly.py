"""Bodies from the parts of a mesh file, by rules of their names."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from ..choices import Inside
from ..errors import InputError, require, shortened
from ..geometry.equal_parts import placed_parts
from ..geometry.mesh import Mesh
from ..geometry.part_names import assign_rules, short_names
from ..material.material import Material
from ..structures.structure import AbstractStructure
from ..structures.surface_map import AbstractSurfaceMap, FluxCorrectedMap
from .body_materials import AbstractMaterials
from .coating import Coating
from .scene import Body


@dataclass(frozen=True)
class Rule:
    """Rule for the parts of an assembly that no earlier rule matches.

    Example:
        >>> import jaxthermo as jt
        >>> def blocks(mesh):
        ...     return jt.Aggregate(jt.voxelize(mesh, pitch=0.01), factor=2)
        >>> rule = jt.Rule("wheel*", blocks, material=jt.materials["cast_iron"])
    """

    match: str | Sequence[str]
    """Pattern of names, or several: "*" stands for any characters. One with a "/" is
    for the whole name node/mesh/material, another one for one of the three."""
    structure: Callable[[Mesh], AbstractStructure] | None = None
    """Function from the mesh of a part to its structure, called once for equal parts;
    None to leave these parts out."""
    material: Material | AbstractMaterials | None = None
    """Material of a solid; None for a sheet."""
    temperature: float | None = None
    """Initial temperature, instead of that of the assembly [K]."""
    surface_map: AbstractSurfaceMap = FluxCorrectedMap()
    coatings: tuple[Coating, ...] = ()
    """Radiative properties of parts of the surface, later ones on top."""
    inside: Inside = "closed"
    """With "open", air, sun and surroundings act in closed cavities as well."""

    def __post_init__(self):
        is_listed = isinstance(self.match, str | list | tuple)
        patterns = self.patterns if is_listed else ()
        if not patterns or not all(isinstance(pattern, str) for pattern in patterns):
            raise InputError(
                f"Rule(match={shortened(self.match)}): give a pattern of names, or "
                "several"
            )
        if self.structure is not None and not callable(self.structure):
            raise InputError(
                f"Rule(structure={shortened(self.structure)}): give a function from a "
                "mesh to its structure, or None to leave these parts out"
            )

    @property
    def patterns(self) -> tuple[str, ...]:
        """The patterns of names."""
        return (self.match,) if isinstance(self.match, str) else tuple(self.match)


def assembly(
    parts: Mapping[str, Mesh],
    rules: Sequence[Rule],
    *,
    temperature: float | None = None,
) -> tuple[Body, ...]:
    """Make a body of each part, by the first rule that matches its name.

    A body has the name of its node, or of the whole part where others have that too.
    Parts of equal geometry have one mesh and one structure, in the frame of the first
    of them, and their positions as poses.

    Args:
        parts: meshes by name, as of `load_parts`.
        rules: for the parts, the first that matches counts.
        temperature: initial temperature of bodies whose rule has none [K].

    Raises:
        InputError: for a part without a rule, a rule without a part, a part without
            extent or without a temperature.

    Example:
        >>> import jaxthermo as jt
        >>> tyre = jt.shapes.box((0.02, 0.02, 0.02))
        >>> parts = {"left": tyre, "right": tyre.moved((0.1, 0.0, 0.0))}
        >>> def solid(mesh):
        ...     return jt.FullVolume(jt.voxelize(mesh, pitch=0.01))
        >>> rules = [jt.Rule("*", solid, material=jt.materials["brick"])]
        >>> left, right = jt.assembly(parts, rules, temperature=293.15)
        >>> right.name, right.pose.translation, left.structure is right.structure
        ('right', (0.1, 0.0, 0.0), True)
    """
    meshes = "meshes by their names, as of load_parts(path)"
    require(parts, classes=Mapping, argument="assembly(parts=)", give=meshes)
    if not parts:
        raise InputError(f"assembly(parts={parts!r}): give {meshes}")
    listed = 'rules, as in [Rule("*", structure)]'
    require(rules, classes=(list, tuple), argument="assembly(rules=)", give=listed)
    for number, rule in enumerate(rules):
        give = 'a rule, as in (Rule("*", structure),)'
        require(rule, classes=Rule, argument=f"assembly(rules[{number}]=)", give=give)
    short = dict(zip(parts, short_names(list(parts)), strict=True))
    assigned = assign_rules([rule.patterns for rule in rules], short)
    for fault in assigned.faults:
        where = "rules" if fault.rule is None else f"rules[{fault.rule}]"
        raise InputError(f"assembly({where}=): {fault.line}")
    structures: dict[tuple[int, int], AbstractStructure] = {}
    bodies = []
    placed = placed_parts(parts)
    for name, number in assigned.rule_of.items():
        rule = rules[number]
        if rule.structure is None:
            continue
        mesh = placed[name].mesh
        if not mesh.has_extent:
            raise InputError(
                f"assembly(parts=): the part {name!r} has no extent: leave it out by "
                f"Rule({short[name]!r})"
            )
        initial = temperature if rule.temperature is None else rule.temperature
        if initial is None:
            raise InputError(
                f"assembly(temperature=): missing, and rules[{number}] has none: give "
                "kelvin"
            )
        key = (id(mesh), number)
        if key not in structures:
            structures[key] = rule.structure(mesh)
        bodies.append(
            Body(
                structures[key],
                rule.material,
                temperature=initial,
                pose=placed[name].pose,
                surface_map=rule.surface_map,
                coatings=rule.coatings,
                inside=rule.inside,
                name=short[name],
            )
        )
    return tuple(bodies)
