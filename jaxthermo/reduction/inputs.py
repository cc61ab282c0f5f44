"""Inputs of a linear scene: the pattern of every term, and its amplitude over time.

At a surface cell with the half cell's conductance G, exchange slopes s and weights w of
amplitudes u, the node receives G / (G + s) (w u - s T_node), and the surface is above
it by (w u - s T_node) / (G + s); a prescribed temperature acts on the node directly.
See `jaxthermo.scene.compile.linear_load`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..physics.flux_law import BoundTerm, LinearLaw
from ..physics.surface_energy_balance import SurfaceTerms
from ..scene.compile.linear_load import EliminatedSurface, eliminate_surface
from ..scene.compile.program import Compiled, Program
from .reduced_model import sampled


_FLUX = "W/m^2"
"""Unit of an input that is a heat flux or irradiance."""
_ABOVE = "K above the start's mean"
"""Unit of an input that is a temperature."""
_DENSITY = "W/m^3"
"""Unit of an input that is a heat source."""
_ONE = "1"
"""Unit of an input with a constant amplitude of 1."""

_REMEDY = "reduce() is for linear scenes; leave it out, or simulate() the scene"
_SAMPLES = 17
"""Times at which two amplitudes are compared."""

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
    return tuple(_merged(term_inputs, len(program.bodies), t1))


def _check_bodies(compiled: Compiled) -> None:
    program = compiled.program
    moves = any(surface.moves for surface in compiled.surfaces)
    if moves or len(compiled.programs) > 1:
        raise InputError(f"reduce: a body or a source moves: {_REMEDY}")
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


class _Law(NamedTuple):
    """A linear law on the cells of one body, by one unit of its amplitude."""

    number: int
    ordinal: int
    prescribed: bool
    unit: str
    amplitude: Any
    weight: Float[np.ndarray, " p"]
    """w [W per unit]."""
    slope: Float[np.ndarray, " p"] | float
    """s [W/K]."""
    area: Float[np.ndarray, " p"]
    """Effective area [m^2], or the conductance of a prescribed temperature [W/K]."""

    @property
    def key(self) -> tuple[int, bool, int]:
        """Identity of the law on all bodies."""
        return self.number, self.prescribed, self.ordinal


def _laws(terms: SurfaceTerms) -> list[_Law]:
    laws = []
    seen = {}
    by_boundary = ((False, terms.natural), (True, terms.prescribed))
    for prescribed, numbered in by_boundary:
        for number, term in numbered:
            law = term.law.linear()
            if law is None:
                raise InputError(
                    f"reduce: {terms.names[number]} is not linear in the temperature, "
                    f"or its coefficient varies with time: {_REMEDY}"
                )
            key = number, prescribed
            ordinal = seen.get(key, -1) + 1
            seen[key] = ordinal
            laws.append(
                _normalized(
                    law,
                    term=term,
                    number=number,
                    ordinal=ordinal,
                    prescribed=prescribed,
                )
            )
    return laws


def _normalized(
    law: LinearLaw, term: BoundTerm, number: int, ordinal: int, prescribed: bool
) -> _Law:
    area = np.asarray(term.effective_area, float)
    weight = np.asarray(law.weight, float)
    slope = None if law.slope is None else np.asarray(law.slope, float)
    unit = _FLUX if slope is None else _ABOVE
    amplitude: Any = law.forcing
    if not callable(amplitude):
        # The value belongs to the amplitude, and not to the pattern.
        forced = np.asarray(weight * float(amplitude))
        weight = np.ones(()) if slope is None else slope
        amplitude = _ratio(forced, weight)
        if amplitude is None:
            weight = forced
            amplitude = 1.0
            unit = _ONE
    return _Law(
        number=number,
        ordinal=ordinal,
        prescribed=prescribed,
        unit=unit,
        amplitude=amplitude,
        weight=np.broadcast_to(weight, area.shape) * area,
        slope=0.0 if slope is None else np.broadcast_to(slope, area.shape) * area,
        area=area,
    )


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
    ends = _fragment_ends(program)
    for index, cells in enumerate(load.cells):
        body = cells.body
        terms = load.terms_on(index)
        acting = {n for n, row in enumerate(load.entries) if row[index] >= 0}
        fragments = slice(int(ends[body]), int(ends[body + 1]))
        reference = program.bodies[body].reference
        fine = program.fragment_terms.selected(fragments, acting, reference)
        on_cells = _laws(terms)
        on_fragments = {law.key: law for law in _laws(fine)}
        through = _eliminated(terms, on_cells).through
        excess = _excess(fine, list(on_fragments.values()))
        touched = any(body in contact.bodies for contact in program.contacts)
        exposed = np.asarray(program.bodies[body].exposed_fraction, float)
        for law in on_cells:
            heat = law.weight if law.prescribed else law.weight * through
            nodes = np.bincount(
                np.asarray(cells.node), heat, len(np.asarray(cells.address[0]))
            )
            above = [np.zeros(n) for n in np.diff(ends)]
            above[body] = excess[law.key] * (exposed if touched else 1.0)
            yield (
                law.key,
                body,
                Input(
                    name=terms.names[law.number],
                    unit=law.unit,
                    amplitude=law.amplitude,
                    heat=((body, cells.address, nodes),),
                    excess=tuple(above),
                ),
            )


def _fragment_ends(program: Program) -> np.ndarray:
    return np.cumsum([0, *(body.node.shape[0] for body in program.bodies)])


def _eliminated(terms: SurfaceTerms, laws: list[_Law]) -> EliminatedSurface:
    half_cell = np.asarray(terms.half_cell, float)
    slope = sum(law.slope for law in laws if not law.prescribed)
    return eliminate_surface(half_cell, slope)


def _excess(terms: SurfaceTerms, laws: list[_Law]) -> dict[tuple, np.ndarray]:
    """Excess of every fragment by one unit of each law [K per unit]."""
    resistance = _eliminated(terms, laws).resistance
    fixed = np.zeros(len(resistance), bool)
    for law in laws:
        fixed |= law.prescribed & (law.area > 0)
    excess = {}
    for law in laws:
        if law.prescribed:
            excess[law.key] = np.divide(
                law.weight, law.area, out=np.zeros(len(fixed)), where=law.area > 0
            )
        else:
            excess[law.key] = np.where(fixed, 0.0, law.weight * resistance)
    return excess


def _sources(program: Program) -> Iterator[tuple[tuple, int, Input]]:
    ends = _fragment_ends(program)
    for number, body in enumerate(program.bodies):
        for source in body.sources:
            capacity = np.asarray(body.network.capacity_at(source.address), float)
            heat = np.asarray(source.rise, float) * capacity
            amplitude = source.heat_rate_density
            name = program.entries[source.entry][0]
            yield (
                (name,),
                number,
                Input(
                    name=name,
                    unit=_DENSITY,
                    amplitude=amplitude if callable(amplitude) else float(amplitude),
                    heat=((number, source.address, heat),),
                    excess=tuple(np.zeros(n) for n in np.diff(ends)),
                ),
            )


def _contact_inputs(program: Program) -> Iterator[tuple[tuple, int, Input]]:
    """Heat between bodies that are all at their references: a constant input."""
    ends = _fragment_ends(program)
    excess = [np.zeros(n) for n in np.diff(ends)]
    heat: list[_NodeHeat] = []
    zero = jnp.zeros(())
    for contact in program.contacts:
        first, second = (program.bodies[b].reference for b in contact.bodies)
        none = jnp.zeros_like(contact.area)
        rate = contact.heat_rate(zero, (none, none), (first, second))
        for side, body in enumerate(contact.bodies):
            sign = -1 if side == 0 else 1
            heat.append((body, contact.address[side], sign * np.asarray(rate, float)))
            side_excess = contact.excess(rate, side, len(excess[body]))
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
    term_inputs: list[tuple[tuple, int, Input]], bodies: int, t1: float
) -> Iterator[Input]:
    """Inputs with one amplitude on several bodies joined, without those that are 0."""
    times = tuple(np.linspace(0.0, t1, _SAMPLES).tolist())
    groups: dict[tuple, list[tuple[int, Input]]] = {}
    for key, body, term_input in term_inputs:
        if not callable(term_input.amplitude) and term_input.amplitude == 0:
            continue
        amplitude = sampled(term_input.amplitude, times)
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
