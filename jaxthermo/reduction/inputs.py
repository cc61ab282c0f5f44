"""Inputs of a linear scene: the pattern of every term, and its amplitude over time."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..physics.contact.links import PairNodes
from ..physics.flux_law import LinearLaw
from ..physics.surface_energy_balance import SurfaceTerms
from ..physics.time_varying import is_unknown_function
from ..scene.compile.linear_surface import (
    LinearSurface,
    linear_surface,
    nonlinear_term,
)
from ..scene.compile.program import Compiled, Program
from .reduced_model import knots_of, sampled


_FLUX = "W/m^2"
"""Unit of an input that is a heat flux or irradiance."""
_ABOVE = "K above the start's mean"
"""Unit of an input that is a temperature."""
_DENSITY = "W/m^3"
"""Unit of an input that is a heat source."""
_ONE = "1"
"""Unit of an input with a constant amplitude of 1."""

_REMEDY = "reduce() is for linear scenes; leave it out, or simulate() the scene"

_NodeHeat = tuple[int, tuple[Any, ...], Float[np.ndarray, " m"]]
"""A body, positions of some of its nodes in the state, and their heat rates."""


@dataclass(frozen=True, eq=False)
class Input:
    """One term, or a part of it, with one amplitude for all of its pattern."""

    name: str
    unit: str
    amplitude: Any
    """A number or a function of time."""
    heat: tuple[_NodeHeat, ...]
    """Heat rates by one unit of the input [W per unit]."""
    excess: tuple[Float[np.ndarray, " _"], ...]
    """Excess of each body's fragments over their nodes [K per unit]."""


def find_inputs(compiled: Compiled, t1: float) -> tuple[Input, ...]:
    """All inputs of a compiled scene; terms without effect are left out.

    Raises:
        InputError: naming the term or the body that is not linear.
    """
    program = compiled.program
    _check_bodies(compiled)
    term_inputs = [
        *_surface_inputs(program),
        *_sources(program),
        *_contact_inputs(program),
    ]
    amplitudes = [term_input.amplitude for _, _, term_input in term_inputs]
    varies = any(map(is_unknown_function, amplitudes))
    knots = knots_of(t1, compiled.breakpoints, varies)
    return tuple(_merged(term_inputs, len(program.bodies), knots))


def _check_bodies(compiled: Compiled) -> None:
    program = compiled.program
    moves = any(surface.moves for surface in compiled.surfaces)
    if moves or len(compiled.programs) > 1:
        raise InputError(f"reduce: a body or a source moves: {_REMEDY}")
    if program.airs:
        raise InputError(
            "reduce: the temperature of enclosed air is no input: give InteriorAir "
            "instead, or simulate() the scene"
        )
    for number, body in enumerate(program.bodies):
        if not body.network.is_linear:
            raise InputError(
                f"reduce: the material of body {number} varies with temperature: "
                "give a constant conductivity and specific heat"
            )
    if program.enclosure is not None:
        raise InputError(
            "reduce: radiative_exchange is not linear in the temperature: " + _REMEDY
        )
    for contact in program.contacts:
        if callable(contact.conductance):
            raise InputError(
                "reduce: the conductance of a contact varies with time: give a number"
            )


def _normalized_surface(terms: SurfaceTerms) -> tuple[LinearSurface, list[str]]:
    """The terms with their values in the forcings, and the units of these."""
    nonlinear = nonlinear_term(terms)
    if nonlinear is not None:
        raise InputError(
            f"reduce: {terms.names[nonlinear]} is not linear in the temperature, "
            f"or its coefficient varies with time: {_REMEDY}"
        )
    surface = linear_surface(terms)
    normalized = []
    units = []
    for term in surface.terms:
        law, unit = _normalized(term.law)
        normalized.append(term._replace(law=law))
        units.append(unit)
    return surface._replace(terms=tuple(normalized)), units


def _normalized(law: LinearLaw) -> tuple[LinearLaw, str]:
    unit = _FLUX if law.slope is None else _ABOVE
    if callable(law.forcing):
        return law, unit
    # The value belongs to the amplitude, and not to the pattern.
    forced = np.asarray(law.weight * float(law.forcing))
    weight = np.ones(()) if law.slope is None else law.slope
    amplitude = _ratio(forced, weight)
    if amplitude is None:
        return law._replace(weight=forced, forcing=1.0), _ONE
    return law._replace(weight=weight, forcing=amplitude), unit


def _ratio(forced: np.ndarray, weight: np.ndarray) -> float | None:
    """The common ratio of two arrays where the weight is not 0; None without one."""
    forced, weight = np.broadcast_arrays(forced, weight)
    is_acting = weight > 0
    ratios = forced[is_acting] / weight[is_acting]
    if not ratios.size:
        return 0.0
    size = np.abs(ratios).max()
    return float(ratios.flat[0]) if np.ptp(ratios) <= 1e-9 * size else None


