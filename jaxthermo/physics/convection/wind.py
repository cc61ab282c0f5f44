"""Forced convection by wind: the body as cylinders in cross-flow (thesis 5.4, eq. 5-8).

    q = h (T_inf - T_s),    h = Nu(theta, Re, Pr) k / D,    Re = V D / nu,

with theta from the normal of every fragment (`cross_flow`), D of the cylinder that it
belongs to (`voxels.cylinder_parts`), nu, k, Pr of air at the film temperature of every
place (`film`). One binding, whatever the number of cylinders: what differs between them
is in the coefficients of each place.

The shape of the flow goes by the temperature of the air, that at 0 s where it changes.
In a wake the speed at a fragment is V f(x / D_upstream) (`wake`, `downstream`); places
at nearly the same x / D share one Reynolds number.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...arrays import Scalar, is_traced
from ...errors import InputError
from ...raster.directions import unit_vector
from ...voxels.cylinder_parts import parts_of
from ...voxels.cylinders import Cylinder, given_cylinders
from ..term import (
    AbstractSurfaceTerm,
    Binding,
    Forcing,
    Omitted,
    Surface,
    Values,
    binding,
)
from ..time_varying import check_value, for_jit, is_zero, largest
from .air import kinematic_viscosity
from .approach_flow import (
    Groups,
    Stream,
    at_places,
    at_start,
    grouped,
    highest_speed,
    known_largest,
)
from .cross_flow import doubts, surface_harmonics
from .film import FilmExchange, speed_nodes, speed_table
from .nusselt import named_average
from .wake import diameters_behind, wake_share


SPEEDS = 25
"""Nodes of the table for a speed that changes with time."""


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
    """Wind of one direction on every body, each taken as cylinders in cross-flow.

    Raises:
        InputError: for a speed without a direction, a negative speed, or an average
            that is not known.
    """

    velocity: tuple[float, float, float] = eqx.field(static=True, converter=_velocity)
    """The way it blows and, unless `speed` is given, how fast [m/s]."""
    temperature: Any
    """T_inf of the air [K], a number or a function of time."""
    speed: Any = None
    """V [m/s] instead of the length of `velocity`; a number or a function of time."""
    average: str = eqx.field(static=True, default="churchill_bernstein")
    """Which correlation the mean Nusselt number follows: one of `AVERAGES`."""
    cylinders: tuple[Cylinder, ...] = eqx.field(
        static=True, default=None, converter=given_cylinders
    )
    """For the bodies that they name; those of other bodies are found."""
    wake: Any = None
    """From x / D behind another object to u / U, such as `WakeDeficit()`."""

    def __check_init__(self):
        check_value(self.temperature, "Wind(temperature [K])", 0.0)
        named_average(self.average)
        if self.speed is not None:
            unit_vector(self.velocity, "Wind(velocity=)")
            check_value(self.speed, "Wind(speed [m/s])", 0.0)
        if self.wake is not None and not callable(self.wake):
            raise InputError(
                f"Wind(wake={self.wake!r}): give a function of x / D, such as "
                "WakeDeficit()"
            )

    @property
    def name(self) -> str:
        """In the ledger."""
        return "wind"

    @property
    def values(self) -> tuple[Any, ...]:
        """Its speed and its temperature."""
        return (self.strength, self.temperature)

    @property
    def strength(self) -> Any:
        """V [m/s]: a number or a function of time."""
        return (
            float(np.linalg.norm(self.velocity)) if self.speed is None else self.speed
        )

    def forcing(self, end: float | int) -> Forcing:
        """Towards its temperature [K]."""
        return Forcing(temperature=largest(self.temperature, end))

    def bind(
        self, surface: Surface, reference: Scalar
    ) -> tuple[Binding, ...] | Omitted:
        """Every free fragment, with the coefficients of its own place."""
        if is_zero(self.strength):
            return Omitted("the air stands still")
        acts = surface.acted_on(None)
        if isinstance(acts, Omitted):
            return acts
        groups = self._groups(surface)
        law = FilmExchange(
            coefficients=self._coefficients(surface, groups),
            temperature=for_jit(self.temperature, surface.dtype),
            reference=jnp.asarray(reference, surface.dtype),
        )
        found = binding(surface.area, law, acts)
        return (found._replace(notes=self._notes(groups)),)

    def _notes(self, groups: Groups) -> tuple[str, ...]:
        """What a receipt should say of the numbers on a body, as far as known."""
        air, share = at_start(self.temperature, float), self._share(groups)
        speed = known_largest(self.strength)
        if speed is None or is_traced((air, share)):
            return ()
        with jax.ensure_compile_time_eval():
            nu = float(kinematic_viscosity(jnp.asarray(air)))
        reynolds = np.asarray(share) * speed * groups.diameter / nu
        ends, average = (reynolds.min(), reynolds.max()), named_average(self.average)
        return tuple(
            dict.fromkeys(d for re in ends for d in doubts(float(re), average))
        )

    def _share(self, groups: Groups) -> Float[Values, " g"]:
        """Of the wind, what each group feels of it."""
        if self.wake is None:
            return np.ones(len(groups.diameter))
        return wake_share(self.wake, groups.behind)

    def _groups(self, surface: Surface) -> Groups:
        parts = parts_of(surface.grid, self.cylinders, surface.body)
        if self.wake is None:
            behind = np.full(len(parts.fragment), np.inf)
        else:
            behind = diameters_behind(
                surface.scene_triangles,
                surface.position,
                unit_vector(self.velocity),
                surface.pitch,
            )
        return grouped(parts, behind)

    def _coefficients(self, surface: Surface, groups: Groups) -> Any:
        """Of every fragment: constant, or by speed where that changes with time."""
        dtype = surface.dtype
        wind = surface.pose.unturn(unit_vector(self.velocity))
        harmonics = surface_harmonics(surface.own_normal, groups.axis, wind)
        stream = Stream(
            at_start(self.temperature, dtype), self._share(groups), groups.diameter
        )
        average, speed = named_average(self.average).nusselt, self.strength
        every = lambda speeds: at_places(
            speeds, stream, average, groups.member, harmonics, dtype
        )
        if not callable(speed):
            own = jnp if is_traced(speed) else np
            return every(own.asarray(speed, dtype)[None])[0]
        highest = highest_speed(speed)
        nodes = every(speed_nodes(highest, SPEEDS, dtype))
        return speed_table(nodes, for_jit(highest, dtype), for_jit(speed, dtype))
