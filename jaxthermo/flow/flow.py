"""One step of a flow, and runs of many: compiled loops over two sets of arrays.

A step fills the frame and the cells of the body, then draws every population from the
cell that it comes from and lets all collide, in one loop for each array. It reads one
set of arrays and writes into the other: nothing is copied.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jax import lax
from jaxtyping import Array, Float, Int

from ..arrays import Scalar
from .body import Links, filled, force_on, heat_of, reflected
from .boundary import (
    Outlet,
    filled_ends,
    filled_walls,
    first_outlet,
    inlet,
    outlet_step,
    tracer_inlet,
    tracer_outlet,
)
from .channel import Channel
from .collision_loops import collided_into
from .lattice import (
    VELOCITIES,
    Moments,
    Populations,
    collided,
    collided_tracer,
    equilibria,
    flow_rates,
    moments,
    tracer_rates,
)


_BAND = 16384
"""Number of cells of a band of rows that are moved together."""


class FlowProgram(Module):
    """A channel ready to run: numbers that may be traced, and its links."""

    speed: Float[Array, ""]
    viscosity: Float[Array, ""]
    force: tuple[Float[Array, ""], Float[Array, ""]] | None
    diffusivity: Float[Array, ""] | None
    links: Links | None
    profile: Float[Array, " n"]
    shape: tuple[int, int] = eqx.field(static=True)
    walls: str = eqx.field(static=True)
    ends: str = eqx.field(static=True)
    magic: float = eqx.field(static=True)
    kernels: str | None = eqx.field(static=True, default=None)
    """Compiler of the collisions, see `simulate_flow`."""


class FlowState(NamedTuple):
    """Populations after a collision, of the flow and of the temperature if any."""

    flow: Populations
    outlet: Outlet | None
    heat: Populations | None


class Fields(NamedTuple):
    """Pressure, velocity and temperature in every cell, in lattice units."""

    pressure: Float[Array, "y x"]
    x: Float[Array, "y x"]
    y: Float[Array, "y x"]
    speed: Float[Array, "y x"]
    """Magnitude of the velocity; its mean is not that of the mean velocity."""
    temperature: Float[Array, "y x"] | None


def flow_program(
    channel: Channel, dtype: Any, kernels: str | None = None
) -> FlowProgram:
    """The channel as a program in one precision."""

    def cast(numbers):
        return jax.tree.map(lambda number: jnp.asarray(number, dtype), numbers)

    return FlowProgram(
        speed=cast(channel.speed),
        viscosity=cast(channel.viscosity),
        force=cast(channel.force),
        diffusivity=cast(channel.diffusivity),
        links=channel.links,
        profile=cast(channel.profile),
        shape=channel.shape,
        walls=channel.walls,
        ends=channel.ends,
        magic=channel.magic,
        kernels=kernels,
    )


@eqx.filter_jit
def initial_state(
    program: FlowProgram,
    velocity: tuple[Any, Any] | None = None,
    density: Any = 0.0,
) -> FlowState:
    """State in equilibrium: the flow of the inlet everywhere, or another one.

    Args:
        program: the channel.
        velocity: components along x and y in every cell [cells per step].
        density: density minus 1 in every cell, three times the pressure.
    """
    dtype = program.viscosity.dtype
    shape = program.shape
    along = program.profile[:, None]
    if velocity is None and program.ends == "open":
        velocity = (program.speed * along, 0.0)
    x, y = (0.0, 0.0) if velocity is None else velocity

    def in_all_cells(value):
        return jnp.broadcast_to(jnp.asarray(value, dtype), shape)

    moments = Moments(in_all_cells(density), x=in_all_cells(x), y=in_all_cells(y))
    flow = tuple(jnp.pad(population, 1) for population in equilibria(moments))
    heat = None
    if program.diffusivity is not None:
        heat = tuple(jnp.zeros_like(a) for a in flow)
    outlet = None
    if program.ends == "open":
        outlet = first_outlet(program.speed, program.profile)
    return FlowState(flow, outlet, heat)


def _drawn(f: Populations, first: Int[Array, ""], rows: int) -> Populations:
    """Populations that arrive in the cells of `rows` rows from the first one on."""
    length = f[0].shape[1] - 2
    return tuple(
        lax.dynamic_slice(a, (first + 1 - y, np.int32(1 - x)), (rows, length))
        for a, (x, y) in zip(f, VELOCITIES, strict=True)
    )


def _into(
    target: Populations, values: Populations, first: Int[Array, ""]
) -> Populations:
    return tuple(
        lax.dynamic_update_slice(a, new, (first + 1, np.int32(1)))
        for a, new in zip(target, values, strict=True)
    )


def _step(program: FlowProgram, state: FlowState, target: FlowState) -> tuple:
    """State after a step, in the arrays of `target`, and the state that it has read."""
    f = state.flow
    outlet = state.outlet
    entering = None
    if outlet is not None:
        outlet, entering = outlet_step(
            f, at=outlet, walls=program.walls, viscosity=program.viscosity
        )
        entering |= inlet(f, program.speed, program.profile)
    f, outlet = filled_ends(f, entering, outlet)
    f = filled_walls(f, program.walls, program.ends)
    if program.links is not None:
        f = filled(f, program.links, reflected(f, program.links))
    g = None if state.heat is None else _filled_heat(program, state.heat)
    moved = _moved if program.kernels is None else _moved_in_loops
    flow, heat = moved(program, (f, g), (target.flow, target.heat))
    return FlowState(flow, outlet, heat), FlowState(f, outlet, g)


_FlowAndHeat = tuple[Populations, Populations | None]


def _moved(
    program: FlowProgram, read: _FlowAndHeat, target: _FlowAndHeat
) -> _FlowAndHeat:
    """Populations drawn from where they come from, and collided, into `target`."""
    height, length = program.shape
    # A band of rows at a time: the loops over each array then find it in a near cache.
    rows = min(height, max(1, _BAND // length))
    rates = flow_rates(program.viscosity, program.magic)

    def band(target, first):
        arrived = _drawn(read[0], first, rows)
        flow = _into(target[0], collided(arrived, rates, program.force), first)
        if read[1] is None or target[1] is None or program.diffusivity is None:
            return (flow, None), None
        thermal = tracer_rates(program.diffusivity, program.magic)
        came = _drawn(read[1], first, rows)
        warmed = collided_tracer(came, moments(arrived), thermal)
        return (flow, _into(target[1], warmed, first)), None

    # The last band repeats rows of the one before.
    starts = np.minimum(np.arange(0, height, rows), height - rows).astype(np.int32)
    if len(starts) == 1:
        return band(target, jnp.zeros((), jnp.int32))[0]
    return lax.scan(band, target, starts)[0]


@jax.custom_jvp
def _moved_in_loops(
    program: FlowProgram, read: _FlowAndHeat, target: _FlowAndHeat
) -> _FlowAndHeat:
    """As `_moved`, in loops that numba compiles."""
    rates = flow_rates(program.viscosity, program.magic)
    if read[1] is None or target[1] is None or program.diffusivity is None:
        (flow,) = collided_into(
            [target[0]], read=[read[0]], rates=[rates], force=program.force
        )
        return flow, None
    thermal = tracer_rates(program.diffusivity, program.magic)
    flow, heat = collided_into(
        [target[0], target[1]],
        read=[read[0], read[1]],
        rates=[rates, thermal],
        force=program.force,
    )
    return flow, heat


@_moved_in_loops.defjvp
def _moved_along(primals, tangents):
    return jax.jvp(_moved, primals, tangents)


def _filled_heat(program: FlowProgram, g: Populations) -> Populations:
    # Walls are insulated: they mirror.
    walls = "slip" if program.walls == "no_slip" else program.walls
    entering = None
    if program.ends == "open":
        entering = tracer_inlet(g) | tracer_outlet(g)
    g = filled_walls(filled_ends(g, entering)[0], walls, program.ends)
    if program.links is None:
        return g
    return filled(g, program.links, reflected(g, program.links, 1.0))


@eqx.filter_jit
def fields(program: FlowProgram, state: FlowState) -> Fields:
    """Fields of a state; values within the body have no meaning."""
    m = moments(_without_frame(state.flow))
    x = m.x
    y = m.y
    if program.force is not None:
        # A collision adds all of the force, half of it after the moment of the fields.
        x = x - program.force[0] / 2
        y = y - program.force[1] / 2
    heat = None
    if state.heat is not None:
        heat = moments(_without_frame(state.heat)).density
    return Fields(
        pressure=m.density / 3,
        x=x,
        y=y,
        speed=jnp.sqrt(x * x + y * y),
        temperature=heat,
    )


def _without_frame(f: Populations) -> Populations:
    return tuple(population[1:-1, 1:-1] for population in f)


class _Sample(NamedTuple):
    """Numbers that are read from a flow at one time."""

    force: Float[Array, "*t 2"]
    """Drag and lift on the body; 0 without one."""
    heat: Float[Array, "*t"]
    """Heat that leaves the body per step, for a temperature of 1 above the inlet's."""