def _surface_inputs(program: Program) -> Iterator[tuple[tuple, int, Input]]:
    """Inputs of each body, with the key of the law and the number of the body."""
    if program.surface is None:
        return
    load = program.surface.by_cell
    counts = [len(excess) for excess in _no_excess(program)]
    ends = np.cumsum([0, *counts])
    for index, cells in enumerate(load.cells):
        body = cells.body
        terms = load.terms_on(index)
        acting = {n for n, row in enumerate(load.entries) if row[index] >= 0}
        fragments = slice(int(ends[body]), int(ends[body + 1]))
        reference = program.bodies[body].reference
        fine = program.fragment_terms.selected(fragments, acting, reference)
        on_cells, units = _normalized_surface(terms)
        on_fragments, _ = _normalized_surface(fine)
        touched = any(body in contact.bodies for contact in program.contacts)
        exposed = np.asarray(program.bodies[body].exposed_fraction, float)
        count = len(np.asarray(cells.address[0]))
        ordinals: Counter = Counter()
        for cell_term, fragment_term, unit in zip(
            on_cells.terms, on_fragments.terms, units, strict=True
        ):
            heat = on_cells.heat(cell_term)
            above = _no_excess(program)
            excess = on_fragments.excess(fragment_term)
            above[body] = excess * (exposed if touched else 1.0)
            law_key = cell_term.number, cell_term.is_prescribed
            yield (
                (*law_key, ordinals[law_key]),
                body,
                Input(
                    name=terms.names[cell_term.number],
                    unit=unit,
                    amplitude=cell_term.law.forcing,
                    heat=(
                        (
                            body,
                            cells.address,
                            np.bincount(np.asarray(cells.node), heat, count),
                        ),
                    ),
                    excess=tuple(above),
                ),
            )
            ordinals[law_key] += 1


def _no_excess(program: Program) -> list[np.ndarray]:
    """0 for every fragment, by body."""
    return [np.zeros(body.node.shape) for body in program.bodies]


def _sources(program: Program) -> Iterator[tuple[tuple, int, Input]]:
    for number, body in enumerate(program.bodies):
        for source in body.sources:
            capacity = np.asarray(body.network.capacity_at(source.address), float)
            heat = np.asarray(source.rise, float) * capacity
            amplitude = source.heat_rate_density
            name = program.entries[source.entries[0]][0]
            yield (
                (name,),
                number,
                Input(
                    name=name,
                    unit=_DENSITY,
                    amplitude=amplitude if callable(amplitude) else float(amplitude),
                    heat=((number, source.address, heat),),
                    excess=tuple(_no_excess(program)),
                ),
            )


def _contact_inputs(program: Program) -> Iterator[tuple[tuple, int, Input]]:
    """Heat between bodies that are all at their references: a constant input."""
    excess = _no_excess(program)
    heat: list[_NodeHeat] = []
    zero = jnp.zeros(())
    for contact in program.contacts:
        first, second = (program.bodies[b].reference for b in contact.bodies)
        none = jnp.zeros_like(contact.area)
        conducted = contact.heat(zero, PairNodes((none, none), (first, second)))
        rate = np.asarray(conducted.rate, float)
        for side, body in enumerate(contact.bodies):
            sign = -1 if side == 0 else 1
            heat.append((body, contact.address[side], sign * rate))
            fragments = len(excess[body])
            side_excess = contact.fragment_excess(conducted.excess, side, fragments)
            excess[body] = excess[body] + np.asarray(side_excess, float)
    if any(np.any(values) for _, _, values in heat):
        name = "contact of different start temperatures"
        yield (
            (name,),
            0,
            Input(
                name=name,
                unit=_ONE,
                amplitude=1.0,
                heat=tuple(heat),
                excess=tuple(excess),
            ),
        )


def _merged(
    term_inputs: list[tuple[tuple, int, Input]], bodies: int, knots: tuple[float, ...]
) -> Iterator[Input]:
    """Inputs with one amplitude on several bodies joined, without those that are 0.

    Amplitudes are compared at all knots, between which they are linear [s].
    """
    groups: dict[tuple, list[tuple[int, Input]]] = {}
    for key, body, term_input in term_inputs:
        if not callable(term_input.amplitude) and term_input.amplitude == 0:
            continue
        amplitude = sampled(term_input.amplitude, knots)
        group = (key, amplitude.tobytes())
        groups.setdefault(group, []).append((body, term_input))
    names: dict[str, int] = {}
    for members in groups.values():
        body, first = members[0]
        name = first.name
        if len(members) == 1 and bodies > 1:
            name = f"{name} on body {body}"
        count = names.get(name, 0) + 1
        names[name] = count
        by_body = zip(*(member.excess for _, member in members), strict=True)
        yield replace(
            first,
            name=name if count == 1 else f"{name}, part {count}",
            heat=tuple(row for _, member in members for row in member.heat),
            excess=tuple(np.sum(columns, axis=0) for columns in by_body),
        )
