"""Where a fit stands: kept in a file after every step, and read from there again."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxthermo.atomic import replacing
from jaxthermo.errors import InputError

from ..problem.problem import Layouts
from .search import Point


@dataclass(frozen=True)
class Step:
    """What is told of a step."""

    number: int
    loss: float
    """Half of the sum of squares, at the best point so far."""
    accepted: bool
    """Whether the search goes on from where it tried."""
    reach: float
    """From the best point before to the one that was tried, in free numbers."""
    values: tuple[float, ...]
    fresh: bool = True
    """Whether derivatives were found where it tried, not kept from the step before."""
    look: bool = False
    """Whether it tried nothing, and found out how things are at the best point."""

    @property
    def told(self) -> str:
        """What became of it, in words."""
        if self.look:
            return "derivatives found"
        return "accepted" if self.accepted else "not accepted"


class Progress(NamedTuple):
    """Of a fit."""

    point: Point
    layouts: Layouts
    steps: list[Step]
    took: float = 0.0
    """Of the steps, by all processes that took some [s]."""

    def keep(self, path: Path) -> None:
        """Write it to a file, whole or not at all."""
        leaves = {f"leaf{n}": np.asarray(leaf) for n, leaf in enumerate(_leaves(self))}
        told = [
            [s.number, s.loss, s.accepted, s.reach, s.fresh, s.look, *s.values]
            for s in self.steps
        ]
        values: dict[str, Any] = {
            "steps": np.array(told),
            "count": np.asarray(self.point.steps),
            "done": np.asarray(self.point.done),
            "took": np.asarray(self.took),
            **leaves,
        }
        with replacing(path) as temporary, open(temporary, "wb") as file:
            np.savez(file, allow_pickle=False, **values)


def _arrays(at: Progress) -> Any:
    return at.point.z, at.point.state, at.layouts


def _leaves(at: Progress) -> list[Any]:
    return jax.tree.leaves(eqx.filter(_arrays(at), eqx.is_array))


def kept(path: Path, begin: Progress) -> Progress:
    """Where an earlier process was, or the start.

    Args:
        path: that it kept its progress in.
        begin: where a fit starts.

    Raises:
        InputError: if the file is damaged, or of another fit.
    """
    if not path.exists():
        return begin
    dynamic, static = eqx.partition(_arrays(begin), eqx.is_array)
    leaves, tree = jax.tree.flatten(dynamic)
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as read:
            found = [read[f"leaf{n}"] for n in range(len(leaves))]
            told = read["steps"]
            count, done = int(read["count"]), bool(read["done"])
            took = float(read["took"])
    except Exception as error:
        raise InputError(
            f"{path}: cannot be read ({type(error).__name__}): delete it to start anew"
        ) from error
    same = all(
        a.shape == b.shape and a.dtype == b.dtype
        for a, b in zip(found, leaves, strict=True)
    )
    if not same:
        raise InputError(f"{path}: is of another fit: delete it to start anew")
    dynamic = jax.tree.unflatten(tree, [jnp.asarray(a) for a in found])
    z, state, layouts = eqx.combine(dynamic, static)
    steps = [
        Step(int(number), loss, bool(ok), reach, tuple(values), bool(fresh), bool(look))
        for number, loss, ok, reach, fresh, look, *values in told.tolist()
    ]
    return Progress(Point(z, state, count, done), layouts, steps, took)
