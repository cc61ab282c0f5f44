"""A scene that is bound once, as a compiled function of its numbers.

Materials, weights, coefficients, temperatures and tables are arguments of the program.
What follows from geometry alone is found while it is traced; its arrays are arguments,
too, the same ones in every call. Numbers that are 0 or 1 throughout are constants: a
term that is 0 is left out, and weights of 1 need no arrays.
"""

import dataclasses
import hashlib
import itertools
from collections.abc import Callable, Hashable
from typing import Any, NamedTuple

import jax
import jax.core
import numpy as np
from jax.interpreters.partial_eval import dce_jaxpr_consts
from jaxtyping import Array, Float

from ...arrays import HOST, rows_of, rows_remembered
from ...errors import shortened
from ...memo.found import digest, found
from ...memo.once import once
from ..scene import Scene
from .program import Compiled


class _SceneForm(NamedTuple):
    """A scene apart from its numbers."""

    identity: tuple[object, ...]
    """Grids and arrays of its structures, which are compared by identity."""
    values: Hashable
    """All else that its program depends on: kinds, options, constants, and shapes of
    its numbers."""


class _SceneNumbers(NamedTuple):
    """Numbers of a scene, and the form in which they are the arguments."""

    form: _SceneForm | None
    """None for a scene whose form cannot be compared."""
    positions: tuple[int, ...]
    """Position of each number among the leaves of the scene."""
    values: list[Float[np.ndarray, "..."]]


class _LeafNumbers(NamedTuple):
    """Numbers among some leaves of a scene."""

    form: tuple[Hashable, ...]
    """Shape of each leaf that is a number, and what else the others are."""
    positions: tuple[int, ...]
    """Position of each number among the leaves."""
    values: list[Float[np.ndarray, "..."]]

    @classmethod
    def of(
        cls, leaves: list[Any], dtype: np.dtype, of_parts: dict[int, "_LeafNumbers"]
    ) -> "_LeafNumbers":
        """Numbers of leaves, some of which stand for the leaves of a part."""
        form: list[Hashable] = []
        positions = []
        values = []
        for leaf in leaves:
            # Most leaves are single numbers.
            if type(leaf) is float:
                if leaf in (0, 1):
                    form.append(((), leaf))
                else:
                    positions.append(len(form))
                    values.append(np.asarray(leaf, dtype))
                    form.append(())
                continue
            of_part = of_parts.get(id(leaf))
            if of_part is not None:
                positions += [len(form) + position for position in of_part.positions]
                values += of_part.values
                form += of_part.form
                continue
            array = _array(leaf)
            if array is None:
                form.append((type(leaf), leaf))
            elif not np.issubdtype(array.dtype, np.inexact):
                form.append(digest(array))
            elif _is_constant(array):
                form.append((array.shape, float(array.flat[0])))
            else:
                positions.append(len(form))
                values.append(array.astype(dtype))
                form.append(array.shape)
        return cls(tuple(form), tuple(positions), values)


def separate_numbers(scene: Scene) -> _SceneNumbers:
    """Separate the numbers of a scene, which has no traced values, from its form."""
    dtype = np.dtype(scene.dtype)
    structures = scene.structures
    of_structures = found(
        structures,
        by=("numbers of structures", scene.dtype),
        find=lambda: [
            _LeafNumbers.of(jax.tree.leaves(structure), dtype, {})
            for structure in structures
        ],
    )
    leaves, outline = scene.flattened
    numbers = _LeafNumbers.of(
        leaves, dtype, dict(zip(map(id, structures), of_structures, strict=True))
    )
    identities = [structure.identity for structure in structures]
    # Most structures share their weights.
    outline_of = once(jax.tree.structure)
    # The outline of a structure would keep its grid alive.
    options = [(s.options, outline_of(s.weights)) for s in structures]
    form = (outline, *options, *numbers.form)
    is_comparable = all(identities)
    try:
        hash(form)
    except TypeError:
        is_comparable = False
    identity = tuple(itertools.chain.from_iterable(identities))
    return _SceneNumbers(
        form=_SceneForm(identity, form) if is_comparable else None,
        positions=numbers.positions,
        values=numbers.values,
    )


def _is_constant(array: np.ndarray) -> bool:
    """True for numbers that are 0 or 1 throughout."""
    if array.size == 0 or array.flat[0] not in (0, 1):
        return False
    return array.size == 1 or bool(np.ptp(array) == 0)


def changed_constants(original: Scene, changed: Scene) -> tuple[str, ...]:
    """Name the numbers for which a scene of other numbers is compiled again.

    They are 0 or 1 in one of two scenes that are alike otherwise.
    """
    positions = [
        set(separate_numbers(scene).positions) for scene in (original, changed)
    ]
    if positions[0] == positions[1]:
        return ()
    first = jax.tree.leaves(original)
    named = jax.tree_util.tree_leaves_with_path(changed)
    if len(first) != len(named):
        return ()
    lines = []
    for position in sorted(positions[0] ^ positions[1]):
        path, leaf = named[position]
        name = jax.tree_util.keystr(path).removeprefix(".")
        lines.append(
            f"{name} is {shortened(leaf)} instead of {shortened(first[position])}: "
            "another program was compiled"
        )
    return tuple(lines)


def _array(leaf: Any) -> np.ndarray | None:
    """A leaf of a scene as an array, with numbers as floats; None for other leaves."""
    if isinstance(leaf, int | float) and not isinstance(leaf, bool):
        return np.asarray(leaf, float)
    return np.asarray(leaf) if isinstance(leaf, HOST | jax.Array) else None


