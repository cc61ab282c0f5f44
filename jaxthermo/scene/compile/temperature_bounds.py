"""Bounds of all temperatures of a run, by the maximum principle.

Nothing gets hotter than the start or what terms heat towards, except by imposed heat:
fluxes Q_f into surface fragments f, and heat sources Q_i in nodes i. The hottest node
receives no heat from other nodes, bodies or surfaces, so that no temperature exceeds
either of

    T_0 + integral of max_i (Q_i + sum_f Q_f) / C_i dt,
    max_f T_f + max_i R_i,    q_f(T_f) = Q_f + G_f R_i,    R_i = Q_i / sum_f G_f,

with T_0 [K] the largest of start and surroundings, the capacities C [J/K] and the half
cells G [W/K]. The second bound holds at all times, where each heated node has surface
that loses heat: T_f is the temperature above which fragment f loses at least its own
flux q_f and its part of the heat of its node, see `equilibrium` of a law. Surfaces are
hotter than their nodes by Q_f / G_f at most. Lower bounds follow likewise from the
first, with the heat that is extracted.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import added, is_traced, namespace, taken, typed_array
from ...constants import STEFAN_BOLTZMANN
from ...network.network import inverse
from ...physics.time_varying import Dose, dose
from ..scene import Scene
from .bodies import PreparedBody, TemperatureBounds
from .program import BodyProgram, Program


_HOTTEST = 1e5
"""Temperature that stands for no bound [K]: no matter remains matter."""

# Radiation from other surfaces depends on the bound itself, which starts at a multiple
# of the bound without it.
_GUESS = 2
_CORRECTIONS = 3


def temperature_bounds(
    scene: Scene,
    prepared: tuple[PreparedBody, ...],
    programs: Sequence[Program],
    end: float,
    duration: float,
) -> TemperatureBounds:
    """Bounds of all temperatures of a scene.

    Args:
        scene: bodies and terms.
        prepared: the bodies with their initial states.
        programs: of the scene, one a snapshot.
        end: time up to which its values are known [s].
        duration: time for which they act [s]; infinite for a steady state.
    """
    start = []
    for body in prepared:
        if not callable(body.body.temperature):
            start.append(body.reference)
            continue
        theta = body.network.temperature(jnp.asarray(body.state))
        # On the host nothing is compiled for each shape of a body.
        theta = theta if is_traced(theta) else np.asarray(theta)
        start += [body.reference + theta.min(), body.reference + theta.max()]
    forcings = [term.forcing(end) for term in scene.terms]
    # Single operations on few numbers are fastest on the host.
    xp = namespace((start, forcings))
    highest = [*start, *(forcing.highest for forcing in forcings)]
    lowest = [*start, *(forcing.lowest for forcing in forcings)]
    dtype = jnp.result_type(float)
    hottest = typed_array(
        xp.stack([xp.asarray(v, float) for v in highest]).max(), dtype
    )
    coldest = typed_array(xp.stack([xp.asarray(v, float) for v in lowest]).min(), dtype)
    if any(_imposes_heat(program) for program in programs):
        around = jnp.asarray(hottest, scene.dtype)
        hottest = _highest(programs, around=around, end=end, duration=duration)
        around = jnp.asarray(coldest, scene.dtype)
        coldest = _lowest(programs, around=around, end=end, duration=duration)
    return TemperatureBounds(
        highest=typed_array(hottest, dtype), lowest=typed_array(coldest, dtype)
    )


def _imposes_heat(program: Program) -> bool:
    has_sources = any(body.sources for body in program.bodies)
    natural = program.fragment_terms.natural
    return has_sources or any(t.law.imposed_flux is not None for _, t in natural)


def _highest(programs, around, end: float, duration: float) -> Float[Array, ""]:
    heat = [_imposed_heat(program, end, 1.0) for program in programs]
    nodes = around + _rise(heat, end=end, duration=duration)
    bounds = partial(_surface_bounds, around=around, nodes=nodes, end=end)
    reached = [bounds(program, received=jnp.zeros_like(around)) for program in programs]
    by_rise = jnp.stack([one.by_rise for one in reached]).max()
    beneath = jnp.stack([one.beneath for one in reached]).max()
    by_loss = _by_loss(reached, beneath)
    if any(program.fine_enclosure is not None for program in programs):
        below = _GUESS * by_loss
        by_loss = jnp.full_like(by_loss, jnp.inf)
        for _ in range(_CORRECTIONS):
            # Nodes send more than their colder surfaces emit.
            received = 4 * STEFAN_BOLTZMANN * below**3 * beneath
            reached = [bounds(program, received=received) for program in programs]
            corrected = _by_loss(reached, beneath)
            # Only a bound that is not above what it was computed from is one.
            holds = corrected <= below
            by_loss = jnp.where(holds, corrected, by_loss)
            below = jnp.where(holds, corrected, below)
    highest = jnp.minimum(by_rise, by_loss)
    return jnp.where(jnp.isfinite(highest), highest, jnp.maximum(_HOTTEST, around))


def _lowest(programs, around, end: float, duration: float) -> Float[Array, ""]:
    heat = [_imposed_heat(program, end, -1.0) for program in programs]
    fall = _rise(heat, end=end, duration=duration)
    fall = fall + jnp.stack([one.excess for one in heat]).max()
    return jnp.maximum(around - fall, 0)


class _ImposedHeat(NamedTuple):
    """Effect of the imposed heat of a program on its nodes and surfaces."""

    rate: Float[Array, ""]
    """Largest rise of a node, if every load has its largest value [K/s]."""
    rises: Float[Array, " k"]
    """Largest rise of a node by each load in the whole run [K]."""
    excess: Float[Array, ""]
    """Largest excess of a surface over its node [K]; infinite on an insulator."""


def _rise(heat: list[_ImposedHeat], end: float, duration: float) -> Float[Array, ""]:
    """Largest rise of any node that imposed heat causes [K]."""
    rate = jnp.stack([one.rate for one in heat]).max()
    rises = jnp.stack([one.rises for one in heat]).max(axis=0).sum()
    if duration > end:
        # The values at the end stay, and none of them exceeds the largest.
        return jnp.where(rate > 0, rate * duration, 0)
    return jnp.minimum(rate * duration, rises)


def _fragments_of(program: Program) -> Iterator[tuple[BodyProgram, slice]]:
    """Every body with the slice of its fragments among those of all bodies."""
    start = 0
    for body in program.bodies:
        fragments = slice(start, start + body.node.shape[0])
        start = fragments.stop
        yield body, fragments


def _dose(value: Any, end: float, dtype: Any, sign: float = 1.0) -> Dose:
    largest, integral = dose(value, end, sign)
    return Dose(jnp.asarray(largest, dtype), jnp.asarray(integral, dtype))


@eqx.filter_jit
def _imposed_heat(program: Program, end: float, sign: float) -> _ImposedHeat:
    """Heat of the loads of a program that heats, or that cools for a sign of -1."""
    terms = program.fragment_terms
    half_cell = jnp.asarray(terms.half_cell)
    total = jnp.zeros_like(half_cell)
    energies = {}
    for number, (_, term) in enumerate(terms.natural):
        if term.law.imposed_flux is not None:
            area = jnp.asarray(term.effective_area)
            flux = _dose(term.law.imposed_flux, end, total.dtype, sign)
            energies[number] = area * flux.integral
            total = total + area * flux.largest
    rates = []
    rises: dict[int | str, list[Float[Array, ""]]] = {}
    excess = []
    for body, fragments in _fragments_of(program):
        network = body.network
        smallest = network.min_relative_capacity()
        capacity = network.capacity_at(body.address) * smallest
        for number, energy in energies.items():
            rise = (_sums(body, energy[fragments]) / capacity).max()
            rises.setdefault(number, []).append(rise)
        rate = _sums(body, total[fragments]) / capacity
        if body.sources:
            by_node = added(jnp.zeros_like(network.diagonal()), body.address, rate)
            for source in body.sources:
                density = _dose(source.heat_rate_density, end, total.dtype, sign)
                per_density = source.rise / smallest
                # A term has the same values on all bodies.
                name, _ = program.entries[source.entry]
                rise = (per_density * density.integral).max()
                rises.setdefault(name, []).append(rise)
                by_node = added(by_node, source.address, per_density * density.largest)
            rate = by_node
        rates.append(rate.max())
        conductance = half_cell[fragments] * network.min_relative_conductivity()
        excess.append(_over(total[fragments], conductance).max())
    by_load = [jnp.stack(rise).max() for rise in rises.values()]
    return _ImposedHeat(
        rate=jnp.stack(rates).max(),
        rises=jnp.stack([jnp.zeros_like(rates[0]), *by_load]),
        excess=jnp.stack(excess).max(),
    )


def _sums(body: BodyProgram, values: Float[Array, " s"]) -> Float[Array, " m"]:
    """Sums of the values of a body's fragments over each node with surface."""
    count = body.address[0].shape[0]
    return jax.ops.segment_sum(values, body.node, count)


