"""Checkpoint files of a run in segments.

Temperatures are stored in the order of nodes that all layouts of a body share, so that
a run goes on where it was on another number of devices too. Of several processes each
writes a file of its own, with the nodes that it has.
"""

import re
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...archive import read_archive, write_archive
from ...errors import InputError
from ...parallel.lattice import own_sections, spread
from ...parallel.processes import wait_for_all
from ..stepper import RunState
from .plan import Plan
from .segments import RunProgress
from .time_error import Passes, TimeError


_KIND, _VERSION = "checkpoint", 3
_NEW = ".new"


def save_checkpoint(path: Path, plan: Plan, progress: RunProgress, key: str) -> None:
    """Write the checkpoint of a run in one step, from all of its processes."""
    interval, taken, state, *parts, passes = progress
    rest = state.ledger, state.solver_state, parts, passes.rows
    leaves = jax.tree.leaves(rest)
    arrays: dict[str, Any] = {f"leaf{i}": np.asarray(x) for i, x in enumerate(leaves)}
    for n, values in enumerate(_own_nodes(plan, state)):
        arrays[f"body{n}"] = values
    saved = 0 if passes.rows is None else len(passes.rows.is_finite)
    counts = (interval, taken, len(progress.observations), saved, passes.number)
    arrays |= {"key": np.array(key), "position": np.array(counts)}
    arrays["part"] = np.array((jax.process_index(), jax.process_count()))
    # A pass without a difference has none, and no error either.
    numbers = (passes.difference, *(passes.error or ()))
    arrays["error"] = np.array([n for n in numbers if n is not None], float)
    arrays["finished"] = np.array(passes.finished)
    # Replaced in one step: a Ctrl-C while writing leaves the old checkpoint.
    own = _path_of(path, jax.process_index())
    if jax.process_count() == 1:
        write_archive(own, kind=_KIND, version=_VERSION, arrays=arrays, compress=False)
        return
    # And a process that is lost leaves all files of the old one, or of the new one.
    new = own.with_name(own.name + _NEW)
    write_archive(new, kind=_KIND, version=_VERSION, arrays=arrays, compress=False)
    wait_for_all("checkpoint written")
    new.replace(own)
    wait_for_all("checkpoint in place")


def _path_of(path: Path, process: int) -> Path:
    return path if process == 0 else path.with_stem(f"{path.stem}-{process}")


def checkpoint_files(path: Path) -> list[Path]:
    """Files of a checkpoint that are there, of all processes."""
    name = re.compile(
        rf"{re.escape(path.stem)}(-\d+)?{re.escape(path.suffix)}({re.escape(_NEW)})?"
    )
    if not path.parent.is_dir():
        return []
    return sorted(p for p in path.parent.iterdir() if name.fullmatch(p.name))


def _own_nodes(plan: Plan, state: RunState) -> list[np.ndarray]:
    """Values of the nodes of every body that this process has."""
    found = []
    mesh = plan.compiled.program.mesh
    for body, own in zip(plan.scene.bodies, state.theta, strict=True):
        if mesh is None:
            found.append(body.structure.node_values(np.asarray(own)))
        else:
            found.append(body.structure.node_values(*own_sections(mesh, own)))
    return found


def load_checkpoint(
    path: Path, plan: Plan, fresh: RunProgress, key: str
) -> RunProgress | None:
    """Read a checkpoint; None if it is missing, damaged or of another run."""
    parts = _whole_checkpoint(path, key)
    if parts is None:
        return None
    kept = parts[0]
    try:
        interval, taken, rows, saved, number = (int(n) for n in kept["position"])
        # A new run of the same plan has leaves of the same shapes.
        first, before = fresh.initial, None
        if saved:
            before = jax.tree.map(lambda a: jnp.stack([a] * saved), first)
        state = fresh.state
        whole = state.ledger, state.solver_state, [first, (first,) * rows], before
        leaves, tree = jax.tree.flatten(whole)
        loaded = [jnp.asarray(kept[f"leaf{i}"]) for i in range(len(leaves))]
        theta = _states(plan, state, parts)
        difference, error = None, None
        if len(kept["error"]):
            difference, *estimate = kept["error"].tolist()
            error = TimeError(*estimate)
        finished = bool(kept["finished"])
    # Damaged, or the user's own file of the same name.
    except (KeyError, ValueError):
        return None
    alike = lambda a, b: (a.shape, a.dtype) == (b.shape, b.dtype)
    if theta is None or not all(map(alike, leaves, loaded)):
        return None
    ledger, solver_state, (first, found), before = jax.tree.unflatten(tree, loaded)
    state = RunState(theta, ledger, solver_state)
    passes = Passes(
        number=number,
        rows=before,
        difference=difference,
        error=error,
        finished=finished,
    )
    return RunProgress(
        interval=interval,
        steps_taken=taken,
        state=state,
        initial=first,
        observations=found,
        passes=passes,
    )


def _whole_checkpoint(path: Path, key: str) -> list[dict[str, np.ndarray]] | None:
    """The parts of a checkpoint by their number; None if one is missing."""
    found: dict[tuple[int, ...], dict[int, dict[str, np.ndarray]]] = {}
    for file in checkpoint_files(path):
        try:
            kept = read_archive(
                file, kind=_KIND, version=_VERSION, remedy="the run starts again"
            )
            if str(kept["key"]) == key:
                number, count = (int(n) for n in kept["part"])
                at = tuple(int(n) for n in kept["position"])
                found.setdefault((*at, count), {})[number] = kept
        # Damaged, or the user's own file of the same name.
        except (InputError, KeyError, ValueError):
            continue
    whole = [(at, own) for at, own in found.items() if len(own) == at[-1]]
    if not whole:
        return None
    # The last: by pass, interval and step.
    _, own = max(whole, key=lambda each: (each[0][4], *each[0][:2]))
    return [own[number] for number in sorted(own)]


def _states(
    plan: Plan, fresh: RunState, parts: list[dict[str, np.ndarray]]
) -> tuple[jax.Array, ...] | None:
    """States on their devices; None if they are not of the bodies of this plan."""
    mesh, states = plan.compiled.program.mesh, []
    pairs = zip(plan.scene.bodies, fresh.theta, strict=True)
    for n, (body, own) in enumerate(pairs):
        values = np.concatenate([part[f"body{n}"] for part in parts])
        if values.shape != (body.structure.node_count,) or values.dtype != own.dtype:
            return None
        host = body.structure.state_of(values)
        states.append(jnp.asarray(host) if mesh is None else spread(mesh, host))
    return tuple(states)
