"""Free convection in still air: upright parts as plates, others as cylinders.

q = h (T_inf - T_s) with Churchill and Chu's mean h (`churchill_chu`), the same whatever
the direction of the normal. A part of the body whose axis is within 45 degrees of the
vertical, z, is a plate of its height; any other a cylinder of its diameter.

Two polynomials in the film temperature (`film`), common to all places, and a sixth root
made of square roots and one step for a cube root stand for all powers and logarithms.
Differences under 0.01 K are rounded off under that root: q is smooth at T_s = T_inf.
Wind and free convection at once would count twice what the stronger one does alone.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..array_types import Scalar
from ..errors import InputError
from ..voxels.cylinder_parts import parts_of
from ..voxels.cylinders import Cylinder, given_cylinders
from .churchill_chu import CYLINDER, CYLINDER_RISE, PLATE, film_factors
from .film import (
    FILM_TEMPERATURES,
    HIGHEST,
    LOWEST,
    film_place,
    film_polynomial,
    horner,
)
from .term import (
    AbstractLaw,
    AbstractSurfaceTerm,
    Binding,
    Drive,
    LeftOut,
    Surface,
    binding,
)
from .values import check_value, for_jit, largest, value_at


ROUNDED = 0.01
"""Differences of temperature below this count as about this [K]."""

UPRIGHT = float(np.cos(np.pi / 4))
"""Cosine between axis and vertical."""


def _sixth_root(x: Float[Array, "*m"]) -> Float[Array, "*m"]:
    """x^(1/6) for 0.01 to 2000, to 2e-5 of itself, without a power."""
    root = jnp.sqrt(x)
    eighth = jnp.sqrt(jnp.sqrt(root))
    guess = eighth * (0.7 + 0.27 * eighth)
    cube = guess * guess * guess
    # One step of Halley's method for the cube root of sqrt(x).
    return guess * (cube + 2 * root) / (2 * cube + root)


class FreeExchange(AbstractLaw):
    """Free convection, one characteristic length a place."""

    still: Float[Any, " m"]
    """a / sqrt(L) [m^(-1/2)]."""
    rising: Float[Any, " m"]
    """Beta over that of a plate."""
    root: Float[Any, " n"]
    """Film polynomial of sqrt(k)."""
    rise: Float[Any, " n"]
    """Film polynomial of a plate's beta."""
    temperature: Any
    """T_inf [K], a number or a function of time."""
    reference: Float[Any, ""]

    def _at(self, time, theta) -> tuple[Array, Array, Array]:
        """T_inf - T_s, h, and d h / d T_s."""
        ambient = value_at(self.temperature, time)
        below = (ambient - self.reference) - theta
        x, per_kelvin = film_place(ambient + self.reference + theta)
        root, root_slope = horner(self.root, x)
        rise, rise_slope = horner(self.rise, x)
        square = below * below + ROUNDED**2
        sixth = _sixth_root(jnp.sqrt(square))
        whole = self.still * root + self.rising * rise * sixth
        by_film = self.still * root_slope + self.rising * rise_slope * sixth
        by_difference = self.rising * rise * sixth * below / (6 * square)
        slope = by_film * per_kelvin - by_difference
        return below, whole * whole, 2 * whole * slope

    def flux(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """The heat flux h (T_inf - T_s) into the surface [W/m^2]."""
        below, h, _ = self._at(time, theta)
        return h * below

    def slope(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """The slope h - (T_inf - T_s) dh/dT_s."""
        below, h, bend = self._at(time, theta)
        return h - below * bend

    def steepest(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """An upper bound, at a difference that is never exceeded.

        The slope is at most 7/3 h: with the difference h grows with a power below 1/3,
        with the film temperature below 1.
        """
        warmest = jnp.asarray(largest(self.temperature, end), hottest.dtype)
        apart = jnp.maximum(hottest, warmest) + ROUNDED
        film = jnp.linspace(LOWEST, HIGHEST, 17, dtype=hottest.dtype)
        x, _ = film_place(2 * film)
        cast = lambda values: jnp.asarray(values, hottest.dtype)
        root = cast(self.still).max(initial=0.0) * horner(cast(self.root), x)[0]
        rise = cast(self.rising).max(initial=0.0) * horner(cast(self.rise), x)[0]
        h = (root + rise * _sixth_root(apart)) ** 2
        return 7 / 3 * 1.01 * h.max()

    @property
    def is_linear(self) -> bool:
        """No."""
        return False

    def merged(self, mean: Callable[[Array], Array]) -> "FreeExchange":
        """With the mean of each new place."""
        where = lambda law: (law.still, law.rising)
        return eqx.tree_at(where, self, tuple(map(mean, where(self))))


class FreeConvection(AbstractSurfaceTerm):
    """Free convection from every body, in air that stands still.

    Raises:
        InputError: for a temperature or a length that is none.
    """

    temperature: Any
    """T_inf of the air [K], a number or a function of time."""
    length: float | None = eqx.field(static=True, default=None)
    """L [m], of all parts instead of their own height or diameter."""
    cylinders: tuple[Cylinder, ...] = eqx.field(
        static=True, default=None, converter=given_cylinders
    )
    """For the bodies that they name; those of other bodies are found."""

    def __check_init__(self):
        check_value(self.temperature, "FreeConvection(temperature [K])", 0.0)
        given = self.length
        if given is not None and not (
            isinstance(given, int | float) and 0 < given < np.inf
        ):
            raise InputError(
                f"FreeConvection(length={given!r}): give a positive length in metres"
            )

    @property
    def name(self) -> str:
        """In the ledger."""
        return "free_convection"

    @property
    def values(self) -> tuple[Any, ...]:
        """Its temperature."""
        return (self.temperature,)

    def drive(self, end: float | int) -> Drive:
        """Towards its temperature [K]."""
        return Drive(temperature=largest(self.temperature, end))

    def bind(
        self, surface: Surface, reference: Scalar
    ) -> tuple[Binding, ...] | LeftOut:
        """Every free fragment, as part of a plate or of a cylinder."""
        acts = surface.acted_on(None)
        if isinstance(acts, LeftOut):
            return acts
        dtype = surface.dtype
        parts = parts_of(surface.grid, self.cylinders, surface.body)
        up = surface.pose.unturn(np.array([0.0, 0.0, 1.0]))
        still, rising = zip(*(self._part(c, up) for c in parts.cylinders), strict=True)
        with jax.ensure_compile_time_eval():
            factors = film_factors(jnp.asarray(FILM_TEMPERATURES, dtype))
            root, rise = (np.asarray(film_polynomial(each)) for each in factors)
        law = FreeExchange(
            still=np.array(still, dtype)[parts.fragment],
            rising=np.array(rising, dtype)[parts.fragment],
            root=root,
            rise=rise,
            temperature=for_jit(self.temperature, dtype),
            reference=jnp.asarray(reference, dtype),
        )
        return (binding(surface.area, law, acts),)

    def _part(
        self, cylinder: Cylinder, up: Float[np.ndarray, "3"]
    ) -> tuple[float, float]:
        """What `FreeExchange` holds of a part."""
        upright = abs(float(cylinder.direction @ up)) >= UPRIGHT
        own = cylinder.length if upright else cylinder.diameter
        length = self.length or own
        if length is None:
            raise InputError(
                f"FreeConvection(cylinders=): the upright one at {cylinder.axis_point} "
                "has no length: give it one, or FreeConvection a length"
            )
        kind, rising = (PLATE, 1.0) if upright else (CYLINDER, CYLINDER_RISE)
        return kind.a / length**0.5, rising
