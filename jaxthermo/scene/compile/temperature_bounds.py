"""Bounds of all temperatures of a run, by the maximum principle.

Nothing gets hotter than the start or what terms heat towards, except by imposed heat:
fluxes Q_f into surface fragments f, and heat sources Q_i in nodes i. The hottest node
receives no heat from other nodes, bodies or surfaces, so that no temperature exceeds
any of

    T_0 + integral of max_i (Q_i + sum_f Q_f) / C_i dt,
    max_f T_f + max_i R_i,    q_f(T_f) = Q_f + G_f R_i,    R_i = Q_i / sum_f G_f,
    max_f T_f + integral of max_i Q_i / C_i dt,    q_f(T_f) = Q_f,

with T_0 [K] the largest of start and surroundings, the capacities C [J/K] and the half
cells G [W/K]. The second bound holds at all times, where each heated node has surface
that loses heat: T_f is the temperature above which fragment f loses at least its own
flux q_f and its part of the heat of its node, see `equilibrium` of a law. The third is
for bodies with heat sources deep inside, whose surfaces lose what reaches them: at its
temperature, the same everywhere, none receives heat. Surfaces are
hotter than their nodes by Q_f / G_f at most. Lower bounds follow likewise from the
first, with the heat that is extracted.

Each group of bodies that exchange heat, by contact, radiation or air, has its own
bounds, of which the highest is that of the scene.
"""

from collections.abc import Iterable, Sequence
from functools import partial, reduce
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import Scalar, added, namespace, taken, typed_array
from ...constants import STEFAN_BOLTZMANN
from ...network.network import inverse
from ...physics.time_varying import Dose, dose
from ..scene import Scene
from .bodies import PreparedGroup, TemperatureBounds, one_or_all
from .body_program import BodyProgram
from .independent_parts import exchanging_bodies
from .program import Program


_HOTTEST = 1e5
"""Temperature that stands for no bound [K]: no matter remains matter."""

# Arrays: one compiled program serves both.
_HEATS = np.asarray(1.0)
_COOLS = np.asarray(-1.0)

# Radiation from other surfaces depends on the bound itself, which starts at a multiple
# of the bound without it.
_GUESS = 2
_CORRECTIONS = 3


