"""Checkpoint files of a run in segments.

Temperatures are stored in the layout that all runs of a body share, so that a run goes
on where it was on another number of devices too.
"""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...archive import read_archive, write_archive
from ...errors import InputError
from ...module import replaced
from ...parallel.lattice import spread
from ..stepper import RunState
from .plan import Plan
from .segments import RunProgress
from .time_error import Passes, TimeError


_KIND, _VERSION = "checkpoint", 3


def save_checkpoint(path: Path, plan: Plan, progress: RunProgress, key: str) -> None:
    """Write a checkpoint file in one step."""
    interval, taken, state, *parts, passes = progress
    leaves = jax.tree.leaves((_stored(plan, state), parts, passes.rows))
    arrays: dict[str, Any] = {f"leaf{i}": np.asarray(x) for i, x in enumerate(leaves)}
    saved = 0 if passes.rows is None else len(passes.rows.is_finite)
    counts = (interval, taken, len(progress.observations), saved, passes.number)
    arrays |= {"key": np.array(key), "position": np.array(counts)}
    # A pass without a difference has none, and no error either.
    numbers = (passes.difference, *(passes.error or ()))
    arrays["error"] = np.array([n for n in numbers if n is not None], float)
    arrays["finished"] = np.array(passes.finished)
    # Replaced in one step: a Ctrl-C while writing leaves the old checkpoint.
    write_archive(path, _KIND, _VERSION, arrays, compress=False)


def _stored(plan: Plan, state: RunState) -> RunState:
    """The state with the values of nodes on the host, in place of lattices."""
    pairs = zip(plan.scene.bodies, state.theta, strict=True)
    theta = tuple(body.structure.node_values(np.asarray(own)) for body, own in pairs)
    return replaced(state, theta=theta)


def _loaded(plan: Plan, state: RunState) -> RunState:
    """The state on its devices, of one with the values of nodes."""
    mesh, theta = plan.compiled.program.mesh, []
    for body, values in zip(plan.scene.bodies, state.theta, strict=True):
        host = body.structure.state_of(np.asarray(values))
        theta.append(jnp.asarray(host) if mesh is None else spread(mesh, host))
    rest = jax.tree.map(jnp.asarray, (state.ledger, state.solver_state))
    return RunState(tuple(theta), *rest)


def load_checkpoint(
    path: Path, plan: Plan, fresh: RunProgress, key: str
) -> RunProgress | None:
    """Read a checkpoint file; None if it is missing, damaged or of another run."""
    try:
        kept = read_archive(path, _KIND, _VERSION, "the run starts again")
        if str(kept["key"]) != key:
            return None
        interval, taken, rows, saved, number = (int(n) for n in kept["position"])
        # A new run of the same plan has leaves of the same shapes.
        first, before = fresh.initial, None
        if saved:
            before = jax.tree.map(lambda a: jnp.stack([a] * saved), first)
        whole = _stored(plan, fresh.state), (first, (first,) * rows), before
        leaves, tree = jax.tree.flatten(whole)
        loaded = [kept[f"leaf{i}"] for i in range(len(leaves))]
        difference, error = None, None
        if len(kept["error"]):
            difference, *estimate = kept["error"].tolist()
            error = TimeError(*estimate)
        finished = bool(kept["finished"])
    # Missing or damaged, or the user's own file of the same name.
    except (InputError, KeyError, ValueError):
        return None
    alike = lambda a, b: (a.shape, a.dtype) == (b.shape, b.dtype)
    if not all(map(alike, leaves, loaded)):
        return None
    state, (first, found), before = jax.tree.unflatten(tree, loaded)
    first, found, before = jax.tree.map(jnp.asarray, (first, found, before))
    state = _loaded(plan, state)
    passes = Passes(number, before, difference, error, finished)
    return RunProgress(interval, taken, state, first, found, passes)
