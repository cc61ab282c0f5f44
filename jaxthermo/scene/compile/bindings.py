"""Terms bound to a surface: their laws, and where on it they act.

Terms that prescribe a temperature are bound first: no other term acts there. What a
surface of prescribed temperature radiates to others is bound separately.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from ...errors import located
from ...memo.once import once
from ...physics.radiation.irradiation import AbstractRadiativeTerm, Irradiation
from ...physics.surface import Binding, Omitted, Surface
from ...physics.term import AbstractExchangeTerm, AbstractSurfaceTerm, AbstractTerm
from ...voxels.selection import AbstractSelection
from .claims import check_claims


NumberedBindings = tuple[tuple[int, Binding], ...]
"""Bindings with the number of their term in the scene."""


class BoundTerms(NamedTuple):
    """Surface terms bound to a surface; see the fields of `Snapshot`."""

    surface: Surface
    natural: NumberedBindings
    prescribed: NumberedBindings
    radiating: NumberedBindings
    omitted: tuple[tuple[int, Omitted], ...]
    irradiation: tuple[tuple[str, Irradiation], ...]


class BindingSteps(NamedTuple):
    """Steps of binding, each made once for the same terms and the same surface."""

    irradiation: Callable[[AbstractRadiativeTerm, Surface], tuple[Irradiation, ...]]
    laws: Callable[..., tuple[Binding | Omitted, ...]]
    divided: Callable[..., "_Divided"]

    @classmethod
    def once(cls) -> "BindingSteps":
        """Steps of which nothing is made yet."""
        return cls(
            irradiation=once(_irradiation), laws=once(_laws), divided=once(_divided)
        )


def bind_terms(
    terms: Sequence[AbstractTerm], surface: Surface, steps: BindingSteps
) -> BoundTerms:
    """Bind all surface terms, those that prescribe a temperature first.

    Raises:
        InputError: if two terms prescribe the temperature of one piece of surface, or
            both compute its emission.
    """
    surface_terms = {
        n: term for n, term in enumerate(terms) if isinstance(term, AbstractSurfaceTerm)
    }
    irradiation = _bind_irradiation(surface_terms, surface, steps)
    bind_laws = partial(_bind_laws, irradiation=irradiation, steps=steps)
    dirichlet = {n: term for n, term in surface_terms.items() if term.is_dirichlet}
    prescribed, omitted = bind_laws(dirichlet, surface)
    free = surface
    radiating: NumberedBindings = ()
    if prescribed:
        # Other terms have no effect where a temperature is prescribed.
        check_claims(
            prescribed, dirichlet, surface=surface, verb="hold", how="at a temperature"
        )
        free, held = steps.divided(surface, *(binding for _, binding in prescribed))
        # But other surfaces receive radiation from there, which the balance needs.
        exchange = {
            n: term
            for n, term in surface_terms.items()
            if isinstance(term, AbstractExchangeTerm)
        }
        radiating, _ = bind_laws(exchange, held)
    natural, omitted_natural = bind_laws(
        {n: term for n, term in surface_terms.items() if not term.is_dirichlet}, free
    )
    reached = {
        (n, body)
        for n, binding in radiating
        for body, is_acting in enumerate(surface.apart(binding.acting))
        if is_acting.any()
    }
    emission = [
        (n, binding)
        for n, binding in (*natural, *radiating)
        if terms[n].name == "emission"
    ]
    if len(emission) > 1:
        check_claims(
            emission,
            surface_terms,
            surface=surface,
            verb="count the emission of",
            how="",
        )
    return BoundTerms(
        surface=free,
        natural=natural,
        prescribed=prescribed,
        radiating=radiating,
        omitted=tuple(
            (n, omission)
            for n, omission in (*omitted, *omitted_natural)
            if (n, omission.body) not in reached
        ),
        irradiation=tuple(
            (term.absorbed_by, reaching)
            for n, term in surface_terms.items()
            if isinstance(term, AbstractRadiativeTerm)
            for reaching in irradiation[n]
        ),
    )


def _reached(term: AbstractSurfaceTerm, surface: Surface) -> Surface:
    """The surface that a term reaches; terms from outside reach no closed cavity."""
    # A mask names every single fragment and a face one side: they apply as they are.
    selection: AbstractSelection | None = getattr(term, "on", None)
    named = selection is not None and not selection.is_geometric
    return surface.outside if term.from_outside and not named else surface


def _irradiation(
    term: AbstractRadiativeTerm, surface: Surface
) -> tuple[Irradiation, ...]:
    """Irradiation by a term, without the closed cavities that it does not reach."""
    everywhere = term.irradiation(surface)
    if _reached(term, surface) is surface:
        return everywhere
    enclosed = np.concatenate(
        [
            np.zeros(n, bool) if body.enclosed is None else body.enclosed
            for n, body in zip(surface.counts, surface.bodies, strict=True)
        ]
    )
    return tuple(
        irradiation._replace(factor=irradiation.factor * ~enclosed)
        for irradiation in everywhere
    )


def _located(number: int, term: AbstractTerm) -> AbstractContextManager:
    return located(f"terms[{number}], {term.name}")


def _bind_irradiation(
    terms: dict[int, AbstractSurfaceTerm], surface: Surface, steps: BindingSteps
) -> dict[int, tuple[Irradiation, ...]]:
    """Irradiation by each radiative term, by its number."""
    # A camera sees what reaches the surface even where none of it is absorbed.
    irradiation = {}
    for n, term in terms.items():
        if isinstance(term, AbstractRadiativeTerm):
            with _located(n, term):
                irradiation[n] = steps.irradiation(term, surface)
    return irradiation


def _bind_laws(
    terms: Mapping[int, AbstractSurfaceTerm],
    surface: Surface,
    irradiation: dict[int, tuple[Irradiation, ...]],
    steps: BindingSteps,
) -> tuple[NumberedBindings, list[tuple[int, Omitted]]]:
    """Bindings of terms to a surface, and omissions, with the numbers of the terms."""
    bindings = []
    omitted = []
    for n, term in terms.items():
        with _located(n, term):
            reached = _reached(term, surface)
            for result in steps.laws(term, reached, irradiation.get(n)):
                if isinstance(result, Omitted):
                    omitted.append((n, result))
                else:
                    bindings.append((n, result))
    return tuple(bindings), omitted


def _laws(
    term: AbstractSurfaceTerm,
    surface: Surface,
    irradiation: tuple[Irradiation, ...] | None,
) -> tuple[Binding | Omitted, ...]:
    """Laws of a term on a surface; its irradiation is None unless it radiates."""
    if irradiation is None:
        return term.bind(surface)
    assert isinstance(term, AbstractRadiativeTerm)
    return term.absorbed(surface, irradiation)


class _Divided(NamedTuple):
    """A surface with natural boundaries on a part of it alone."""

    free: Surface
    """The part without a prescribed temperature."""
    held: Surface
    """The part with one."""


def _divided(surface: Surface, *prescribed: Binding) -> _Divided:
    is_held = np.any([binding.acting for binding in prescribed], axis=0)
    return _Divided(free=_within(surface, ~is_held), held=_within(surface, is_held))


def _within(surface: Surface, is_within: Bool[np.ndarray, " s"]) -> Surface:
    """The surface with natural boundaries on a part of it alone."""
    pairs = zip(surface.bodies, surface.apart(is_within), strict=True)
    bodies = tuple(
        replace(body, natural=body.natural & body_within) for body, body_within in pairs
    )
    return replace(surface, bodies=bodies)
