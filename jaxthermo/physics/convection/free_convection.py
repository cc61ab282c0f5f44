"""Free convection in still air, from plates, spheres and cylinders.

A body is one of them by its proportions (`voxels.body_shape`); the laws of plates and
spheres are in `shape_exchange`. That of cylinders is

    q = h (T_inf - T_s),    h = Nu k / L,    Nu = (a + b Ra^(1/6))^2,
    Ra = g |T_s - T_inf| L^3 Pr / (T_f nu^2),
    b = 0.387 / [1 + (c / Pr)^(9/16)]^(8/27)

with a = 0.825, c = 0.492 and L the height for a vertical plate (Churchill and Chu 1975,
IJHMT 18, 1323), and a = 0.6, c = 0.559 and L the diameter for a horizontal cylinder
(IJHMT 18, 1049; Ra up to 1e12). Properties of air are taken at the film temperature
T_f. The mean h applies whatever the direction of the normal. A cylinder whose axis is
within 40 degrees of the vertical, z, is a plate of its height, one beyond 50 degrees a
horizontal one of its diameter; between them the factors pass smoothly from one to the
other.

Where `Wind` acts too, the cubes of both coefficients add up (`mixed_convection`).
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override

from ...arrays import TimeVarying, smooth_step
from ...errors import InputError
from ...voxels.body_shape import (
    BodyShape,
    Plate,
    Plates,
    Sphere,
    check_body_shape,
)
from ...voxels.cylinders import Cylinder, given_cylinders, parts_of
from ...voxels.selection import AbstractSelection
from ..boundary import toward
from ..flux_law import Forcing
from ..surface import Binding, BodySurface, Note, Omitted, Surface
from ..term import AbstractSurfaceTerm
from ..time_varying import check_value, for_jit, largest, value_at
from .air import (
    FilmDerivatives,
    film_argument,
    film_derivatives,
    horner,
    sampled_arguments,
)
from .buoyancy import (
    CYLINDER,
    CYLINDER_OVER_PLATE,
    PLATE,
    REGULARIZATION,
    film_rows,
    sixth_root,
)
from .convection_shape import convection_shape
from .film import SAMPLING_MARGIN, AbstractFilmLaw, FilmState, film_range
from .shape_exchange import PlateExchange, SphereExchange, plate_factors


# Samples of the temperature difference for bounds.
_DIFFERENCE_SAMPLES = 257

# Cosines between axis and vertical of tilted cylinders, 50 and 40 degrees: between them
# the law passes smoothly from that of lying ones to that of upright ones.
_LYING_COSINE = float(np.cos(np.radians(50.0)))
_UPRIGHT_COSINE = float(np.cos(np.radians(40.0)))


class _Bounds(NamedTuple):
    """Bounds of w = sqrt(h) at sampled differences and film temperatures."""

    apart: Float[np.ndarray, "d 1"]
    """Differences |T_s - T_inf| [K]."""
    w: Float[np.ndarray, "d f"]
    """Bound of |w| [W^(1/2) / (m K^(1/2))]."""
    dw: Float[np.ndarray, "d f"]
    """Bound of |dw / dT_s|."""
    ddw: Float[np.ndarray, "d f"]
    """Bound of |d2w / dT_s^2|."""


class _FreeExchange(AbstractFilmLaw):
    """Heat flux h (T_inf - T_s) of free convection [W/m^2].

    sqrt(h) = still sqrt(k) + rising beta |T_s - T_inf|^(1/6)
    """

    still: Float[Any, " m"]
    """a / sqrt(L) [m^(-1/2)]."""
    rising: Float[Any, " m"]
    """Ratio of beta to beta of a plate [-]."""
    root: Float[Any, " n"]
    """Film polynomial of sqrt(k)."""
    rise: Float[Any, " n"]
    """Film polynomial of beta of a plate."""
    temperature: Any
    """T_inf [K], a number or a function of time."""
    reference: Any = 0.0

    @override
    def state(self, time, theta) -> FilmState:
        ambient = value_at(self.temperature, time)
        below = (ambient - self.reference) - theta
        x, per_kelvin = film_argument(ambient + self.reference + theta)
        root, root_slope = horner(self.root, x)
        rise, rise_slope = horner(self.rise, x)
        square = below * below + REGULARIZATION**2
        sixth = sixth_root(jnp.sqrt(square))
        w = self.still * root + self.rising * rise * sixth
        by_film = self.still * root_slope + self.rising * rise_slope * sixth
        by_difference = self.rising * rise * sixth * below / (6 * square)
        slope = by_film * per_kelvin - by_difference
        return FilmState(difference=below, h=w * w, dh=2 * w * slope)

    @override
    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        # The slope is at most 7/3 h: h grows with the difference by a power below 1/3,
        # with the film temperature below 1. The difference is never exceeded.
        warmest = jnp.asarray(largest(self.temperature, end), hottest.dtype)
        apart = jnp.maximum(hottest, warmest) + REGULARIZATION
        x = sampled_arguments(hottest.dtype)
        root_rows = jnp.asarray(self.root, hottest.dtype)
        rise_rows = jnp.asarray(self.rise, hottest.dtype)
        still = jnp.asarray(self.still, hottest.dtype).max(initial=0.0)
        rising = jnp.asarray(self.rising, hottest.dtype).max(initial=0.0)
        root = still * horner(root_rows, x)[0]
        rise = rising * horner(rise_rows, x)[0]
        h = (root + rise * sixth_root(apart)) ** 2
        return 7 / 3 * 1.01 * h.max()

    @override
    def max_flux(self, within: Forcing, end: float) -> float:
        sampled = self._sampled(within, end)
        return SAMPLING_MARGIN * float((sampled.apart * sampled.w**2).max())

    @override
    def curvature(self, within: Forcing, end: float) -> float:
        # |h'' (T_inf - T_s)| + 2 |h'| with h = w^2. The second derivative of the sixth
        # root at 0 is bounded thanks to the regularization.
        if not film_range(self.temperature, within, end).smooth:
            return np.inf
        apart, w, dw, ddw = self._sampled(within, end)
        curvature = 2 * apart * (dw**2 + w * ddw) + 4 * w * dw
        return SAMPLING_MARGIN * float(curvature.max())

    def _sampled(self, within: Forcing, end: float) -> _Bounds:
        # The absolute values of all terms of a derivative are added.
        air = film_range(self.temperature, within, end)
        root = _scaled_derivatives(self.still, self.root, air.film)
        rise = _scaled_derivatives(self.rising, self.rise, air.film)
        tiny = REGULARIZATION / 100
        apart = np.geomspace(tiny, max(air.gap, tiny), _DIFFERENCE_SAMPLES)[:, None]
        square = apart**2 + REGULARIZATION**2
        sixth = square ** (1 / 12)
        steep = sixth * apart / (6 * square)
        second = sixth * np.abs(1 / 6 - 11 / 36 * apart**2 / square) / square
        return _Bounds(
            apart=apart,
            w=root.value + rise.value * sixth,
            dw=root.first + rise.first * sixth + rise.value * steep,
            ddw=root.second
            + rise.second * sixth
            + 2 * rise.first * steep
            + rise.value * second,
        )

    @override
    def coarsened(self, mean: Callable[[Array], Array]) -> "_FreeExchange":
        return replace(self, still=mean(self.still), rising=mean(self.rising))


def _scaled_derivatives(
    factors: Float[Any, " m"], rows: Float[Any, " n"], film: Float[np.ndarray, " f"]
) -> FilmDerivatives:
    """Absolute film polynomial and derivatives, times the largest factor."""
    largest_factor = float(np.max(factors, initial=0.0))
    derivatives = film_derivatives(np.asarray(rows, float), film)
    return FilmDerivatives(*(largest_factor * np.abs(row) for row in derivatives))


class FreeConvection(AbstractSurfaceTerm):
    """Free convection from all bodies in still air.

    q = h (T_inf - T_s),    h = Nu(Ra, Pr) k / L [W/(m^2 K)]

    A body is a plate, a sphere or cylinders, by its proportions (`body_shape`). Sides
    of plates have laws by their normals, with L = A / P up and down and their height
    upright (McAdams 1954; Churchill and Chu 1975), spheres that of Churchill (1983).
    Upright cylinders count as plates of their height, others as horizontal ones of
    their diameter (Churchill and Chu, IJHMT 18 (1975) 1049 and 1323). The receipt has
    the law of each body, with its length.

    Raises:
        InputError: for a negative temperature, a length that is not positive, or an
            unknown shape.
    """

    name = "free_convection"
    from_outside = True
    is_convective = True

    temperature: TimeVarying
    """T_inf of the air [K], a number or a function of time."""
    length: float | None = eqx.field(static=True, default=None)
    """L of all parts [m]; None for the lengths, heights or diameters of each."""
    cylinders: tuple[Cylinder, ...] = eqx.field(
        static=True, default=None, converter=given_cylinders
    )
    """Cylinders of the bodies that they name; those of other bodies are detected."""
    on: AbstractSelection | None = None
    """Part of the surface that it cools."""
    body_shape: BodyShape | None = eqx.field(static=True, default=None)
    """Shape of all bodies, "plate", "cylinder" or "sphere"; None to go by each one's
    proportions."""

    def __check_init__(self):
        check_value(self.temperature, "FreeConvection(temperature [K])", 0.0)
        length = self.length
        if length is not None and not (
            isinstance(length, int | float) and 0 < length < np.inf
        ):
            raise InputError(
                f"FreeConvection(length={length!r}): give a positive length in metres"
            )
        check_body_shape(self.body_shape, self.cylinders, "FreeConvection")

    @override
    def forcing(self, end: float | int) -> Forcing:
        return toward(self.temperature, end)

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        covers = [body.cover(body.area, self.on) for body in surface.bodies]
        by_shape: dict[type, dict[int, _BodyLaw]] = {}
        for n, (body, cover) in enumerate(zip(surface.bodies, covers, strict=True)):
            if not isinstance(cover, Omitted):
                law = self._law(body)
                by_shape.setdefault(law.exchange, {})[n] = law
        if not by_shape:
            law = self._exchange(_FreeExchange, {}, surface)
            return surface.bind(law, covers)
        omitted = [cover for cover in covers if isinstance(cover, Omitted)]
        bindings = []
        for exchange, laws in by_shape.items():
            binding, *_ = surface.bind(
                self._exchange(exchange, laws, surface),
                [
                    cover if n in laws else Omitted("of another shape", n)
                    for n, cover in enumerate(covers)
                ],
                notes=tuple(
                    Note.of_line(surface.bodies[n].body, law.description)
                    for n, law in laws.items()
                ),
            )
            bindings.append(binding)
        return (*bindings, *omitted)

    def _exchange(
        self, exchange: type[Any], laws: dict[int, "_BodyLaw"], surface: Surface
    ) -> AbstractFilmLaw:
        """One law for all bodies of a shape, with 0 for the factors of others."""
        dtype = surface.dtype
        names = next(iter(laws.values())).factors if laws else ("still", "rising")
        factors = {
            name: np.concatenate(
                [
                    laws[n].factors[name] if n in laws else np.zeros(count)
                    for n, count in enumerate(surface.counts)
                ]
            ).astype(dtype)
            for name in names
        }
        rows = film_rows(dtype)
        if exchange is _FreeExchange:
            film = {"root": rows.root, "rise": rows.rise}
        else:
            film = {"rows": rows}
        temperature = for_jit(self.temperature, dtype)
        return exchange(**factors, **film, temperature=temperature)

    def _law(self, body: BodySurface) -> "_BodyLaw":
        """Law of one body by its shape."""
        shape = convection_shape(body, self.body_shape, self.cylinders)
        up = body.pose.rotate_back(np.array([0.0, 0.0, 1.0]))
        if isinstance(shape, Plates):
            return _BodyLaw(
                PlateExchange,
                _factors_of_plates(shape, body.own_normal, up=up, length=self.length),
                _plates_line(shape, up=up, length=self.length),
            )
        if isinstance(shape, Sphere):
            diameter = self.length or shape.diameter
            per_length = np.full(len(body.area), 1 / diameter)
            line = f"a sphere with L = {_metres(diameter)}, its diameter (Churchill)"
            return _BodyLaw(SphereExchange, {"per_length": per_length}, line)
        cylinder_parts = parts_of(body.grid, self.cylinders, body.body)
        factors = [
            self._cylinder_factors(cylinder, up)
            for cylinder in cylinder_parts.cylinders
        ]
        fragment = cylinder_parts.fragment
        still = np.array([factor.still for factor in factors])
        rising = np.array([factor.rising for factor in factors])
        return _BodyLaw(
            _FreeExchange,
            {"still": still[fragment], "rising": rising[fragment]},
            _cylinder_line(factors),
        )

    def _cylinder_factors(
        self, cylinder: Cylinder, up: Float[np.ndarray, "3"]
    ) -> "_CylinderFactors":
        """Factors of one cylinder."""
        cosine = abs(float(cylinder.direction @ up))
        t = (cosine - _LYING_COSINE) / (_UPRIGHT_COSINE - _LYING_COSINE)
        t = min(max(t, 0.0), 1.0)
        upright = smooth_step(t)
        height = self.length or cylinder.length
        if height is None and upright > 0:
            raise InputError(
                f"FreeConvection(cylinders=): the upright one at {cylinder.axis_point} "
                "has no length: give it one, or FreeConvection a length"
            )
        diameter = float(self.length or cylinder.diameter)
        standing = 0.0 if height is None else PLATE.a / float(height) ** 0.5
        lying = CYLINDER.a / diameter**0.5
        if upright in (0.0, 1.0):
            still, rising = (standing, 1.0) if upright else (lying, CYLINDER_OVER_PLATE)
        else:
            still = upright * standing + (1 - upright) * lying
            rising = upright + (1 - upright) * CYLINDER_OVER_PLATE
        length = height if upright >= 0.5 and height is not None else diameter
        return _CylinderFactors(
            still=still, rising=rising, length=float(length), is_upright=upright >= 0.5
        )


class _CylinderFactors(NamedTuple):
    """Factors of one cylinder, and its length."""

    still: float
    rising: float
    length: float
    """Height of an upright one, diameter of any other [m]."""
    is_upright: bool


class _BodyLaw(NamedTuple):
    """Law of one body."""

    exchange: type[Any]
    """Class of the law."""
    factors: dict[str, Float[np.ndarray, " s"]]
    """Factors of the fragments, by the names of its fields."""
    description: str
    """The shape of the body, its lengths and the source of the law."""


def _factors_of_plates(
    shape: Plates,
    normal: Float[np.ndarray, "s 3"],
    *,
    up: Float[np.ndarray, "3"],
    length: float | None,
) -> dict[str, Float[np.ndarray, " s"]]:
    """Factors of `plate_factors` of all fragments, by their plates."""
    factors: dict[str, Float[np.ndarray, " s"]] = {}
    for number, plate in enumerate(shape.plates):
        on_plate = np.flatnonzero(shape.member == number)
        of_plate = plate_factors(plate, normal=normal[on_plate], up=up, length=length)
        for name, values in of_plate.items():
            factors.setdefault(name, np.zeros(len(normal)))[on_plate] = values
    return factors


def _plates_line(
    shape: Plates, up: Float[np.ndarray, "3"], length: float | None
) -> str:
    if len(shape.plates) == 1:
        return _plate_line(shape.plates[0], up, length)
    faces = [length or plate.length for plate in shape.plates]
    heights = [length or float(plate.mean_length(up)) for plate in shape.plates]
    return (
        f"{len(shape.plates)} panels, each a plate, sides up and down with L = A / P = "
        f"{_metres(min(faces))} to {_metres(max(faces))} (McAdams), upright with L = "
        f"{_metres(min(heights))} to {_metres(max(heights))} (Churchill and Chu)"
    )


def _plate_line(plate: Plate, up: Float[np.ndarray, "3"], length: float | None) -> str:
    face = length or plate.length
    height = length or float(plate.mean_length(up))
    return (
        f"a plate {_metres(plate.thickness)} thick, sides up and down with L = A / P = "
        f"{_metres(face)} (McAdams), upright with L = {_metres(height)} (Churchill and "
        "Chu)"
    )


def _cylinder_line(cylinders: list[_CylinderFactors]) -> str:
    names = []
    for word, is_upright in (("upright", True), ("lying", False)):
        lengths = [c.length for c in cylinders if c.is_upright == is_upright]
        if lengths:
            ends = dict.fromkeys([_metres(min(lengths)), _metres(max(lengths))])
            size = "height" if is_upright else "diameter"
            names.append(
                f"{len(lengths)} {word} with L = {' to '.join(ends)}, the {size}"
            )
    return f"cylinders: {'; '.join(names)} (Churchill and Chu)"


def _metres(length: float) -> str:
    return f"{length:.3g} m"
