"""All steps of a plan in loops of fixed length, which reverse mode needs.

A step is compiled once for all intervals between save times, and once for all snapshots
of what moves: a program that lists its intervals takes as many times as long to trace
and to compile.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...scene.compile.program import Program
from ..stepper import RunState
from .plan import (
    Plan,
    StepTable,
    program_groups,
    saved_numbers,
    step_blocks,
    step_table,
)
from .schedule import similar_intervals, similar_rows
from .solution import Observation, saved_rows
from .step_loop import Span, steps_of, take_row


def take_fixed_steps(plan: Plan, state: RunState) -> Observation:
    """Take every step of a plan in loops of fixed length, for reverse mode.

    Returns:
        The observations at the save times.
    """
    pairs = program_groups(plan)
    programs = _stacked([program for program, _ in pairs])
    if programs is not None:
        return _take_snapshots(plan, programs, state)
    observations = []
    saved = []
    for program, groups in pairs:
        for sequence in similar_intervals(groups):
            table = step_table(plan, sequence)
            take = _table_loop(plan, table)
            state, rows = take(program, state, table)
            observations.append(rows)
            saved.append(saved_numbers(sequence))
    return saved_rows(observations, saved)


class FixedLoop(NamedTuple):
    """Size of a loop over rows of a step table that is not known when it is traced."""

    rows: int
    columns: int
    """Intervals with steps in each row, at most."""
    length: int
    """Largest number of steps of an interval."""


def fixed_loops(table: StepTable, room: int) -> tuple[FixedLoop, ...]:
    """Loops over similar rows of a table, with room for `room` times as many steps."""
    steps = [row[row > 0].tolist() for row in np.asarray(table.steps)]
    sequences = [steps[rows] for rows in similar_rows(steps)]
    return tuple(
        FixedLoop(
            rows=len(sequence),
            columns=max(map(len, sequence)),
            length=room * max(map(max, sequence)),
        )
        for sequence in sequences
    )


def have_room(loops: Sequence[FixedLoop], table: StepTable) -> bool:
    """True if no interval of the table has more steps than its loop."""
    most_steps = np.asarray(table.steps).max(axis=1)
    lengths = [loop.length for loop in loops for _ in range(loop.rows)]
    return bool((most_steps <= lengths).all())


def take_table_steps(
    plan: Plan, state: RunState, table: StepTable, loops: Sequence[FixedLoop]
) -> Observation:
    """Take the steps of a table that may be traced, each row up to a save time.

    The plan has a single program.
    """
    observations = []
    first = 0
    for loop in loops:
        rows = slice(first, first + loop.rows)
        loop_table = StepTable(
            start=table.start[rows, : loop.columns],
            dt=table.dt[rows, : loop.columns],
            steps=table.steps[rows, : loop.columns],
            observation_time=table.observation_time[rows],
        )
        take = _loop_of_length(plan, loop.length, is_even=False)
        state, observed = take(plan.compiled.program, state, loop_table)
        observations.append(observed)
        first += loop.rows
    return jax.tree.map(lambda *rows: jnp.concatenate(rows), *observations)


class _Stacked(NamedTuple):
    """Programs of one form: their arrays along a new first axis."""

    arrays: Any
    common: Any
    """Fields that are equal in all programs."""


def _stacked(programs: Sequence[Program]) -> _Stacked | None:
    """Return several programs as one; None for one, or if they differ in form."""
    arrays, common = zip(
        *(eqx.partition(program, eqx.is_array) for program in programs), strict=True
    )

    def form(program: Any) -> Any:
        leaves, outline = jax.tree.flatten(program)
        return outline, [(leaf.shape, leaf.dtype) for leaf in leaves]

    first = form(arrays[0])
    alike = all(form(program) == first for program in arrays[1:])
    if len(programs) == 1 or not alike or not eqx.tree_equal(*common):
        return None
    return _Stacked(jax.tree.map(lambda *rows: jnp.stack(rows), *arrays), common[0])


def _take_snapshots(plan: Plan, programs: _Stacked, state: RunState) -> Observation:
    """Take the steps of all snapshots in one loop over them."""
    blocks = step_blocks(plan)
    tables = jax.tree.map(
        lambda *columns: np.stack(columns), *(block.table for block in blocks)
    )
    take = _table_loop(plan, tables)

    def take_snapshot(state: RunState, snapshot: tuple[Any, StepTable]):
        arrays, table = snapshot
        return take(eqx.combine(arrays, programs.common), state, table)

    _, rows = jax.lax.scan(take_snapshot, state, (programs.arrays, tables))
    observations = [jax.tree.map(lambda a, k=k: a[k], rows) for k in range(len(blocks))]
    return saved_rows(observations, [block.saved_rows for block in blocks])


def _table_loop(plan: Plan, tables: StepTable):
    """Return the function that takes the steps of one of some tables."""
    length = int(tables.steps.max())
    return _loop_of_length(plan, length, bool((tables.steps == length).all()))


def _loop_of_length(plan: Plan, length: int, is_even: bool):
    """Return the function that takes the steps of a table in loops of this length.

    With `is_even` every interval has that many steps, otherwise at most as many.
    """

    def take_table(
        program: Program, state: RunState, table: StepTable
    ) -> tuple[RunState, Observation]:
        take_span = steps_of(plan.stepper, program, plan.checkpoints, length)

        def take_interval(state: RunState, span: Span) -> tuple[RunState, None]:
            return take_span(state, span._replace(steps=length) if is_even else span)

        def save_interval(state: RunState, row: StepTable):
            return take_row(take_interval, program, state, row)

        return jax.lax.scan(save_interval, state, jax.tree.map(jnp.asarray, table))

    return take_table
