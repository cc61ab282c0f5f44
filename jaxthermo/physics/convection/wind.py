"""Forced convection by wind: the body as cylinders in cross-flow (thesis 5.4, eq. 5-8).

    q = h (T_inf - T_s),    h = Nu(theta, Re, Pr) k / D,    Re = V D / nu,

with theta from the normal of every fragment (`cross_flow`), D of its cylinder
(`voxels.cylinder_parts`), and nu, k, Pr of air at the local film temperature (`film`).
The term binds once, whatever the number of cylinders: they differ in the coefficients
of their fragments only.

The shape of the flow depends on the temperature of the air, at 0 s if that changes with
time. In a wake the speed is V f(x, y, Re) with x and y in diameters of the objects
upstream (`fitted_wake`), the mean over the front of each cylinder; or V f(x) by a
function of the user, where fragments at nearly the same x share one Reynolds number.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from ...arrays import TimeVarying, is_traced
from ...errors import InputError
from ...findings import found
from ...raster.views import unit_vector
from ...voxels.cylinders import Cylinder, given_cylinders, parts_of
from ...voxels.selection import AbstractSelection
from ..boundary import toward
from ..flux_law import Forcing, Values
from ..surface import Binding, BodySurface, Omitted, Surface, concatenated
from ..term import AbstractSurfaceTerm
from ..time_varying import (
    Table,
    Until,
    check_value,
    for_jit,
    is_unknown_function,
    is_zero,
    largest,
    value_at,
)
from .air import kinematic_viscosity
from .cross_flow import (
    FlowGroups,
    film_coefficients,
    group_fragments,
    surface_harmonics,
    validity_notes,
)
from .film import FilmExchange, speed_nodes, speed_table
from .fitted_wake import FittedWake, arriving_ratio, fitted_notes
from .nusselt import named_average
from .wake import wake_notes, wake_speed_ratio
from .wake_geometry import WakeGeometry, Wakes, upstream_wakes, wake_geometry


# Nodes of the table for a speed that changes with time.
_SPEED_NODES = 25

# The same behind other objects, whose wakes change fast where they begin to shed.
_WAKE_SPEED_NODES = 73

# A speed given as a plain function of time is limited to this [m/s].
_MAX_UNKNOWN_SPEED = 100.0

# Smallest upper end of a table of speeds [m/s].
_MIN_TABLE_LIMIT = 1e-3


if TYPE_CHECKING:
    Wake = FittedWake | Callable[[Float[Array, "..."]], Float[Array, "..."]]
else:
    # For editors: the class refuses a wrong value with a remedy.
    Wake = Any


def _velocity(given: Any) -> tuple[float, float, float]:
    try:
        x, y, z = (float(v) for v in given)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"Wind(velocity={given!r}): give three numbers [m/s]; what changes with "
            "time, or is differentiated by, is `speed`"
        ) from error
    if not np.isfinite([x, y, z]).all():
        raise InputError(f"Wind(velocity={given!r}): give three finite numbers [m/s]")
    return x, y, z


class Wind(AbstractSurfaceTerm):
    """Wind of one direction on all bodies, each modelled as cylinders in cross-flow.

    q = h (T_inf - T_s),    h = Nu(theta, Re, Pr) k / D [W/(m^2 K)],    Re = V D / nu,

    with the properties of air at the film temperature (T_s + T_inf) / 2. The local
    Nusselt number is tabulated by angle (thesis 5.4); its average is one of `AVERAGES`.

    Raises:
        InputError: for a speed without a direction, a negative speed, or an unknown
            average.
    """

    name = "wind"
    from_outside = True
    is_convective = True

    velocity: tuple[float, float, float] = eqx.field(static=True, converter=_velocity)
    """Direction of the wind; its length is the speed [m/s] unless `speed` is given."""
    temperature: TimeVarying
    """T_inf of the air [K], a number or a function of time."""
    speed: TimeVarying | None = None
    """V [m/s], instead of the length of `velocity`; a number or a function of time."""
    average: str = eqx.field(static=True, default="churchill_bernstein")
    """Correlation of the mean Nusselt number: the name of one of `AVERAGES`."""
    cylinders: tuple[Cylinder, ...] = eqx.field(
        static=True, default=None, converter=given_cylinders
    )
    """Cylinders of the bodies that they name; those of other bodies are detected."""
    wake: Wake | None = None
    """Wake of objects upstream: `FittedWake()` by their Reynolds numbers, or a function
    from x / D behind one to the speed ratio u / U, such as `WakeDeficit()`."""
    on: AbstractSelection | None = None
    """Part of the surface that it cools; the cylinders are those of whole bodies."""

    def __check_init__(self):
        check_value(self.temperature, "Wind(temperature [K])", 0.0)
        named_average(self.average)
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
    def strength(self) -> Any:
        """Wind speed V [m/s]: a number or a function of time."""
        return (
            float(np.linalg.norm(self.velocity)) if self.speed is None else self.speed
        )

    @override
    def forcing(self, end: float | int) -> Forcing:
        return toward(self.temperature, end)

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        if is_zero(self.strength):
            return (Omitted("the air stands still"),)
        exposed = [body.exposed(self.on) for body in surface.bodies]
        omitted = tuple(each for each in exposed if isinstance(each, Omitted))
        if len(omitted) == len(exposed):
            return omitted
        # One law for all bodies: their coefficients differ from fragment to fragment.
        tables, notes, covers = [], [], []
        upstream = [
            None if isinstance(where, Omitted) else self._wakes(body)
            for body, where in zip(surface.bodies, exposed, strict=True)
        ]
        nodes = _SPEED_NODES
        if any(isinstance(w, WakeGeometry) and len(w.diameter) for w in upstream):
            nodes = _WAKE_SPEED_NODES
        for body, where, wakes in zip(surface.bodies, exposed, upstream, strict=True):
            if isinstance(where, Omitted) or wakes is None:
                tables.append(None)
                covers.append(where)
                continue
            groups = self._groups(body, wakes)
            ratio = lambda speeds, body=body, groups=groups, wakes=wakes: (
                self._speed_ratio(body, groups, wakes, speeds)
            )
            tables.append(self._coefficients(body, groups, ratio, nodes))
            # Of the part that the wind cools.
            own = self._notes(groups, wakes, where, ratio)
            notes += [(body.body, note) for note in own]
            covers.append((body.area, where))
        law = FilmExchange(
            coefficients=self._joined(tables, surface),
            temperature=for_jit(self.temperature, surface.dtype),
        )
        return surface.bind(law, covers, notes=tuple(notes))

    def _joined(self, tables: list[Any], surface: Surface) -> Any:
        """Coefficients of all fragments, with 0 on bodies without any."""
        lead = next(table.shape[:-1] for table in tables if table is not None)
        every = concatenated(
            [
                np.zeros((*lead, count), surface.dtype) if table is None else table
                for table, count in zip(tables, surface.counts, strict=True)
            ]
        )
        speed = self.strength
        if not callable(speed):
            return every
        highest = for_jit(_table_limit(speed), surface.dtype)
        return speed_table(every, highest, for_jit(speed, surface.dtype))

    def _notes(
        self,
        groups: FlowGroups,
        wakes: Wakes | WakeGeometry,
        where: Bool[np.ndarray, " s"],
        ratio: Callable[[Values], Values],
    ) -> tuple[str, ...]:
        """Validity notes for the receipt, as far as the Reynolds numbers are known."""
        air = _initial_value(self.temperature, float)
        speed = _known_maximum(self.strength)
        if speed is None or is_traced(air) or not where.any():
            return ()
        share = ratio(np.array([speed]))
        if is_traced(share):
            return ()
        with jax.ensure_compile_time_eval():
            nu = float(kinematic_viscosity(jnp.asarray(air)))
        local = np.asarray(share).reshape(-1) * speed * groups.diameter / nu
        reynolds = local[np.unique(groups.member[where])]
        ends, average = (reynolds.min(), reynolds.max()), named_average(self.average)
        notes = [note for re in ends for note in validity_notes(float(re), average)]
        if isinstance(wakes, WakeGeometry):
            notes += fitted_notes(_felt(wakes, where) * speed / nu)
        else:
            upstream = wakes.diameter[where & (wakes.diameter > 0)] * speed / nu
            notes += wake_notes(self.wake, upstream)
        return tuple(dict.fromkeys(notes))

    def _speed_ratio(
        self,
        surface: BodySurface,
        groups: FlowGroups,
        wakes: Wakes | WakeGeometry,
        speeds: Values,
    ) -> Float[Values, "*v g"]:
        """Local speed over wind speed of each group [-], at each of some speeds."""
        if isinstance(wakes, WakeGeometry):
            if not len(wakes.diameter):
                return np.ones(len(groups.diameter))
            faces = -(surface.normal @ unit_vector(self.velocity))
            front = np.maximum(faces, 0) * surface.grid.fragment_area
            air = _initial_value(self.temperature, speeds.dtype)
            return arriving_ratio(
                self.wake,
                geometry=wakes,
                member=groups.member,
                front=front,
                speeds=speeds,
                air=air,
            )
        if self.wake is None:
            return np.ones(len(groups.diameter))
        return wake_speed_ratio(self.wake, groups.behind)

    def _wakes(self, surface: BodySurface) -> Wakes | WakeGeometry:
        count = len(surface.position)
        if self.wake is None:
            return Wakes(np.full(count, np.inf), np.zeros(count))
        of, wind = (surface.scene_triangles, surface.position), self.velocity
        fitted = isinstance(self.wake, FittedWake)
        search = wake_geometry if fitted else upstream_wakes
        return found(
            of,
            by=(search.__name__, wind, surface.pitch),
            find=lambda: search(*of, unit_vector(wind), surface.pitch),
            search=f"objects upstream of body {surface.body}",
        )

    def _groups(self, surface: BodySurface, wakes: Wakes | WakeGeometry) -> FlowGroups:
        grid, number = surface.grid, surface.body
        own = tuple(c for c in self.cylinders if c.body == number)
        # Without a wake nothing is behind anything; a fitted one goes by cylinders.
        whole = self.wake is None or isinstance(wakes, WakeGeometry)
        behind = np.full(len(surface.position), np.inf) if whole else wakes.behind
        of = (grid,) if whole else (grid, wakes.behind)
        return found(
            of,
            ("flow_groups", own),
            lambda: group_fragments(parts_of(grid, own, number), behind),
        )

    def _coefficients(
        self,
        surface: BodySurface,
        groups: FlowGroups,
        ratio: Callable[[Values], Values],
        nodes: int,
    ) -> Any:
        """Film polynomial of h for each fragment, at each node of a changing speed."""
        dtype = surface.dtype
        wind = surface.pose.rotate_back(unit_vector(self.velocity))
        of = surface.own_normal, groups.axis
        harmonics = found(
            of,
            ("harmonics", tuple(wind.tolist()), jnp.dtype(dtype).name),
            lambda: surface_harmonics(*of, wind).astype(dtype),
        )
        air = _initial_value(self.temperature, dtype)
        average, speed = named_average(self.average).nusselt, self.strength
        every = lambda speeds: film_coefficients(
            speeds,
            air=air,
            speed_ratio=ratio(speeds),
            groups=groups,
            average=average,
            harmonics=harmonics,
            dtype=dtype,
        )
        if not callable(speed):
            xp = jnp if is_traced(speed) else np
            return every(xp.asarray(speed, dtype)[None])[0]
        return every(speed_nodes(_table_limit(speed), nodes, dtype))


def _felt(
    wakes: WakeGeometry, where: Bool[np.ndarray, " s"]
) -> Float[np.ndarray, " o"]:
    """Diameters of the objects in whose wakes the points are [m]."""
    # The widest wakes are some diameters wide.
    felt = (wakes.behind > 0) & (wakes.beside < 2 + 0.2 * np.maximum(wakes.behind, 0))
    return wakes.diameter[(felt & where[None]).any(1)]


def _initial_value(value: Any, dtype: Any) -> Float[Values, ""]:
    """Value of a number or a function of time at 0 s."""
    with jax.ensure_compile_time_eval():
        initial = value_at(value, jnp.zeros((), dtype))
        return initial if is_traced(initial) else np.asarray(initial)


def _known_maximum(value: Any) -> float | None:
    """Largest value at any time; None for functions of time and traced values."""
    stated = value.value if isinstance(value, Until) else value
    stated = stated.values if isinstance(stated, Table) else stated
    if callable(stated) or is_traced(stated):
        return None
    return float(np.max(np.asarray(stated, float)))


def _table_limit(speed: Any) -> Float[Array, ""] | float:
    """Largest speed that a table of speeds has to cover [m/s]."""
    if is_unknown_function(speed):
        return _MAX_UNKNOWN_SPEED
    known = _known_maximum(speed)
    if known is None:
        return jnp.maximum(largest(speed, 0.0), _MIN_TABLE_LIMIT)
    return known
