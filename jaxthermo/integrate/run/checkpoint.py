"""Checkpoint files of a run in segments.

Temperatures are stored in the order of nodes that all layouts of a body share, so that
a run can go on with another number of devices. Each of several processes writes a file
of its own, with the nodes that it holds.
"""

import re
from pathlib import Path

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
from .time_error import PartError, Passes, TimeError


_KIND = "checkpoint"
_VERSION = 4
_NEW = ".new"


def save_checkpoint(path: Path, plan: Plan, progress: RunProgress, key: str) -> None:
    """Write the checkpoint of a run in one step, from all of its processes."""
    state = progress.state
    passes = progress.passes
    leaves = jax.tree.leaves(
        (
            state.ledger,
            state.solver_state,
            [progress.initial, progress.observations],
            passes.rows,
        )
    )
    arrays = {f"leaf{i}": np.asarray(leaf) for i, leaf in enumerate(leaves)}
    for n, values in enumerate(_own_nodes(plan, state)):
        arrays[f"body{n}"] = values
    arrays["key"] = np.array(key)
    arrays["position"] = np.array(
        [
            progress.interval,
            progress.steps_taken,
            len(progress.observations),
            0 if passes.rows is None else len(passes.rows.is_finite),
            passes.number,
        ]
    )
    arrays["part"] = np.array([jax.process_index(), jax.process_count()])
    # The first pass has no error.
    numbers = [] if passes.error is None else passes.error[:2]
    arrays["error"] = np.array(numbers, float)
    arrays["parts"] = np.array(passes.part_errors, float)
    arrays["cause"] = np.array("" if passes.error is None else passes.error.cause)
    arrays["finished"] = np.array(passes.finished)
    # Replaced in one step: an interruption while writing leaves the old checkpoint.
    process_path = _path_of(path, jax.process_index())
    if jax.process_count() == 1:
        write_archive(
            process_path,
            format_name=_KIND,
            version=_VERSION,
            arrays=arrays,
            compress=False,
        )
        return
    # If a process is lost, either all files are old or all files are new.
    new = process_path.with_name(process_path.name + _NEW)
    write_archive(
        new, format_name=_KIND, version=_VERSION, arrays=arrays, compress=False
    )
    wait_for_all("checkpoint written")
    new.replace(process_path)
    wait_for_all("checkpoint in place")


def _path_of(path: Path, process: int) -> Path:
    return path if process == 0 else path.with_stem(f"{path.stem}-{process}")


def checkpoint_files(path: Path) -> list[Path]:
    """Return the existing files of a checkpoint, of all processes."""
    name = re.compile(
        rf"{re.escape(path.stem)}(-\d+)?{re.escape(path.suffix)}({re.escape(_NEW)})?"
    )
    if not path.parent.is_dir():
        return []
    return sorted(p for p in path.parent.iterdir() if name.fullmatch(p.name))


def _own_nodes(plan: Plan, state: RunState) -> list[np.ndarray]:
    """Values of the nodes of every body that this process holds."""
    node_values = []
    mesh = plan.compiled.program.mesh
    numbers = []
    for group, theta in zip(plan.groups, state.theta, strict=True):
        if mesh is None:
            values = group.structure.node_values(np.asarray(theta))
        else:
            values = group.structure.node_values(*own_sections(mesh, theta))
        numbers += group.numbers
        if group.is_single:
            node_values.append(values)
        else:
            node_values += [values[nodes] for nodes in group.nodes]
    return [node_values[n] for n in np.argsort(numbers)]


def load_checkpoint(
    path: Path, plan: Plan, fresh: RunProgress, key: str
) -> RunProgress | None:
    """Read a checkpoint; None if it is missing, damaged or of another run."""
    archives = _complete_checkpoint(path, key)
    if archives is None:
        return None
    first_archive = archives[0]
    try:
        interval, steps_taken, row_count, saved, number = (
            int(n) for n in first_archive["position"]
        )
        # A new run of the same plan has leaves of the same shapes.
        first = fresh.initial
        previous_rows = None
        if saved:
            previous_rows = jax.tree.map(lambda a: jnp.stack([a] * saved), first)
        state = fresh.state
        template = (
            state.ledger,
            state.solver_state,
            [first, (first,) * row_count],
            previous_rows,
        )
        leaves, tree = jax.tree.flatten(template)
        loaded = [jnp.asarray(first_archive[f"leaf{i}"]) for i in range(len(leaves))]
        theta = _states(plan, state, archives)
        part_errors = tuple(
            PartError(difference, kelvin, stagnates=bool(stagnates), holds=bool(holds))
            for difference, kelvin, stagnates, holds in first_archive["parts"].tolist()
        )
        error = None
        if len(first_archive["error"]):
            kelvin, limit = first_archive["error"].tolist()
            error = TimeError(kelvin, limit=limit, cause=str(first_archive["cause"]))
        finished = bool(first_archive["finished"])
    # Damaged, or the user's own file of the same name.
    except (KeyError, ValueError):
        return None
    fits = all(
        (a.shape, a.dtype) == (b.shape, b.dtype)
        for a, b in zip(leaves, loaded, strict=True)
    )
    if theta is None or not fits:
        return None
    ledger, solver_state, (first, observations), previous_rows = jax.tree.unflatten(
        tree, loaded
    )
    state = RunState(theta, ledger, solver_state)
    passes = Passes(
        number=number,
        rows=previous_rows,
        part_errors=part_errors,
        error=error,
        finished=finished,
    )
    return RunProgress(
        interval=interval,
        steps_taken=steps_taken,
        state=state,
        initial=first,
        observations=observations,
        passes=passes,
    )


def _complete_checkpoint(path: Path, key: str) -> list[dict[str, np.ndarray]] | None:
    """Read the files of a checkpoint, in order of processes; None if one is missing."""
    archives_by_position: dict[tuple[int, ...], dict[int, dict[str, np.ndarray]]] = {}
    for file in checkpoint_files(path):
        try:
            arrays = read_archive(
                file, format_name=_KIND, version=_VERSION, remedy="the run starts again"
            )
            if str(arrays["key"]) == key:
                number, count = (int(n) for n in arrays["part"])
                position = tuple(int(n) for n in arrays["position"])
                archives_by_position.setdefault((*position, count), {})[number] = arrays
        # Damaged, or the user's own file of the same name.
        except (InputError, KeyError, ValueError):
            continue
    complete = [
        (position, archives)
        for position, archives in archives_by_position.items()
        if len(archives) == position[-1]
    ]
    if not complete:
        return None

    def pass_interval_step(candidate) -> tuple[int, ...]:
        position, _ = candidate
        return (position[4], *position[:2])

    _, latest = max(complete, key=pass_interval_step)
    return [latest[number] for number in sorted(latest)]


def _states(
    plan: Plan, fresh: RunState, archives: list[dict[str, np.ndarray]]
) -> tuple[jax.Array, ...] | None:
    """States on their devices; None if they are not of the bodies of this plan."""
    mesh = plan.compiled.program.mesh
    states = []
    for group, fresh_theta in zip(plan.groups, fresh.theta, strict=True):
        values = group.on_nodes(
            [
                np.concatenate([archive[f"body{n}"] for archive in archives])
                for n in group.numbers
            ]
        )
        if (
            values.shape != (group.structure.node_count,)
            or values.dtype != fresh_theta.dtype
        ):
            return None
        host = group.structure.state_of(values)
        states.append(jnp.asarray(host) if mesh is None else spread(mesh, host))
    return tuple(states)
