"""State of a fit between steps: its file, its history, and the choice of a step.

Steps may stop lowering the loss because the Jacobian was corrected from other points,
see `levenberg_marquardt`. The fit then computes it at the best point and continues from
there, until a refresh is no longer worth its cost.
"""

import io
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxthermo.archive import read_archive, write_archive
from jaxthermo.errors import InputError

from ..config.fit_record import Step
from ..problem.time_steps import StepTables


_KIND = "state of a fit"
_VERSION = 1
_REMEDY = "delete it to start again"


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
    at_limit: bool = False
    """The trial was too stiff for the largest number of steps of a run."""

    @property
    def outcome_words(self) -> str:
        """Loss, and the outcome of a step that found no better point."""
        if self.outcome == "accepted":
            return f"loss {self.loss:.6g}"
        return f"loss {self.loss:.6g}, {self.outcome}"

    def as_json(self, with_values: bool) -> Step:
        """Values for `fit.json`."""
        return {
            "step": self.number,
            "loss": self.loss,
            "accepted": self.accepted,
            "jacobian_computed": self.exact,
            "values": list(self.values) if with_values else [],
        }

    @property
    def outcome(self) -> str:
        """Outcome in words."""
        if self.refresh:
            return "Jacobian computed"
        return "accepted" if self.accepted else "not accepted"


class FitState(NamedTuple):
    """State of a fit between two steps."""

    z: Float[Array, " p"]
    """Best point."""
    solver_state: Any
    step_tables: StepTables
    steps: list[StepRecord]
    done: bool = False
    """The solver's own criterion is met."""
    seconds: float = 0.0
    """Time of all steps, also those of earlier processes [s]."""

    def save(self, path: Path) -> None:
        """Write to a file, in one step, with a checksum."""
        steps = [asdict(step) for step in self.steps]
        header = {"steps": steps, "done": self.done, "seconds": self.seconds}
        leaves = io.BytesIO()
        eqx.tree_serialise_leaves(leaves, _arrays(self))
        arrays = {
            "header": np.array(json.dumps(header)),
            "leaves": np.frombuffer(leaves.getvalue(), np.uint8),
        }
        write_archive(
            path, format_name=_KIND, version=_VERSION, arrays=arrays, compress=False
        )


def _arrays(progress: FitState) -> Any:
    return (progress.z, progress.solver_state, progress.step_tables)


def load_progress(path: Path, start: FitState) -> FitState:
    """Read the state that an earlier process saved, or return the start."""
    if not path.exists():
        return start
    arrays = read_archive(path, format_name=_KIND, version=_VERSION, remedy=_REMEDY)
    try:
        header = json.loads(str(arrays["header"]))
        leaves = io.BytesIO(arrays["leaves"].tobytes())
        # Leaves that are no arrays, such as programs, are those of the start.
        z, state, tables = eqx.tree_deserialise_leaves(leaves, _arrays(start))
        steps = [StepRecord(**step) for step in header["steps"]]
    # Whatever is wrong with a file that the user did not write, the remedy is the same.
    except Exception as error:
        raise InputError(
            f"{path}: of another fit ({type(error).__name__}); {_REMEDY}"
        ) from error
    return FitState(
        z=z,
        solver_state=state,
        step_tables=tables,
        steps=steps,
        done=header["done"],
        seconds=header["seconds"],
    )


STAGNATION_LIMIT = 2
"""Trials without progress that end a fit."""
_NEAR = 0.03
"""Length up to which a rejected trial counts; a longer one is shortened first."""


def next_action(
    steps: list[StepRecord], done: bool, size: int, tolerance: float, dtype: Any
) -> Literal["refresh", "try", "end"]:
    """Choose what follows the steps so far.

    `done` is the solver's own criterion, `size` the number of coordinates, and
    `tolerance` the relative change of the loss that is not worth two more trials.
    """
    if not steps:
        return "refresh"
    # What the solver says of a step that went nowhere does not count.
    if steps[-1].refresh:
        return "try"
    stagnant = _is_stagnant(steps, tolerance, dtype)
    ends = stagnant or done
    # The best point before the trials that end the search.
    earlier = steps[: -STAGNATION_LIMIT if stagnant else -1] if ends else steps
    best_is_exact = next((s.exact for s in reversed(earlier) if s.accepted), True)
    if not (ends or not steps[-1].accepted) or best_is_exact:
        return "end" if ends else "try"
    # A refresh costs about one run per coordinate. It is not worth that, nor the trials
    # after it, where the last one hardly was.
    last_refresh = max(n for n, step in enumerate(steps) if step.refresh)
    gain = _relative_gain(steps[last_refresh:])
    worth = tolerance * (1 + size / STAGNATION_LIMIT)
    return "end" if gain <= worth else "refresh"


def _is_stagnant(steps: list[StepRecord], tolerance: float, dtype: Any) -> bool:
    last = steps[-STAGNATION_LIMIT:]
    if len(steps) <= STAGNATION_LIMIT or any(s.refresh for s in last):
        return False
    if any(not s.accepted and s.length > _NEAR for s in last):
        return False
    # Rounding of a sum over thousands of residuals.
    resolved = max(16 * float(jnp.finfo(dtype).eps), tolerance)
    return _relative_gain(steps[-1 - STAGNATION_LIMIT :]) <= resolved


def _relative_gain(steps: list[StepRecord]) -> float:
    first = steps[0].loss
    return (first - steps[-1].loss) / first if first > 0 else 0.0


def is_improving(steps: list[StepRecord]) -> bool:
    """True if a trial was accepted after the last exact Jacobian at the best point."""
    for step in reversed(steps):
        if step.refresh:
            return False
        if step.accepted:
            return True
    return False


def was_stopped_by_limit(steps: list[StepRecord]) -> bool:
    """True if a trial after the best point was too stiff to be run."""
    for step in reversed(steps):
        if step.at_limit:
            return True
        if step.accepted and not step.refresh:
            return False
    return False
