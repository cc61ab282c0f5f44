"""`experiments run random-scenes`: what scenes drawn at random must keep."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, cast

import jax

from jaxthermo.console.progress import terminal_progress
from jaxthermo.console.terminal import open_console
from jaxthermo.errors import InputError
from jaxthermo.memo.found import forget_findings

from ..harness.case import Case, Check, Group, Row, exactly
from ..harness.record import Record
from ..harness.report import CasesResult, PageTexts, run_cases
from .draw import FORMS, SEED, draw
from .measure import RunRow, SceneRow, measure


SCENES = 300
# One of each form in each dtype.
QUICK = {"cases": f"0-{2 * len(FORMS) - 1}"}

ENERGY = {"float32": 1e-5, "float64": 1e-11}
"""Largest energy residual over the heat that moved, by dtype [-]."""
OVERSHOOT = 1e-3
"""Largest excess over the bounds, over their range [-]."""
FACTOR = 10.0
MARGIN = 2e-3
"""A stated error is at most FACTOR times the true one and this [K]."""

# Numbers of 300 scenes that may miss their limit.
_MAY_LOSE_HEAT = 3
_MAY_STATE_TOO_LITTLE = 5
_MAY_STATE_TOO_MUCH = 30

# Interval of the lines that replace a progress bar in a pipe [s].
_INTERVAL = 30.0

_PAGE = PageTexts(
    "Random scenes",
    (
        "Each scene has one of a few shapes and structures, and numbers drawn over "
        "realistic ranges: materials from silver to foam, voxels from 0.05 to 20 mm. "
        "It is run by default, and by one other solver; its error in time is that "
        "against a run in float64 by steps a quarter as long.",
        "Listed below each limit are the runs that miss it.",
    ),
)


class Scene(NamedTuple):
    """A scene with its runs."""

    number: int
    row: SceneRow

    def runs(self) -> Iterator[tuple[RunRow, Row]]:
        """Each run, with its row of the report."""
        for run in self.row["runs"]:
            yield run, self.reported(run)

    def reported(self, run: RunRow) -> Row:
        """The row of a run, in which nothing is judged."""
        return Row(
            what=f"{self.number}: {self.row['form']}",
            solver=run["solver"],
            dtype=self.row["dtype"],
            energy_residual=run["energy_residual"],
            result=run["result"],
            seen="; ".join(run["warnings"]),
        )


def run(folder: Path, cases: str | None = None) -> CasesResult:
    """Measure the scenes of numbers such as "3,40-49", or all; write the page.

    Scenes that the folder has from the same programs are not measured again.
    """
    begin = time.perf_counter()
    numbers = _numbers(cases)
    sources = tuple(sorted(Path(__file__).parent.glob("*.py")))
    record = Record(folder, sources)
    scenes = []
    with terminal_progress(open_console(), _INTERVAL) as progress:
        progress.stage("scenes", total=len(numbers))
        previous_form = None
        # One form after the other, so that few compiled programs are in use at a time.
        for number in sorted(numbers, key=lambda number: number % len(FORMS)):
            form = number % len(FORMS)
            if form != previous_form:
                # Else a process would run out of mappings of memory.
                jax.clear_caches()
                forget_findings()
            previous_form = form

            def make(number: int = number):
                return dict(measure(draw(number))), {}

            row = record.once({"seed": SEED, "scene": number}, {"scene": number}, make)
            if "refused" in row:
                raise InputError(f"scene {number}: {row['refused']}")
            scenes.append(Scene(number, cast("SceneRow", row)))
            progress.advance()
    group = Group("Random scenes", judged(scenes))
    return run_cases((group,), names=None, folder=folder, texts=_PAGE, begin=begin)


def _numbers(cases: str | None) -> list[int]:
    if cases is None:
        return list(range(SCENES))
    numbers: set[int] = set()
    for word in cases.split(","):
        first, _, last = word.partition("-")
        try:
            numbers.update(range(int(first), int(last or first) + 1))
        except ValueError as error:
            raise InputError(
                f"--cases {cases}: give numbers of scenes, such as 3,40-49"
            ) from error
    if not numbers or max(numbers) >= SCENES:
        raise InputError(f"--cases {cases}: there are scenes 0 to {SCENES - 1}")
    return sorted(numbers)


def judged(scenes: list[Scene]) -> tuple[Case, ...]:
    """The limits as cases, with the scenes that miss them."""

    def energy() -> Iterator[Row]:
        losses = [
            (scene.number, run, reported)
            for scene in scenes
            for run, reported in scene.runs()
            if not run["energy_residual"] <= ENERGY[scene.row["dtype"]]
        ]
        missed = {number for number, *_ in losses}
        silent = {number for number, run, _ in losses if not run["warnings"]}
        closing = _count(scenes, missed, _MAY_LOSE_HEAT)
        yield Row("scenes that close", checks=(closing,))
        yield Row(
            "others that say nothing", checks=(exactly("scenes", len(silent), 0),)
        )
        yield from (reported for *_, reported in losses)

    def bounds() -> Iterator[Row]:
        excesses = [
            (scene.number, run, reported)
            for scene in scenes
            for run, reported in scene.runs()
            if not run["overshoot"] <= OVERSHOOT
        ]
        missed = {number for number, *_ in excesses}
        yield Row("scenes within bounds", checks=(_count(scenes, missed, 0),))
        for _, run, reported in excesses:
            excess = f"{run['overshoot']:.2g} of the range beyond the bounds"
            yield reported._replace(seen=excess)

    def error_in_time() -> Iterator[Row]:
        too_small = [scene for scene in scenes if not _states_enough(scene.row)]
        too_large = [scene for scene in scenes if not _states_little(scene.row)]
        for what, missed, allowed in (
            (
                "scenes that state the true error or more",
                too_small,
                _MAY_STATE_TOO_LITTLE,
            ),
            ("scenes that do not state far more", too_large, _MAY_STATE_TOO_MUCH),
        ):
            numbers = {scene.number for scene in missed}
            yield Row(what, checks=(_count(scenes, numbers, allowed),))
        for scene in (*too_small, *too_large):
            row = scene.row
            errors = (
                f"states {row['stated_error']:.2g} K, has {row['true_error']:.2g} K"
            )
            yield scene.reported(row["runs"][0])._replace(seen=errors)

    return (
        Case(
            id="R1",
            title="the energy closes",
            source="conservation of energy",
            requirement=(
                f"residual over the heat that moved {ENERGY['float32']:g} in float32, "
                f"{ENERGY['float64']:g} in float64, in 297 of 300; the others warn"
            ),
            method="the default solver, and one other",
            measure=energy,
        ),
        Case(
            id="R2",
            title="surface temperatures lie within the bounds of the problem",
            source=(
                "maximum principle: start and forcings; a flux q adds q / h to the "
                "temperature of the air, a source q t / (rho c)"
            ),
            requirement=f"to {OVERSHOOT:g} of their range, in all",
            method="the default solver, and one other",
            measure=bounds,
        ),
        Case(
            id="R3",
            title="the stated error in time is honest",
            source="a run in float64 by steps a quarter as long",
            requirement=(
                "stated >= true in 295 of 300, stated <= 10 x true + 2 mK in 270"
            ),
            method="the default solver",
            measure=error_in_time,
        ),
    )


def _count(scenes: list[Scene], missed: set[int], allowed: int) -> Check:
    """The number of scenes that keep a limit, which `allowed` of 300 may miss."""
    within = len(scenes) - len(missed)
    lowest = len(scenes) - allowed * len(scenes) // SCENES
    return Check("scenes", within, lowest=lowest)


def _states_enough(row: SceneRow) -> bool:
    return row["stated_error"] >= row["true_error"]


def _states_little(row: SceneRow) -> bool:
    return row["stated_error"] <= FACTOR * row["true_error"] + MARGIN