def temperature_bounds(
    scene: Scene,
    prepared: tuple[PreparedGroup, ...],
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
    for group in prepared:
        uniform = [
            reference
            for body, reference in zip(
                group.group.bodies, group.references, strict=True
            )
            if not callable(body.temperature)
        ]
        start += [one_or_all(uniform)] if uniform else []
        start += [ends for _, ends in group.start_ranges()]
    forcings = [term.forcing(end) for term in scene.terms]
    # Single operations on few numbers are fastest on the host.
    xp = namespace((start, forcings))
    highest = [*start, *(forcing.highest for forcing in forcings)]
    lowest = [*start, *(forcing.lowest for forcing in forcings)]
    dtype = jnp.result_type(float)
    hottest = typed_array(
        xp.concatenate([xp.asarray(v, float) for v in highest], None).max(), dtype
    )
    coldest = typed_array(
        xp.concatenate([xp.asarray(v, float) for v in lowest], None).min(), dtype
    )
    if any(_imposes_heat(program) for program in programs):
        largest = partial(_largest_of_group, group=exchanging_bodies(programs))
        around = jnp.asarray(hottest, scene.dtype)
        hottest = _highest(programs, largest, around=around, end=end, duration=duration)
        around = jnp.asarray(coldest, scene.dtype)
        coldest = _lowest(programs, largest, around=around, end=end, duration=duration)
    return TemperatureBounds(
        highest=typed_array(hottest, dtype), lowest=typed_array(coldest, dtype)
    )


def _imposes_heat(program: Program) -> bool:
    has_sources = any(body.sources for body in program.bodies)
    natural = program.fragment_terms.natural
    return has_sources or any(t.law.imposed_flux is not None for _, t in natural)


def _largest_of_group(
    values: Float[Array, " b"], group: Int[np.ndarray, " b"]
) -> Float[Array, " b"]:
    """Largest value among the bodies of the group of each body."""
    largest = jax.ops.segment_max(values, group, int(group.max()) + 1)
    return largest[group]


def _largest(of_programs: Iterable[Float[Array, "..."]]) -> Float[Array, "..."]:
    """Largest value in any snapshot."""
    # Pair by pair: a stack of many snapshots is a program of its own for each number.
    return reduce(jnp.maximum, of_programs)


def _highest(
    programs, largest, around, end: float, duration: float
) -> Float[Array, ""]:
    heat = [_imposed_heat(program, end, _HEATS) for program in programs]
    over = partial(_rise, end=end, duration=duration)
    nodes = around + largest(over([one.of_all for one in heat]))
    bounds = partial(_surface_bounds, around=around, nodes=nodes, end=end)
    reached = [bounds(program, received=jnp.zeros_like(nodes)) for program in programs]
    by_rise = largest(_largest(one.by_rise for one in reached))
    beneath = largest(_largest(one.beneath for one in reached))
    by_loss = _by_loss(reached, beneath, largest)
    level = largest(_largest(one.level_of_flux for one in reached))
    by_sources = level + largest(over([one.of_sources for one in heat]))
    if any(program.fine_enclosure is not None for program in programs):
        below = _GUESS * by_loss
        by_loss = jnp.full_like(by_loss, jnp.inf)
        for _ in range(_CORRECTIONS):
            # Nodes send more than their colder surfaces emit.
            received = 4 * STEFAN_BOLTZMANN * below**3 * beneath
            reached = [bounds(program, received=received) for program in programs]
            corrected = _by_loss(reached, beneath, largest)
            # Only a bound that is not above what it was computed from is one.
            holds = corrected <= below
            by_loss = jnp.where(holds, corrected, by_loss)
            below = jnp.where(holds, corrected, below)
    highest = jnp.minimum(jnp.minimum(by_rise, by_loss), by_sources).max()
    return jnp.where(jnp.isfinite(highest), highest, jnp.maximum(_HOTTEST, around))


def _lowest(programs, largest, around, end: float, duration: float) -> Float[Array, ""]:
    heat = [_imposed_heat(program, end, _COOLS) for program in programs]
    rises = [one.of_all for one in heat]
    fall = largest(_rise(rises, end=end, duration=duration))
    fall = fall + largest(_largest(one.excess for one in heat))
    return jnp.maximum(around - fall.max(), 0)


class _Rises(NamedTuple):
    """Rises of the nodes of each body by some loads, without losses."""

    rate: Float[Array, " b"]
    """Largest rise of a node, if every load has its largest value [K/s]."""
    rises: Float[Array, "k b"]
    """Largest rise of a node by each load in the whole run [K]."""


class _ImposedHeat(NamedTuple):
    """Effect of the imposed heat of a program on each body."""

    of_all: _Rises
    of_sources: _Rises
    """Without fluxes into surfaces."""
    excess: Float[Array, " b"]
    """Largest excess of a surface over its node [K]; infinite on an insulator."""


def _rise(heat: list[_Rises], end: float, duration: float) -> Float[Array, " b"]:
    """Largest rise of any node of each body that imposed heat causes [K]."""
    rate = _largest(one.rate for one in heat)
    rises = _largest(one.rises for one in heat).sum(axis=0)
    if duration > end:
        # The values at the end stay, and none of them exceeds the largest.
        return jnp.where(rate > 0, rate * duration, 0)
    return jnp.minimum(rate * duration, rises)


def _dose(value: Any, end: float, dtype: Any, sign: Scalar = 1.0) -> Dose:
    largest, integral = dose(value, end, sign)
    return Dose(jnp.asarray(largest, dtype), jnp.asarray(integral, dtype))


@eqx.filter_jit
def _imposed_heat(program: Program, end: float, sign: Scalar) -> _ImposedHeat:
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
    source_rates = []
    rises: dict[int | str, dict[int, Float[Array, " _"]]] = {}
    excess = []
    energies = {n: program.by_group(energy) for n, energy in energies.items()}
    totals = program.by_group(total)
    half_cells = program.by_group(half_cell)
    for index, body in enumerate(program.bodies):
        network = body.network
        smallest = network.min_relative_capacity()
        capacity = network.capacity_at(body.address) * smallest
        for number, energy in energies.items():
            rise = _sums(body, energy[index]) / capacity
            rise = body.largest_of_surface_nodes(rise)
            rises.setdefault(number, {})[index] = rise
        rate = _sums(body, totals[index]) / capacity
        largest_rate = body.largest_of_surface_nodes(rate)
        largest_source_rate = jnp.zeros_like(largest_rate)
        if body.sources:
            from_sources = jnp.zeros_like(network.diagonal())
            for source in body.sources:
                density = _dose(source.heat_rate_density, end, total.dtype, sign)
                per_density = source.rise / smallest
                # A term has the same values on all bodies.
                name, _ = program.entries[source.entries[0]]
                rise = body.largest_of_nodes(
                    per_density * density.integral, source.address
                )
                by_body = rises.setdefault(name, {})
                by_body[index] = jnp.maximum(by_body.get(index, 0), rise)
                from_sources = added(
                    from_sources, source.address, per_density * density.largest
                )
            largest_source_rate = body.largest_of_nodes(from_sources)
            largest_rate = body.largest_of_nodes(
                added(from_sources, body.address, rate)
            )
        rates.append(largest_rate)
        source_rates.append(largest_source_rate)
        conductance = half_cells[index] * network.min_relative_conductivity()
        excess.append(_over(totals[index], conductance))
    by_load = {
        load: program.by_body(
            [
                by_body.get(index, jnp.zeros_like(group_rate))
                for index, group_rate in enumerate(rates)
            ]
        )
        for load, by_body in rises.items()
    }
    by_source = [rise for load, rise in by_load.items() if isinstance(load, str)]
    rate = program.by_body(rates)
    zero = jnp.zeros_like(rate)
    return _ImposedHeat(
        of_all=_Rises(rate, jnp.stack([zero, *by_load.values()])),
        of_sources=_Rises(program.by_body(source_rates), jnp.stack([zero, *by_source])),
        excess=jnp.maximum(_largest_of_bodies(program, excess), 0),
    )


def _largest_of_bodies(
    program: Program, values: Sequence[Float[Array, " _"]]
) -> Float[Array, " b"]:
    """Largest value at the fragments of each body, from those of each group."""
    pairs = zip(program.bodies, values, strict=True)
    return program.by_body([body.largest_of_fragments(group) for body, group in pairs])


def _at_fragments(program: Program, values: Float[Array, " b"]) -> Float[Array, " s"]:
    """Values of all bodies at each fragment of a scene."""
    return program.in_scene([body.at_fragments(values) for body in program.bodies])


def _sums(body: BodyProgram, values: Float[Array, " s"]) -> Float[Array, " m"]:
    """Sums of the values of a body's fragments over each node with surface."""
    count = body.address[0].shape[0]
    return jax.ops.segment_sum(values, body.node, count)


def _over(heat: Float[Array, " s"], conductance: Float[Array, " s"]):
    """Heat over conductance [K]; infinite where heat has no way."""
    ratio = heat * inverse(conductance)
    return jnp.where((heat > 0) & (conductance <= 0), jnp.inf, ratio)


class _SurfaceBounds(NamedTuple):
    """Bounds of surface temperatures of each body, from two bounds of the nodes."""

    by_rise: Float[Array, " b"]
    """Highest surface temperature above nodes of a highest temperature [K]."""
    level: Float[Array, " b"]
    """Surface temperature at which all imposed heat is lost [K]; infinite for none."""
    level_of_flux: Float[Array, " b"]
    """Surface temperature at which imposed fluxes are lost [K]; infinite for none."""
    beneath: Float[Array, " b"]
    """Largest excess of a heated node over that level [K]; infinite for none."""
    excess: Float[Array, " b"]
    """Largest excess over its node of a surface that loses no heat [K]."""


def _by_loss(bounds: list[_SurfaceBounds], beneath, largest) -> Float[Array, " b"]:
    level = largest(_largest(one.level for one in bounds))
    excess = largest(_largest(one.excess for one in bounds))
    return level + beneath + excess


@eqx.filter_jit
def _surface_bounds(
    program: Program,
    around: Float[Array, ""],
    nodes: Float[Array, " b"],
    received: Float[Array, " b"],
    end: float,
) -> _SurfaceBounds:
    """Highest temperatures of the surfaces of each body.

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
    half_cells = program.by_group(half_cell)
    kept = program.by_group(jnp.where(loses, 0, flux))
    loss = program.by_group(loses)
    for n, body in enumerate(program.bodies):
        conductance = half_cells[n] * body.network.min_relative_conductivity()
        conductances.append(conductance)
        beneath.append(
            _excess_of_nodes(
                body,
                flux=kept[n],
                conductance=jnp.where(loss[n], conductance, 0),
                end=end,
            )
        )
    conductance = program.in_scene(conductances)
    excess = _over(flux, conductance)
    node = _at_fragments(program, nodes)
    level_of_flux = level(heat=flux)
    by_rise = jnp.minimum(node + excess, jnp.maximum(node, level_of_flux))
    over_surface = program.in_scene(beneath)
    from_node = jnp.where(over_surface > 0, conductance * over_surface, 0)
    lost = jnp.where(loses, flux + from_node, 0)
    lost_at = level(heat=lost, received=_at_fragments(program, received))

    def largest(values: Float[Array, " s"]) -> Float[Array, " b"]:
        return _largest_of_bodies(program, program.by_group(values))

    return _SurfaceBounds(
        by_rise=largest(by_rise),
        level=largest(lost_at),
        level_of_flux=largest(level_of_flux),
        beneath=_largest_of_bodies(program, beneath),
        excess=largest(jnp.where(loses, 0, excess)),
    )


def _levels(
    program: Program,
    around: Float[Array, ""],
    heat: Float[Array, " s"],
    end: float,
    received: Float[Array, " s"] | float = 0.0,
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
    inside = jnp.zeros(len(body.numbers), heat.dtype)
    if body.sources:
        by_node = jnp.zeros_like(network.diagonal())
        for source in body.sources:
            strength = _dose(source.heat_rate_density, end, heat.dtype).largest
            volume = source.rise * network.capacity_at(source.address)
            by_node = added(by_node, source.address, strength * volume)
        heat = heat + taken(by_node, body.address)
        inside = body.largest_of_nodes(by_node.at[body.address].set(0))
    if body.members is not None:
        inside = taken(inside, taken(body.members.of_node, body.address))
    excess = _over(heat, _sums(body, conductance))
    return taken(jnp.where(inside > 0, jnp.inf, excess), body.node)