@dataclasses.dataclass(frozen=True, eq=False)
class _TracedScene:
    """A scene as a compiled function of its numbers."""

    program: Callable[..., list[Array]]
    """Arrays of the compiled scene, from constants and numbers."""
    constants: list[Array]
    batches: tuple[tuple[int, ...], ...]
    """Numbers that are one argument of the program, by their positions in a list."""
    outline: Any
    """Structure of the compiled scene as a pytree."""
    leaves: tuple[Any, ...]
    """Its leaves; None for those that depend on the numbers."""
    places: tuple[int, ...]
    """Place of each of these among the constants and the results of the program."""

    def __call__(self, numbers: list[Float[np.ndarray, "..."]]) -> Compiled:
        """Return the compiled scene with these numbers."""
        arguments = _stacked(numbers, self.batches)
        arrays = [*self.constants, *self.program(self.constants, arguments)]
        computed = iter([arrays[place] for place in self.places])
        return self.outline.unflatten(
            [next(computed) if leaf is None else leaf for leaf in self.leaves]
        )


def trace_scene(
    scene: Scene,
    numbers: _SceneNumbers,
    bind: Callable[[Scene], Compiled],
    by: Hashable,
) -> _TracedScene | None:
    """Trace the binding of a scene; once for all scenes of the same form.

    `by` are the options of `bind`. The result is None for a form of which it is known
    that it cannot be traced.
    """
    return _remembered(numbers, by, lambda: _traced(scene, numbers, bind))


def mark_untraceable(numbers: _SceneNumbers, by: Hashable) -> None:
    """Remember that scenes of this form cannot be traced, with options of binding."""
    _remembered(numbers, by, lambda: None)


def _remembered(
    numbers: _SceneNumbers, by: Hashable, trace: Callable[[], _TracedScene | None]
) -> _TracedScene | None:
    assert numbers.form is not None
    return found(
        numbers.form.identity,
        by=("traced scene", numbers.form.values, by),
        find=trace,
    )


def _traced(
    scene: Scene, numbers: _SceneNumbers, bind: Callable[[Scene], Compiled]
) -> _TracedScene:
    scene_leaves, scene_outline = jax.tree.flatten(scene)
    outlines: list[Any] = []
    known: list[Any] = []

    batches = _batches(scene, numbers)
    arguments = _stacked(numbers.values, batches)

    def traced(arguments: list[Array]) -> list[Any]:
        leaves = list(scene_leaves)
        for batch, values in zip(batches, arguments, strict=True):
            rows = rows_of(values) if len(batch) > 1 else [values]
            for number, value in zip(batch, rows, strict=True):
                leaves[numbers.positions[number]] = value
        compiled = bind(scene_outline.unflatten(leaves))
        compiled_leaves, outline = jax.tree.flatten(compiled)
        outlines.append(outline)
        computed = [isinstance(leaf, jax.core.Tracer) for leaf in compiled_leaves]
        pairs = list(zip(compiled_leaves, computed, strict=True))
        known.extend([None if is_computed else leaf for leaf, is_computed in pairs])
        return [leaf for leaf, is_computed in pairs if is_computed]

    # Arrays of geometry are arguments of the program: as its constants, XLA would keep
    # them twice and take long to compile.
    with rows_remembered():
        closed = jax.make_jaxpr(traced)(arguments)
    # Most numbers of bodies are used as one array: their rows need no operation.
    jaxpr, used, _ = dce_jaxpr_consts(
        closed.jaxpr, [True] * len(closed.jaxpr.outvars), instantiate=True
    )

    # Of constants, and of results that are several leaves, XLA would return copies.
    distinct = {id(var): var for var in (*jaxpr.constvars, *jaxpr.outvars)}
    place_of = {key: place for place, key in enumerate(distinct)}
    results = list(distinct.values())[len(jaxpr.constvars) :]
    with_results = jaxpr.replace(outvars=results)

    def program(constants: list[Array], values: list[Any]) -> list[Any]:
        return jax.core.eval_jaxpr(with_results, constants, *values)

    constants = jax.device_put(list(itertools.compress(closed.consts, used)))
    whole = jax.jit(program, keep_unused=True)
    lowered = whole.lower(constants, arguments)
    # Scenes that differ in geometry alone, as by a sun that moved, share a program.
    text = hashlib.sha256(lowered.as_text().encode()).digest()
    return _TracedScene(
        program=found((), by=("program of a scene", text), find=lowered.compile),
        constants=constants,
        batches=batches,
        outline=outlines[0],
        leaves=tuple(known),
        places=tuple(place_of[id(var)] for var in jaxpr.outvars),
    )


def _batches(scene: Scene, numbers: _SceneNumbers) -> tuple[tuple[int, ...], ...]:
    """Numbers of one shape that the bodies have at the same place, together.

    A program then has as many arguments for many bodies as for a few.
    """
    paths = [path for path, _ in jax.tree_util.tree_leaves_with_path(scene)]
    batches: dict[Hashable, list[int]] = {}
    for number, position in enumerate(numbers.positions):
        path = paths[position]
        shape = numbers.values[number].shape
        is_of_body = jax.tree_util.keystr(path[:1]) == ".bodies"
        place = path[2:] if is_of_body else path
        key = is_of_body, jax.tree_util.keystr(place), shape
        batches.setdefault(key, []).append(number)
    return tuple(map(tuple, batches.values()))


def _stacked(
    numbers: list[Float[np.ndarray, "..."]], batches: tuple[tuple[int, ...], ...]
) -> list[Float[np.ndarray, "..."]]:
    """Arguments of the program; a number by itself is one as it is."""
    rows = [[numbers[number] for number in batch] for batch in batches]
    return [np.stack(row) if row[1:] else row[0] for row in rows]
