"""Joints between the bodies of a scene, by rules of their names."""

from collections.abc import Mapping, Sequence

from ..arrays import TimeVarying
from ..errors import InputError, located
from ..physics.contact.joint import AbstractJoint, Groups
from ..physics.contact.links import Contact
from ..physics.contact.seam import Seam
from ..structures.kinds.sheet import Sheet
from .body_numbers import body_numbers
from .scene import Body


def joints(
    bodies: Sequence[Body],
    pairs: Mapping[tuple[str, str], TimeVarying] | None = None,
    *,
    default: TimeVarying | None = None,
    threshold: float | None = None,
) -> tuple[AbstractJoint, ...]:
    """Make the terms by which bodies that touch conduct, faces and borders alike.

    Of two bodies the first rule that matches their names counts.

    Args:
        bodies: all bodies of the scene.
        pairs: conductance h_c of the joints [W/(m^2 K)], by two patterns of names as in
            `assembly`; infinity bonds, 0 insulates.
        default: h_c of all other bodies that touch; None to leave them apart.
        threshold: largest gap of a joint [m]; None for a voxel of the finer body, and
            for a tenth of it between two sheets and at the border of one.

    Raises:
        InputError: for a pattern that matches no name, or a value that is wrong.

    Example:
        >>> import jaxthermo as jt
        >>> cube = jt.shapes.box((0.02, 0.02, 0.02))
        >>> parts = {"left": cube, "right": cube.moved((0.02, 0.0, 0.0))}
        >>> def solid(mesh):
        ...     return jt.FullVolume(jt.voxelize(mesh, pitch=0.01))
        >>> rules = [jt.Rule("*", solid, material=jt.materials["brick"])]
        >>> bodies = jt.assembly(parts, rules, temperature=293.15)
        >>> (contact,) = jt.joints(bodies, {("left", "right"): 500.0})
        >>> contact.bodies
        ((0,), (1,))
    """
    for pair in pairs or ():
        if not isinstance(pair, tuple) or len(pair) != 2:
            raise InputError(
                f"joints(pairs=): {pair!r} is no pair: give two patterns of names, as "
                'in {("roof", "rear"): 500.0}'
            )
    names = [body.name for body in bodies]
    rules: list[tuple[Groups | None, TimeVarying]] = [
        ((_numbers_of(first, names), _numbers_of(second, names)), conductance)
        for (first, second), conductance in (pairs or {}).items()
    ]
    if default is not None:
        rules.append((None, default))
    # Sheets alone have borders.
    has_sheets = any(isinstance(body.structure, Sheet) for body in bodies)
    kinds = (Contact, Seam) if has_sheets else (Contact,)
    return tuple(
        kind(conductance, bodies=groups, threshold=threshold)
        for groups, conductance in rules
        for kind in kinds
    )


def _numbers_of(pattern: str, names: Sequence[str]) -> tuple[int, ...]:
    with located("joints(pairs=)"):
        return body_numbers(pattern, names)
