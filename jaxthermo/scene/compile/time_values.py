"""Values of terms that vary with time, in the form in which steps use them.

Tables become pieces between their times, at which steps end. Functions of time are
integrated on the host and become pieces too, unless a value that they depend on is
traced: then each step evaluates them itself.
"""

from dataclasses import fields, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from equinox import Module
from jaxtyping import Array, Float

from ...arrays import Time, is_traced
from ...physics.tabulated import SHAPE, tabulated
from ...physics.term import AbstractSurfaceTerm, AbstractTerm
from ...physics.time_varying import Table, Until
from ...physics.windows import AbstractVarying, FunctionOfTime
from ..receipt_model import Part
from ..scene import Scene, mechanism_names


class MissedIntegral(NamedTuple):
    """Integral that the lines of a function miss, in its units times seconds."""

    missed: float
    """Estimate of the integral that is missed."""
    varying: float
    """Integral of what varies."""


class TimeForm(NamedTuple):
    """A value in the form that steps use."""

    value: Any
    note: str = ""
    """Changes that may be missed, in words; empty if none."""
    missed: MissedIntegral | None = None
    """None if the integral is that of the function."""


class TimeValues(NamedTuple):
    """A scene whose values that vary have the form that steps use."""

    scene: Scene
    forms: tuple[tuple[int, str, TimeForm], ...]
    """Number of the term, name of the field and form of each value that varies."""
    names: tuple[str, ...] = ()
    """Name of the mechanism of each term, if any value varies."""

    def notes(self, acting: tuple[int, ...]) -> tuple[str, ...]:
        """Notes on values of the terms that act, by their numbers."""
        return self._labelled([(n, name, f.note) for n, name, f in self.forms], acting)

    def warnings(
        self, acting: tuple[int, ...], parts: tuple[Part, ...]
    ) -> tuple[str, ...]:
        """Warnings of values of the terms that act, by their numbers.

        `parts` are the areas and volumes that each mechanism acts on: where they make
        an energy of the integral of a value, the warning states that.
        """
        texts = []
        for number, field, form in self.forms:
            if form.missed is not None:
                acted_on = [p for p in parts if p.mechanism == self.names[number]]
                text = _unresolved(field, form.missed, acted_on)
                texts.append((number, field, text))
        return self._labelled(texts, acting)

    def _labelled(
        self, texts: list[tuple[int, str, str]], acting: tuple[int, ...]
    ) -> tuple[str, ...]:
        lines = [
            f"{self.names[number]}: {field} {text}"
            for number, field, text in texts
            if text and number in acting
        ]
        return tuple(dict.fromkeys(lines))


def with_time_values(
    scene: Scene, end: float, save_times: tuple[float, ...] | None
) -> TimeValues:
    """Return the scene with its values that vary in the form that steps use.

    Args:
        scene: bodies and terms.
        end: of the run [s].
        save_times: saved times of the run, at which the integrals of functions are
            those of the functions themselves [s]; None to leave functions as they are.
    """
    traced = scene.is_traced
    terms = []
    forms = []
    for number, term in enumerate(scene.terms):
        changed = {
            name: form_of(
                value,
                end=end,
                save_times=save_times,
                traced=traced,
                shape=_shape_of(term),
            )
            for name, value in _varying_fields(term).items()
        }
        forms += [(number, name, form) for name, form in changed.items()]
        terms.append(_with_fields(term, changed))
    if not forms:
        return TimeValues(scene, ())
    return TimeValues(
        replace(scene, terms=tuple(terms)), tuple(forms), mechanism_names(scene)
    )


def _shape_of(term: AbstractTerm) -> float:
    """Integral that a line may move of a term's functions, as `SHAPE` [-]."""
    is_shown = isinstance(term, AbstractSurfaceTerm) and term.is_dirichlet
    return _SHAPE_SHOWN if is_shown else SHAPE


class _Closed(Module):
    """A function of time with the traced numbers that it closed over as its leaves."""

    function: Any

    def __call__(self, time: Time) -> Float[Array, "..."]:
        dtype = jnp.result_type(float)
        return self.function(jnp.asarray(time, dtype)).astype(time.dtype)


