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
from ..scene.compile.program import Compiled, Program
from .reduced_model import sampled


FLUX, ABOVE, DENSITY, ONE = "W/m^2", "K above the start's mean", "W/m^3", "1"
"""Units of an input: a heat flux or irradiance, a temperature, a heat source, none."""

_REMEDY = "reduce() is for linear scenes; leave it out, or simulate() the scene"
_SAMPLES = 17
"""Times at which two amplitudes are compared."""

NodeHeat = tuple[int, tuple[Any, ...], Float[np.ndarray, " m"]]
"""A body, positions of some of its nodes in the state, and their heat rates."""


@dataclass(frozen=True, eq=False)
class Input:
    """One term, or a part of it, with one amplitude for all of its pattern."""

    name: str
    unit: str
    amplitude: Any
    """A number or a function of time."""
    heat: tuple[NodeHeat, ...]
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
    found = [*_surface_inputs(program), *_sources(program), *_contact_inputs(program)]
    return tuple(_merged(found, len(program.bodies), t1))


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
    found, seen = [], {}
    kinds = ((False, terms.natural), (True, terms.prescribed))
    for prescribed, numbered in kinds:
        for number, term in numbered:
            law = term.law.linear()
            if law is None:
                raise InputError(
                    f"reduce: {terms.names[number]} is not linear in the temperature, "
                    f"or its coefficient varies with time: {_REMEDY}"
                )
            key = number, prescribed
            ordinal = seen[key] = seen.get(key, -1) + 1
            found.append(
                _normalized(
                    law,
                    term=term,
                    number=number,
                    ordinal=ordinal,
                    prescribed=prescribed,
                )
            )
    return found


def _normalized(
    law: LinearLaw, term: BoundTerm, number: int, ordinal: int, prescribed: bool
) -> _Law:
    area = np.asarray(term.effective_area, float)
    weight = np.asarray(law.weight, float)
    slope = None if law.slope is None else np.asarray(law.slope, float)
    unit, amplitude = FLUX if slope is None else ABOVE, law.forcing
    if not callable(amplitude):
        # The value belongs to the amplitude, and not to the pattern.
        whole = np.asarray(weight * float(amplitude))
        per = np.ones(()) if slope is None else slope
        weight, amplitude = per, _ratio(whole, per)
        if amplitude is None:
            weight, amplitude, unit = whole, 1.0, ONE
    each = lambda values: np.broadcast_to(values, area.shape) * area
    lost = 0.0 if slope is None else each(slope)
    parts = unit, amplitude, each(weight), lost, area
    return _Law(number, ordinal, prescribed, *parts)


def _ratio(whole: np.ndarray, per: np.ndarray) -> float | None:
    """The number that all values are times others; None if there is none."""
    acts = np.broadcast_to(per > 0, np.broadcast_shapes(whole.shape, per.shape))
    values = np.divide(whole, per, out=np.zeros(acts.shape), where=acts)[acts]
    if not values.size:
        return 0.0
    size = np.abs(values).max()
    return float(values.flat[0]) if np.ptp(values) <= 1e-9 * size else None


def _surface_inputs(program: Program) -> Iterator[tuple[tuple, int, Input]]:
    """Inputs of each body by themselves, with the law's key and the body."""
    if program.surface is None:
        return
    load, ends = program.surface.by_cell, _fragment_ends(program)
    for index, cells in enumerate(load.cells):
        body = cells.body
        terms = load.terms_on(index)
        acting = {n for n, own in enumerate(load.entries) if own[index] >= 0}
        here = slice(int(ends[body]), int(ends[body + 1]))
        reference = program.bodies[body].reference
        fine = program.fragment_terms.selected(here, acting, reference)
        on_cells = _laws(terms)
        on_fragments = {law.key: law for law in _laws(fine)}
        half = np.asarray(terms.half_cell, float)
        through = _through(half, on_cells)
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


def _through(half: np.ndarray, laws: list[_Law]) -> np.ndarray:
    both = half + sum(law.slope for law in laws if not law.prescribed)
    return np.divide(half, both, out=np.zeros_like(half), where=both > 0)


def _excess(terms: SurfaceTerms, laws: list[_Law]) -> dict[tuple, np.ndarray]:
    """Excess of every fragment by one unit of each law [K per unit]."""
    half = np.asarray(terms.half_cell, float)
    both = half + sum(law.slope for law in laws if not law.prescribed)
    fixed = np.zeros(len(half), bool)
    for law in laws:
        fixed |= law.prescribed & (law.area > 0)
    found = {}
    for law in laws:
        if law.prescribed:
            per, acts = law.area, law.area > 0
        else:
            per, acts = both, (both > 0) & ~fixed
        found[law.key] = np.divide(law.weight, per, out=np.zeros_like(half), where=acts)
    return found


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
                    unit=DENSITY,
                    amplitude=amplitude if callable(amplitude) else float(amplitude),
                    heat=((number, source.address, heat),),
                    excess=tuple(np.zeros(n) for n in np.diff(ends)),
                ),
            )


def _contact_inputs(program: Program) -> Iterator[tuple[tuple, int, Input]]:
    """Heat between bodies that are all at their references: a constant input."""
    ends = _fragment_ends(program)
    excess = [np.zeros(n) for n in np.diff(ends)]
    heat: list[NodeHeat] = []
    zero = jnp.zeros(())
    for contact in program.contacts:
        first, second = (program.bodies[b].reference for b in contact.bodies)
        none = jnp.zeros_like(contact.area)
        rate = contact.heat_rate(zero, (none, none), (first, second))
        for side, body in enumerate(contact.bodies):
            sign = -1 if side == 0 else 1
            heat.append((body, contact.address[side], sign * np.asarray(rate, float)))
            own = contact.excess(rate, side, len(excess[body]))
            excess[body] = excess[body] + np.asarray(own, float)
    if any(np.any(values) for _, _, values in heat):
        name = "contact of different start temperatures"
        yield (
            (name,),
            0,
            Input(
                name=name,
                unit=ONE,
                amplitude=1.0,
                heat=tuple(heat),
                excess=tuple(excess),
            ),
        )


def _merged(
    found: list[tuple[tuple, int, Input]], bodies: int, t1: float
) -> Iterator[Input]:
    """One input for a term with one amplitude on all bodies, without those of 0."""
    times = tuple(np.linspace(0.0, t1, _SAMPLES).tolist())
    groups: dict[tuple, list[tuple[int, Input]]] = {}
    for key, body, each in found:
        if not callable(each.amplitude) and each.amplitude == 0:
            continue
        same = next(
            (
                other
                for other in groups
                if other[0] == key
                and np.array_equal(
                    sampled(groups[other][0][1].amplitude, times),
                    sampled(each.amplitude, times),
                )
            ),
            None,
        )
        groups.setdefault(same or (key, len(groups)), []).append((body, each))
    names: dict[str, int] = {}
    for parts in groups.values():
        first = parts[0][1]
        alone = len(parts) == 1 and bodies > 1
        name = f"{first.name} on body {parts[0][0]}" if alone else first.name
        names[name] = count = names.get(name, 0) + 1
        yield replace(
            first,
            name=name if count == 1 else f"{name}, part {count}",
            heat=tuple(row for _, each in parts for row in each.heat),
            excess=tuple(
                sum(columns[1:], columns[0])
                for columns in zip(*(each.excess for _, each in parts), strict=True)
            ),
        )
