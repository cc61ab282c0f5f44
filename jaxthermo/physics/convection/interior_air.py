"""Still air inside a closed body."""

import numpy as np
from equinox import AbstractVar, field
from jaxtyping import Bool
from typing_extensions import override

from ...arrays import TimeVarying
from ...errors import InputError
from ...voxels.selection import known_number
from ..boundary import Exchange, toward
from ..flux_law import Forcing
from ..surface import Binding, BodySurface, Cover, Omitted, Surface
from ..term import AbstractSurfaceTerm, OperatingPoint, Scale
from ..time_varying import check_value, for_jit, is_zero, largest


class AbstractInteriorAir(AbstractSurfaceTerm):
    """Air in the closed cavities of a body, q = h (T_air - T_s) on what faces it."""

    name = "interior_air"
    is_convective = True

    heat_transfer_coefficient: AbstractVar[TimeVarying]
    """h [W/(m^2 K)], a number or a function of time."""

    @override
    def acting_fraction(self, body: BodySurface) -> float:
        del body
        return 1.0

    @override
    def scale(self, point: OperatingPoint) -> Scale:
        h = float(largest(self.heat_transfer_coefficient, point.end))
        return Scale(heat_transfer_coefficient=h)


class InteriorAir(AbstractInteriorAir):
    """Air in the closed cavities of a body, q = h (T_air - T_s).

    It acts on all that faces these cavities: the inner face of a closed sheet, the
    inner surface of a hollow solid, and the bodies within it.

    Example:
        >>> import jaxthermo as jt
        >>> steel = jt.Material(45.0, 7850.0, specific_heat=480.0)
        >>> box = jt.shapes.box((1.0, 0.5, 0.5))
        >>> sheet = jt.Sheet(box, (jt.Layer(steel, 0.8e-3),), pitch=0.25)
        >>> van = jt.Body(sheet, temperature=283.0)
        >>> terms = (jt.Convection(20.0, 283.0), jt.InteriorAir(5.0, 298.0, body=0))
        >>> receipt = jt.compile_scene(jt.Scene((van,), terms)).receipt
        >>> [(part.mechanism, round(part.area, 6)) for part in receipt.parts]
        [('convection', 2.5), ('interior_air', 2.5)]
    """

    heat_transfer_coefficient: TimeVarying
    """h [W/(m^2 K)], a number or a function of time."""
    temperature: TimeVarying
    """T_air [K], a number or a function of time."""
    body: int | str = field(static=True, default=0)
    """Number or name of the body that encloses the air."""

    def __check_init__(self):
        h = self.heat_transfer_coefficient
        check_value(h, "InteriorAir(heat_transfer_coefficient [W/(m^2 K)])", 0.0)
        check_value(self.temperature, "InteriorAir(temperature [K])", 0.0)

    @property
    @override
    def named_bodies(self) -> tuple[int, ...]:
        return (known_number(self.body),)

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        covers = inner_covers(surface, known_number(self.body), "InteriorAir")
        if surface.prune and is_zero(self.heat_transfer_coefficient):
            return (Omitted("the heat transfer coefficient is 0"),)
        law = Exchange(
            coefficient=for_jit(self.heat_transfer_coefficient, surface.dtype),
            temperature=for_jit(self.temperature, surface.dtype),
        )
        return surface.bind(law, covers)

    @override
    def forcing(self, end: float | int) -> Forcing:
        return toward(self.temperature, end)


def inner_covers(surface: Surface, around: int, term: str) -> list[Cover | Omitted]:
    """Area of all that faces the closed cavities of a body, for the named term.

    Raises:
        InputError: if the body has none.
    """
    inner = [_inner(body, around) for body in surface.bodies]
    if not inner[around].any():
        raise InputError(_without_inside(surface.bodies[around], term))
    covers: list[Cover | Omitted] = []
    for body, is_inner in zip(surface.bodies, inner, strict=True):
        if not is_inner.any():
            covers.append(body.omitted(f"it is not inside body {around}"))
            continue
        exposed = body.exposed_of(is_inner)
        is_omitted = isinstance(exposed, Omitted)
        covers.append(exposed if is_omitted else (body.area, exposed))
    return covers


def _inner(body: BodySurface, around: int) -> Bool[np.ndarray, " s"]:
    if body.enclosing is None:
        return np.zeros(len(body.area), bool)
    return body.enclosing == around


def _without_inside(body: BodySurface, term: str) -> str:
    remedy = body.grid.why_open
    if body.grid.cavities is not None:
        remedy = "leave out its `inside: open`"
    return f"{term}(body={body.body}): body {body.body} encloses no air; {remedy}"