def with_open_functions(scene: Scene) -> Scene:
    """Return the scene with functions whose traced numbers are leaves of the scene.

    A run must know them as traced, and derivatives must reach them.
    """
    terms = []
    for term in scene.terms:
        closed = {}
        for name, value in _varying_fields(term).items():
            opened = _opened(value)
            if opened is not value:
                closed[name] = TimeForm(opened)
        terms.append(_with_fields(term, closed))
    if all(new is old for new, old in zip(terms, scene.terms, strict=True)):
        return scene
    return replace(scene, terms=tuple(terms))


def _opened(value: Any) -> Any:
    if isinstance(value, Until):
        inner = _opened(value.value)
        return value if inner is value.value else Until(inner, value.end)
    if not callable(value) or isinstance(value, AbstractVarying) or is_traced(value):
        return value
    with jax.ensure_compile_time_eval():
        time = jnp.zeros(())
        closes_over = is_traced(value(time))
    return _Closed(eqx.filter_closure_convert(value, time)) if closes_over else value


def _varying_fields(term: AbstractTerm) -> dict[str, Any]:
    """Fields of a term with values that vary with time, by name."""
    varying = [value for value in term.values if callable(value)]
    return {
        field.name: value
        for field in fields(term)
        for value in varying
        if getattr(term, field.name) is value
    }


def _with_fields(term: AbstractTerm, forms: dict[str, TimeForm]) -> AbstractTerm:
    if not forms:
        return term
    # Not `replace`, which would check numbers again, and say them all in its errors.
    return eqx.tree_at(
        lambda tree: [getattr(tree, name) for name in forms],
        term,
        [form.value for form in forms.values()],
        is_leaf=callable,
    )


def form_of(
    value: Any,
    end: float,
    save_times: tuple[float, ...] | None,
    traced: bool,
    shape: float = SHAPE,
) -> TimeForm:
    """Return a function of time in the form that steps use.

    Arguments are as in `with_time_values`; `traced` is True where steps are taken in
    loops of fixed length, which do not end at the kinks of a function; `shape` is the
    integral that a line may move within a piece, over what varies in it [-].
    """
    if isinstance(value, Until):
        if not callable(value.value):
            return TimeForm(value)
        stop = min(value.end, end)
        form = form_of(
            value.value, end=stop, save_times=save_times, traced=traced, shape=shape
        )
        return form._replace(value=Until(form.value, value.end))
    if isinstance(value, Table):
        if len(value.times) == 1:
            return TimeForm(value.values[0])
        return TimeForm(value.piecewise(ends_steps=not is_traced(value.times)))
    if isinstance(value, AbstractVarying):
        return TimeForm(value)
    if save_times is None or end <= 0:
        return TimeForm(FunctionOfTime(value))
    lines = None
    if not is_traced(value):
        lines = tabulated(
            value, end=end, cuts=save_times, ends_steps=not traced, shape=shape
        )
    if lines is None:
        return TimeForm(FunctionOfTime(value), note=_EVALUATED)
    if lines.is_resolved:
        note = _INTEGRATED.format(lines.spacing)
        if not lines.is_shaped:
            note += _COARSE.format(100 * lines.shifted / lines.varying)
        return TimeForm(lines.value, note=note)
    missed = MissedIntegral(missed=lines.unresolved, varying=lines.varying)
    return TimeForm(lines.value, missed=missed)


def _unresolved(field: str, integral: MissedIntegral, parts: list[Part]) -> str:
    """The missed integral of a field that acts on parts, in words."""
    extents = {
        "heat_rate": 1.0,
        "heat_flux": sum(part.area for part in parts),
        "heat_rate_density": sum(part.volume for part in parts),
    }
    missed, varying = integral
    if field not in extents:
        return _UNRESOLVED.format(
            f"{missed:.2g} of its integral over time", f"{varying:.2g} varies"
        )
    joule = extents[field]
    return _UNRESOLVED.format(
        f"{missed * joule:.2g} J", f"{varying * joule:.2g} J vary"
    )


_SHAPE_SHOWN = 1e-4
"""Integral that a line may move of a temperature that surfaces show, as `SHAPE` [-]."""

_EVALUATED = (
    "is evaluated at four points of each step: what is shorter than a step may be "
    "missed"
)

_INTEGRATED = (
    "is a function of time: what it does within less than {:.2g} s may be missed; a "
    "Table or Until states its times"
)

_COARSE = "; it has so many that {:.2g} % of it moves in time, within a few steps"

_UNRESOLVED = (
    "is a function that varies too fast to be integrated: about {} is missed, where "
    "{}; give a smoother function or a Table"
)