def _over(heat: Float[Array, " s"], conductance: Float[Array, " s"]):
    """Heat over conductance [K]; infinite where heat has no way."""
    ratio = heat * inverse(conductance)
    return jnp.where((heat > 0) & (conductance <= 0), jnp.inf, ratio)


class _SurfaceBounds(NamedTuple):
    """Bounds of surface temperatures of a program, from two bounds of the nodes."""

    by_rise: Float[Array, ""]
    """Highest surface temperature above nodes of a highest temperature [K]."""
    level: Float[Array, ""]
    """Surface temperature at which all imposed heat is lost [K]; infinite for none."""
    beneath: Float[Array, ""]
    """Largest excess of a heated node over that level [K]; infinite for none."""
    excess: Float[Array, ""]
    """Largest excess over its node of a surface that loses no heat [K]."""


def _by_loss(bounds: list[_SurfaceBounds], beneath) -> Float[Array, ""]:
    level = jnp.stack([one.level for one in bounds]).max()
    return level + beneath + jnp.stack([one.excess for one in bounds]).max()


@eqx.filter_jit
def _surface_bounds(
    program: Program,
    around: Float[Array, ""],
    nodes: Float[Array, ""],
    received: Float[Array, ""],
    end: float,
) -> _SurfaceBounds:
    """Highest temperatures of surfaces.

    Args:
        program: of one snapshot.
        around: largest temperature of start and surroundings [K].
        nodes: bound of the nodes' temperatures [K].
        received: flux from other surfaces that exceeds that of surfaces at the level
            of all losses [W/m^2].
        end: time up to which values are known [s].
    """
    half_cell = jnp.asarray(program.fragment_terms.half_cell)
    flux = jnp.zeros_like(half_cell)
    for _, term in program.fragment_terms.natural:
        if term.law.imposed_flux is not None:
            strength = _dose(term.law.imposed_flux, end, flux.dtype).largest
            flux = flux + jnp.asarray(term.effective_area) * strength
    level = partial(_levels, program, around, end=end)
    loses = jnp.isfinite(level(heat=jnp.asarray(half_cell > 0, half_cell.dtype)))
    beneath = []
    conductances = []
    for body, fragments in _fragments_of(program):
        conductance = half_cell[fragments] * body.network.min_relative_conductivity()
        conductances.append(conductance)
        beneath.append(
            _excess_of_nodes(
                body,
                flux=jnp.where(loses[fragments], 0, flux[fragments]),
                conductance=jnp.where(loses[fragments], conductance, 0),
                end=end,
            )
        )
    conductance = jnp.concatenate(conductances)
    excess = _over(flux, conductance)
    by_rise = jnp.minimum(nodes + excess, jnp.maximum(nodes, level(heat=flux)))
    over_surface = jnp.concatenate(beneath)
    from_node = jnp.where(over_surface > 0, conductance * over_surface, 0)
    lost = jnp.where(loses, flux + from_node, 0)
    return _SurfaceBounds(
        by_rise=by_rise.max(),
        level=level(heat=lost, received=received).max(),
        beneath=over_surface.max(),
        excess=jnp.where(loses, 0, excess).max(),
    )


