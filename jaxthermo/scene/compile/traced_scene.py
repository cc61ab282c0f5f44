"""A scene that is bound once, as a compiled function of its numbers.

Materials, weights, coefficients, temperatures and tables are arguments of the program.
What follows from geometry alone is found while it is traced: small arrays of it become
constants that other calls share. Numbers that are 0 or 1 throughout stay constants: a
term that is 0 is left out, and weights of 1 need no arrays.
"""

import hashlib
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.core
import numpy as np
from jaxtyping import Array, Float

from ...arrays import HOST
from ...findings import digest, found
from ...structures.structure import AbstractStructure
from ..scene import Scene
from .program import Compiled


class SceneForm(NamedTuple):
    """A scene apart from its numbers."""

    identity: tuple[object, ...]
    """Grids and arrays of its structures, which are compared by identity."""
    values: Hashable
    """All else that its program depends on: kinds, options, constants, and shapes of
    its numbers."""


class SceneNumbers(NamedTuple):
    """Numbers of a scene, and the form in which they are the arguments."""

    form: SceneForm | None
    """None for a scene whose form cannot be compared."""
    number: tuple[int, ...]
    """Position of each number among the leaves of the scene."""
    values: list[Float[np.ndarray, "..."]]


def scene_numbers(scene: Scene) -> SceneNumbers:
    """Separate the numbers of a scene, which has no traced values, from its form."""
    parts, outline = jax.tree.flatten(scene, is_leaf=_is_structure)
    values: list[Hashable] = [outline, scene.dtype]
    identity: list[object] = []
    is_comparable = True
    for part in parts:
        if isinstance(part, AbstractStructure):
            identity += part.identity
            values.append(part.options)
            is_comparable &= bool(part.identity)
    positions = []
    numbers = []
    for position, leaf in enumerate(jax.tree.leaves(scene)):
        number = _number(leaf, scene.dtype)
        if number is None:
            values.append(_constant(leaf))
        else:
            positions.append(position)
            numbers.append(number)
            values.append(number.shape)
    key = tuple(values)
    try:
        hash(key)
    except TypeError:
        is_comparable = False
    form = SceneForm(tuple(identity), key) if is_comparable else None
    return SceneNumbers(form, tuple(positions), numbers)


def _is_structure(part: Any) -> bool:
    return isinstance(part, AbstractStructure)


def _number(leaf: Any, dtype: str) -> Float[np.ndarray, "..."] | None:
    """A leaf as an argument of the program; None for a constant of it."""
    if isinstance(leaf, bool) or not isinstance(leaf, int | float | HOST | jax.Array):
        return None
    values = np.asarray(leaf)
    if not isinstance(leaf, int) and not np.issubdtype(values.dtype, np.inexact):
        return None
    first = values.flat[0] if values.size else 0.0
    if first in (0.0, 1.0) and (values == first).all():
        return None
    return values.astype(dtype)


def _constant(leaf: Any) -> Hashable:
    if isinstance(leaf, HOST | jax.Array):
        return digest(np.asarray(leaf))
    return type(leaf), leaf


@dataclass(frozen=True, eq=False)
class TracedScene:
    """A scene as a compiled function of its numbers."""

    program: Callable[..., list[Array]]
    """Arrays of the compiled scene, from constants and numbers."""
    constants: list[Array]
    outline: Any
    """Structure of the compiled scene as a pytree."""
    leaves: tuple[Any, ...]
    """Its leaves; None for those that depend on the numbers."""

    def __call__(self, numbers: list[Float[np.ndarray, "..."]]) -> Compiled:
        """Return the compiled scene with these numbers."""
        computed = iter(self.program(self.constants, numbers))
        return self.outline.unflatten(
            next(computed) if leaf is None else leaf for leaf in self.leaves
        )


def trace_scene(
    scene: Scene,
    numbers: SceneNumbers,
    bind: Callable[[Scene], Compiled],
    by: Hashable,
) -> TracedScene:
    """Trace the binding of a scene; once for all scenes of the same form.

    `by` are the options of `bind`.
    """
    if numbers.form is None:
        return _traced(scene, numbers, bind)
    return found(
        numbers.form.identity,
        ("traced scene", numbers.form.values, by),
        lambda: _traced(scene, numbers, bind),
    )


def _traced(
    scene: Scene, numbers: SceneNumbers, bind: Callable[[Scene], Compiled]
) -> TracedScene:
    scene_leaves, scene_outline = jax.tree.flatten(scene)
    outputs: list[Any] = []
    outlines: list[Any] = []

    def traced(values: list[Array]) -> list[Array]:
        leaves = list(scene_leaves)
        for position, value in zip(numbers.number, values, strict=True):
            leaves[position] = value
        compiled, outline = jax.tree.flatten(bind(scene_outline.unflatten(leaves)))
        outlines.append(outline)
        outputs.extend(None if _is_traced(leaf) else leaf for leaf in compiled)
        return [leaf for leaf in compiled if _is_traced(leaf)]

    # Arrays of geometry are arguments of the program: as its constants, XLA would keep
    # them twice and take long to compile.
    closed = jax.make_jaxpr(traced)(numbers.values)
    jaxpr = closed.jaxpr

    def program(constants: list[Array], values: list[Any]) -> list[Array]:
        return jax.core.eval_jaxpr(jaxpr, constants, *values)

    constants = jax.device_put(closed.consts)
    lowered = jax.jit(program).lower(constants, numbers.values)
    # Scenes that differ in geometry alone, as by a sun that moved, share a program.
    text = hashlib.sha256(lowered.as_text().encode()).digest()
    return TracedScene(
        program=found((), ("bound scene", text), lowered.compile),
        constants=constants,
        outline=outlines[0],
        leaves=tuple(outputs),
    )


def _is_traced(leaf: Any) -> bool:
    return isinstance(leaf, jax.core.Tracer)
