"""State of a fit, kept in a file after every step, and read from there again."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxthermo.atomic import replacing
from jaxthermo.errors import InputError

from ..problem.problem import StepTables


@dataclass(frozen=True)
class StepRecord:
    """History of one step."""

    number: int
    loss: float
    """Half of the sum of squares, at the best point so far."""
    accepted: bool
    """The trial became the best point."""
    length: float
    """Largest change of a coordinate from the best point to the trial."""
    values: tuple[float, ...]
    """Parameter values at the best point."""
    exact: bool = True
    """The trial's Jacobian was computed, not corrected from the point before."""
    refresh: bool = False
    """The step tried no other point, but computed the Jacobian at the best one."""

    @property
    def outcome(self) -> str:
        """Outcome in words."""
        if self.refresh:
            return "Jacobian computed"
        return "accepted" if self.accepted else "not accepted"


class Progress(NamedTuple):
    """State of a fit between two steps."""

    z: Float[Array, " p"]
    """Best point."""
    solver_state: Any
    step_tables: StepTables
    steps: list[StepRecord]
    done: bool = False
    """The solver's own criterion is met."""
    seconds: float = 0.0
    """Time of the steps, over all processes that took some [s]."""

    def save(self, path: Path) -> None:
        """Write to a file, atomically."""
        arrays = jax.tree.leaves(eqx.filter(_state(self), eqx.is_array))
        history = [
            [s.number, s.loss, s.accepted, s.length, s.exact, s.refresh, *s.values]
            for s in self.steps
        ]
        values: dict[str, Any] = {
            "steps": np.array(history),
            "done": np.asarray(self.done),
            "seconds": np.asarray(self.seconds),
            **{f"leaf{n}": np.asarray(array) for n, array in enumerate(arrays)},
        }
        with replacing(path) as temporary, open(temporary, "wb") as file:
            np.savez(file, allow_pickle=False, **values)


def _state(progress: Progress) -> Any:
    return progress.z, progress.solver_state, progress.step_tables


def load_progress(path: Path, start: Progress) -> Progress:
    """Read the state that an earlier process saved, or return the start.

    Raises:
        InputError: if the file is damaged, or of another fit.
    """
    if not path.exists():
        return start
    dynamic, static = eqx.partition(_state(start), eqx.is_array)
    leaves, tree = jax.tree.flatten(dynamic)
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as read:
            found = [read[f"leaf{n}"] for n in range(len(leaves))]
            history = read["steps"]
            done, seconds = bool(read["done"]), float(read["seconds"])
    except Exception as error:
        raise InputError(
            f"{path}: cannot be read ({type(error).__name__}): delete it to start again"
        ) from error
    matches = all(
        a.shape == b.shape and a.dtype == b.dtype
        for a, b in zip(found, leaves, strict=True)
    )
    if not matches:
        raise InputError(f"{path}: is of another fit: delete it to start again")
    dynamic = jax.tree.unflatten(tree, [jnp.asarray(a) for a in found])
    z, solver_state, step_tables = eqx.combine(dynamic, static)
    steps = [
        StepRecord(
            int(n), loss, bool(ok), length, tuple(values), bool(exact), bool(new)
        )
        for n, loss, ok, length, exact, new, *values in history.tolist()
    ]
    return Progress(z, solver_state, step_tables, steps, done, seconds)
