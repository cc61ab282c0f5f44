"""Forced convection by wind: the body as cylinders in cross-flow (thesis 5.4, eq. 5-8).

A body that is a plate or a sphere by its proportions (`voxels.body_shape`) has the mean
numbers of `shape_flow`; all others are cylinders,

    q = h (T_inf - T_s),    h = Nu(theta, Re, Pr) k / D,    Re = V D / nu,

with theta from the normal of every fragment (`cross_flow`), D of its cylinder
(`voxels.cylinder_parts`), and nu, k, Pr of air at the local film temperature (`film`).
The term binds once, whatever the number of cylinders: they differ in the coefficients
of their fragments only.

The shape of the flow depends on the temperature of the air, at 0 s if that changes with
time. In a wake the speed is V f(x, y, Re) with x and y in diameters of the objects
upstream (`FittedWake`), the mean over the front of each cylinder; or V f(x) by a
function of the user, where fragments at nearly the same x share one Reynolds number.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from ...arrays import TimeVarying, is_traced, namespace
from ...choices import CylinderAverage
from ...errors import InputError
from ...geometry.vectors import unit_vector
from ...memo.found import found
from ...voxels.body_shape import BodyShape, Plates, Sphere, check_body_shape
from ...voxels.cylinders import Cylinder, given_cylinders
from ...voxels.selection import AbstractSelection
from ..boundary import toward
from ..flux_law import Forcing, Values
from ..surface import Binding, BodySurface, Note, Omitted, Surface, concatenated
from ..term import AbstractSurfaceTerm
from ..time_varying import (
    check_value,
    for_jit,
    is_unknown_function,
    is_zero,
    largest,
    value_at,
)
from .air import kinematic_viscosity
from .convection_shape import convection_shape, flow_parts
from .cross_flow import (
    FlowGroups,
    film_coefficients,
    group_fragments,
    surface_harmonics,
    validity_notes,
)
from .film import FilmExchange, speed_nodes, speed_table
from .nusselt import NamedAverage, named_average
from .shape_flow import MeanNumber, described, mean_coefficients, mean_numbers
from .wake import (
    FittedWake,
    arriving_ratio,
    fitted_notes,
    wake_notes,
    wake_speed_ratio,
)
from .wake_geometry import WakeGeometry, Wakes, upstream_wakes, wake_geometry


_Triple = tuple[float, float, float]


# Nodes of the table for a speed that changes with time.
_SPEED_NODES = 25

# Nodes of that table behind other objects: where wakes begin to shed they change fast.
_WAKE_SPEED_NODES = 73

# A speed given as a plain function of time is limited to this [m/s].
_MAX_UNKNOWN_SPEED = 100.0

# Digits of a direction that is separated from its speed.
_DIRECTION_DIGITS = 12

# Smallest upper end of a table of speeds [m/s].
_MIN_TABLE_LIMIT = 1e-3


if TYPE_CHECKING:
    Wake = FittedWake | Callable[[Float[Array, "..."]], Float[Array, "..."]]
else:
    # The annotation is for editors: the class refuses a wrong value with a remedy.
    Wake = Any


def _velocity(value: Any) -> _Triple:
    try:
        x, y, z = value
        velocity = (float(x), float(y), float(z))
    except (TypeError, ValueError) as error:
        raise InputError(
            f"Wind(velocity={value!r}): give three numbers [m/s]; what changes with "
            "time, or is differentiated by, is `speed`"
        ) from error
    if not np.isfinite(velocity).all():
        raise InputError(f"Wind(velocity={value!r}): give three finite numbers [m/s]")
    return velocity


class Wind(AbstractSurfaceTerm):
    """Wind of one direction on all bodies: plates, spheres, or cylinders in cross-flow.

    q = h (T_inf - T_s),    h = Nu(theta, Re, Pr) k / D [W/(m^2 K)],    Re = V D / nu,

    with the properties of air at the film temperature (T_s + T_inf) / 2. The local
    Nusselt number of cylinders is tabulated by angle (thesis 5.4); its average is one
    of `AVERAGES`. A body that is a plate or a sphere by its proportions (`body_shape`)
    has the mean number of its sides along or across the wind, or that of Whitaker. The
    receipt has the law of each body, with its length.

    Raises:
        InputError: for a speed without a direction, a negative speed, or an unknown
            average or shape.
    """

    name = "wind"
    from_outside = True
    is_convective = True

    velocity: _Triple = eqx.field(static=True, converter=_velocity)
    """Direction of the wind; its length is the speed [m/s] unless `speed` is given."""
    temperature: TimeVarying
    """T_inf of the air [K], a number or a function of time."""
    speed: TimeVarying | None = None
    """V [m/s], instead of the length of `velocity`; a number or a function of time."""
    average: CylinderAverage = eqx.field(static=True, default="churchill_bernstein")
    """Correlation of the mean Nusselt number of cylinders: the name of one of
    `AVERAGES`."""
    cylinders: tuple[Cylinder, ...] = eqx.field(
        static=True, default=None, converter=given_cylinders
    )
    """Cylinders of the bodies that they name; those of other bodies are detected."""
    wake: Wake | None = None
    """Wake of objects upstream: `FittedWake()` by their Reynolds numbers, or a function
    from x / D behind one to the speed ratio u / U, such as `WakeDeficit()`."""
    on: AbstractSelection | None = None
    """Part of the surface that it cools; the cylinders are those of whole bodies."""
    body_shape: BodyShape | None = eqx.field(static=True, default=None)
    """Shape of all bodies, "plate", "cylinder" or "sphere"; None to go by each one's
    proportions."""

    def __check_init__(self):
        check_value(self.temperature, "Wind(temperature [K])", 0.0)
        named_average(self.average)
        check_body_shape(self.body_shape, self.cylinders, "Wind")
        if self.speed is not None:
            unit_vector(self.velocity, "Wind(velocity=)")
            check_value(self.speed, "Wind(speed [m/s])", 0.0)
        if self.wake is not None and not callable(self.wake):
            raise InputError(
                f"Wind(wake={self.wake!r}): give FittedWake(), or a function of x / D "
                "such as WakeDeficit()"
            )

    @property
    @override
    def values(self) -> tuple[Any, ...]:
        return (self.strength, self.temperature)

    @property
    @override
    def by_numbers(self) -> "Wind":
        if self.speed is not None or is_zero(self.strength):
            return self
        # Rounded, so that another speed does not change the direction.
        x, y, z = np.round(unit_vector(self.velocity), _DIRECTION_DIGITS).tolist()
        return replace(self, velocity=(x, y, z), speed=self.strength)

    @property
    def strength(self) -> Any:
        """Wind speed V [m/s]: a number or a function of time."""
        if self.speed is not None:
            return self.speed
        return float(np.linalg.norm(self.velocity))

    @override
    def forcing(self, end: float | int) -> Forcing:
        return toward(self.temperature, end)

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        if is_zero(self.strength):
            return (Omitted("the air stands still"),)
        covers = [body.cover(body.area, self.on) for body in surface.bodies]
        flows = {
            n: self._flow(body, cooled=cover[1])
            for n, (body, cover) in enumerate(zip(surface.bodies, covers, strict=True))
            if not isinstance(cover, Omitted)
        }
        if not flows:
            return tuple(cover for cover in covers if isinstance(cover, Omitted))
        nodes = _SPEED_NODES
        if any(flow.has_fitted_wakes for flow in flows.values()):
            nodes = _WAKE_SPEED_NODES
        tables = {n: self._coefficients(flow, nodes) for n, flow in flows.items()}
        notes = tuple(note for flow in flows.values() for note in self._notes(flow))
        # One law for all bodies: their coefficients differ from fragment to fragment.
        law = FilmExchange(
            coefficients=self._joined(tables, surface),
            temperature=for_jit(self.temperature, surface.dtype),
        )
        return surface.bind(law, covers, notes=notes)

    def _joined(self, tables: dict[int, Any], surface: Surface) -> Any:
        """Coefficients of all fragments, with 0 on bodies without any."""
        lead = next(iter(tables.values())).shape[:-1]
        coefficients = concatenated(
            [
                tables[n] if n in tables else np.zeros((*lead, count), surface.dtype)
                for n, count in enumerate(surface.counts)
            ]
        )
        speed = self.strength
        if not callable(speed):
            return coefficients
        highest = for_jit(_table_limit(speed), surface.dtype)
        return speed_table(coefficients, highest, for_jit(speed, surface.dtype))

    def _notes(self, flow: "_Flow") -> tuple[Note, ...]:
        """Validity of its correlations, where the speed is no unknown function."""
        cooled = flow.cooled
        speed = self.strength
        body = flow.surface.body
        law = Note.of_line(body, self._described(flow))
        if is_unknown_function(speed) or not cooled.any():
            return (law,)
        dtype = flow.surface.dtype
        groups = flow.groups
        wakes = flow.wakes
        wake_lines: Callable[..., tuple[str, ...]] = fitted_notes
        if isinstance(wakes, WakeGeometry):
            felt = _felt_diameters(wakes, cooled)
        else:
            felt = wakes.diameter[cooled & (wakes.diameter > 0)]
            wake_lines = partial(wake_notes, self.wake)
        # Known values stay known where something else is traced.
        with jax.ensure_compile_time_eval():
            highest = jnp.asarray(largest(speed, 0.0), dtype)
            air = _initial_value(self.temperature, dtype)
            per_metre = highest / kinematic_viscosity(jnp.asarray(air))
            ratio = jnp.asarray(self._speed_ratio(flow, highest[None]), dtype)
            unit_length = ratio.reshape(-1) * per_metre
            used = np.unique(groups.member[cooled])
            reached = (unit_length * groups.diameter.astype(dtype))[used]
            upstream = felt.astype(dtype) * per_metre
        ranges = [Note(body, partial(_validity_lines, self.average), reached)]
        if flow.numbers:
            ranges = [
                Note(
                    body,
                    partial(_range_lines, number.correlation),
                    _reached(unit_length, number.length[groups.part])[used],
                )
                for number in flow.numbers
            ]
        return (law, *ranges, Note(body, wake_lines, upstream))

    def _described(self, flow: "_Flow") -> str:
        """One line on the shape of a body and its law."""
        wind = flow.surface.pose.rotate_back(unit_vector(self.velocity))
        if flow.shape is not None:
            return described(flow.shape, flow.numbers, wind)
        diameters = np.unique(flow.groups.diameter[flow.groups.member[flow.cooled]])
        ends = dict.fromkeys(f"{end:.3g} m" for end in diameters[[0, -1]])
        return f"cylinders of {' to '.join(ends)} in diameter ({self.average})"

    def _speed_ratio(self, flow: "_Flow", speeds: Values) -> Float[Values, "*v g"]:
        """Local speed over wind speed of each group [-], at each of the speeds."""
        wakes = flow.wakes
        groups = flow.groups
        if isinstance(wakes, WakeGeometry):
            if not len(wakes.diameter):
                return np.ones(len(groups.diameter))
            facing = -(flow.surface.normal @ unit_vector(self.velocity))
            return arriving_ratio(
                self.wake,
                geometry=wakes,
                member=groups.member,
                front=np.maximum(facing, 0) * flow.surface.grid.fragment_area,
                speeds=speeds,
                air=_initial_value(self.temperature, speeds.dtype),
            )
        if self.wake is None:
            return np.ones(len(groups.diameter))
        return wake_speed_ratio(self.wake, groups.behind)

    def _flow(self, surface: BodySurface, cooled: Bool[np.ndarray, " s"]) -> "_Flow":
        wakes = self._wakes(surface)
        shape = convection_shape(surface, self.body_shape, self.cylinders)
        numbers = ()
        if shape is not None:
            wind = surface.pose.rotate_back(unit_vector(self.velocity))
            numbers = mean_numbers(shape, normal=surface.own_normal, wind=wind)
        groups = self._groups(surface, wakes, shape)
        return _Flow(
            surface,
            cooled=cooled,
            wakes=wakes,
            groups=groups,
            shape=shape,
            numbers=numbers,
        )

    def _wakes(self, surface: BodySurface) -> Wakes | WakeGeometry:
        count = len(surface.position)
        if self.wake is None:
            return Wakes(np.full(count, np.inf), np.zeros(count))
        fitted = isinstance(self.wake, FittedWake)
        search = wake_geometry if fitted else upstream_wakes
        return found(
            (surface.scene_triangles, surface.position),
            by=(search.__name__, self.velocity, surface.pitch),
            find=lambda: search(
                surface.scene_triangles,
                position=surface.position,
                direction=unit_vector(self.velocity),
                pitch=surface.pitch,
            ),
            search=f"objects upstream of body {surface.body}",
        )

    def _groups(
        self,
        surface: BodySurface,
        wakes: Wakes | WakeGeometry,
        shape: Plates | Sphere | None,
    ) -> FlowGroups:
        grid = surface.grid
        cylinders = tuple(c for c in self.cylinders if c.body == surface.body)
        # Without a wake, and in a fitted one, the groups are the cylinders.
        by_cylinder = self.wake is None or isinstance(wakes, WakeGeometry)
        behind = np.full(len(surface.position), np.inf) if by_cylinder else wakes.behind
        return found(
            (grid,) if by_cylinder else (grid, wakes.behind),
            ("flow_groups", type(shape), cylinders),
            lambda: group_fragments(flow_parts(surface, shape, cylinders), behind),
        )

    def _coefficients(self, flow: "_Flow", nodes: int) -> Any:
        """Film polynomial of h for each fragment, at each node of a changing speed."""
        surface = flow.surface
        groups = flow.groups
        dtype = surface.dtype
        speed = self.strength
        if callable(speed):
            speeds = speed_nodes(_table_limit(speed), nodes, dtype)
        else:
            speeds = namespace(speed).asarray(speed, dtype)[None]
        air = _initial_value(self.temperature, dtype)
        ratio = self._speed_ratio(flow, speeds)
        if flow.shape is None:
            wind = surface.pose.rotate_back(unit_vector(self.velocity))
            coefficients = film_coefficients(
                speeds,
                air=air,
                speed_ratio=ratio,
                groups=groups,
                average=named_average(self.average),
                harmonics=surface_harmonics(
                    surface.own_normal, groups.axis, wind
                ).astype(dtype),
                dtype=dtype,
            )
        else:
            coefficients = mean_coefficients(
                flow.numbers,
                speeds=speeds,
                air=air,
                speed_ratio=ratio,
                groups=groups,
                dtype=dtype,
            )
        return coefficients if callable(speed) else coefficients[0]


class _Flow(NamedTuple):
    """Flow around one body."""

    surface: BodySurface
    cooled: Bool[np.ndarray, " s"]
    """Fragments that the wind cools."""
    wakes: Wakes | WakeGeometry
    groups: FlowGroups
    shape: Plates | Sphere | None
    """None for cylinders."""
    numbers: tuple[MeanNumber, ...]
    """Nusselt numbers of plates or a sphere."""

    @property
    def has_fitted_wakes(self) -> bool:
        """True behind objects whose wakes follow their Reynolds numbers."""
        return isinstance(self.wakes, WakeGeometry) and len(self.wakes.diameter) > 0


def _felt_diameters(
    wakes: WakeGeometry, points: Bool[np.ndarray, " s"]
) -> Float[np.ndarray, " o"]:
    """Diameters of the objects in whose wakes the points are [m]."""
    # The widest wakes are some diameters wide.
    felt = (wakes.behind > 0) & (wakes.aside < 2 + 0.2 * np.maximum(wakes.behind, 0))
    return wakes.diameter[(felt & points[None]).any(1)]


def _initial_value(value: Any, dtype: Any) -> Float[Values, ""]:
    """Value of a number or a function of time at 0 s."""
    with jax.ensure_compile_time_eval():
        initial = value_at(value, jnp.zeros((), dtype))
        return initial if is_traced(initial) else np.asarray(initial)


def _validity_lines(average: str, reynolds: Float[np.ndarray, " g"]) -> tuple[str, ...]:
    """Limits of validity that the smallest and the largest number exceed."""
    correlation = named_average(average)
    ends = float(reynolds.min()), float(reynolds.max())
    lines = [line for end in ends for line in validity_notes(end, correlation)]
    return tuple(dict.fromkeys(lines))


def _range_lines(
    correlation: NamedAverage, reynolds: Float[np.ndarray, " g"]
) -> tuple[str, ...]:
    """Lines where Reynolds numbers are outside a correlation's range."""
    ends = float(reynolds.min()), float(reynolds.max())
    lines = [line for end in ends for line in correlation.range_note(end)]
    return tuple(dict.fromkeys(lines))


def _reached(
    per_length: Float[Array, " g"], length: Float[np.ndarray, " g"]
) -> Float[Array, " g"]:
    """Reynolds numbers of groups with these lengths."""
    return per_length * length.astype(per_length.dtype)


def _table_limit(speed: Any) -> Float[Any, ""] | float:
    """Largest speed that a table of speeds has to cover [m/s]."""
    if is_unknown_function(speed):
        return _MAX_UNKNOWN_SPEED
    highest = largest(speed, 0.0)
    return namespace(highest).maximum(highest, _MIN_TABLE_LIMIT)
