"""State of a fit, kept in a file after every step, and read from there again."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
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
    values: tuple[float, ...] | list[float]
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
        """Write to a file, atomically: a line of JSON, then the arrays."""
        steps = [asdict(step) for step in self.steps]
        header = {"steps": steps, "done": self.done, "seconds": self.seconds}
        with replacing(path) as temporary, open(temporary, "wb") as file:
            file.write(json.dumps(header).encode() + b"\n")
            eqx.tree_serialise_leaves(file, _arrays(self))


def _arrays(progress: Progress) -> Any:
    return progress.z, progress.solver_state, progress.step_tables


def load_progress(path: Path, start: Progress) -> Progress:
    """Read the state that an earlier process saved, or return the start.

    Raises:
        InputError: if the file is damaged, or of another fit.
    """
    if not path.exists():
        return start
    try:
        with path.open("rb") as file:
            header = json.loads(file.readline())
            # Leaves that are no arrays, such as programs, are those of the start.
            z, state, tables = eqx.tree_deserialise_leaves(file, _arrays(start))
            steps = [StepRecord(**step) for step in header["steps"]]
    # Whatever is wrong with a file that the user did not write, the remedy is the same.
    except Exception as error:
        raise InputError(
            f"{path}: is damaged, or of another fit ({type(error).__name__}): delete "
            "it to start again"
        ) from error
    return Progress(z, state, tables, steps, header["done"], header["seconds"])