class _Totals(NamedTuple):
    """Sums over samples, for means."""

    count: Float[Array, ""]
    fields: Fields
    heat: Float[Array, "8 y x"] | None
    """Heat over each link of the body."""


def _sampled(program: FlowProgram, state: FlowState) -> _Sample:
    zero = jnp.zeros((), program.viscosity.dtype)
    links = program.links
    if links is None:
        return _Sample(jnp.stack([zero, zero]), zero)
    force = force_on(state.flow, links, reflected(state.flow, links))
    if state.heat is None:
        return _Sample(force, zero)
    return _Sample(force, heat_of(state.heat, links).sum())


def totals(program: FlowProgram, state: FlowState) -> _Totals:
    """The sums over this state alone."""
    heat = None
    if state.heat is not None and program.links is not None:
        heat = heat_of(state.heat, program.links)
    return _Totals(jnp.ones((), state.flow[0].dtype), fields(program, state), heat)


class _Advanced(NamedTuple):
    """A flow after several samples."""

    state: FlowState
    total: _Totals | None
    samples: _Sample


def _advance(
    program: FlowProgram,
    state: FlowState,
    total: _Totals | None,
    weight: Scalar,
    samples: int,
    stride: int,
) -> _Advanced:
    def two_steps(pair, _):
        state, spare = pair
        state, spare = _step(program, state, spare)
        return _step(program, state, spare), None

    # Differentiation stores the state at every sample and repeats the steps between.
    @jax.checkpoint
    def steps(state, spare):
        return lax.scan(two_steps, (state, spare), None, length=stride // 2)[0]

    def sample(carry, _):
        state, spare, total = carry
        state, spare = steps(state, spare)
        if total is not None:
            total = jax.tree.map(
                lambda a, b: a + weight * b, total, totals(program, state)
            )
        return (state, spare, total), _sampled(program, state)

    spare = jax.tree.map(jnp.zeros_like, state)
    (state, _, total), read = lax.scan(
        sample, (state, spare, total), None, length=samples
    )
    return _Advanced(state=state, total=total, samples=read)


advance = jax.jit(_advance, static_argnames=("samples", "stride"))
"""State, sums and samples after `samples` times `stride` steps, which is even.

`weight` times the fields of every sample is added to `total`, if it is not None.
"""

# A long loop is worth optimizing even where XLA is told to compile fast.
advance_in_place = jax.jit(
    _advance,
    static_argnames=("samples", "stride"),
    donate_argnames=("state", "total"),
    compiler_options={"xla_backend_optimization_level": 3},
)
"""`advance` in place of the arrays of its state and sums."""