def _levels(
    program: Program,
    around: Float[Array, ""],
    heat: Float[Array, " s"],
    end: float,
    received: Float[Array, ""] | float = 0.0,
) -> Float[Array, " s"]:
    """Temperature of every fragment above which it loses at least `heat` [K]."""
    lowest = jnp.full_like(heat, jnp.inf)
    for _, term in program.fragment_terms.natural:
        area = jnp.asarray(term.effective_area)
        total = heat
        if term.law.exchanges and program.fine_enclosure is not None:
            escaping = program.fine_enclosure.escaping()
            total = heat + area * (1 - escaping) * received
            area = area * escaping
        level = term.law.equilibrium(around, total * inverse(area), end)
        lowest = jnp.where(area > 0, jnp.minimum(lowest, level), lowest)
    return jnp.where(heat > 0, lowest, around)


def _excess_of_nodes(
    body: BodyProgram,
    flux: Float[Array, " s"],
    conductance: Float[Array, " s"],
    end: float,
) -> Float[Array, " s"]:
    """Excess over its surface at which the node of each fragment sends all its heat.

    Infinite on all of a body that has heated nodes without surface that loses heat.

    Args:
        body: the body.
        flux: heat rate into the node through fragments that lose none [W].
        conductance: of the half cells of fragments that lose heat [W/K].
        end: time up to which values are known [s].
    """
    network = body.network
    heat = _sums(body, flux)
    inside = jnp.zeros((), heat.dtype)
    if body.sources:
        by_node = jnp.zeros_like(network.diagonal())
        for source in body.sources:
            strength = _dose(source.heat_rate_density, end, heat.dtype).largest
            volume = source.rise * network.capacity_at(source.address)
            by_node = added(by_node, source.address, strength * volume)
        heat = heat + taken(by_node, body.address)
        inside = by_node.at[body.address].set(0).max()
    excess = _over(heat, _sums(body, conductance))
    return taken(jnp.where(inside > 0, jnp.inf, excess), body.node)
