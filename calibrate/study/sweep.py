"""A sweep from its config to its rows: errors in parallel, then times one by one."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from jaxthermo.atomic import replacing, write_text
from jaxthermo.config.loader import to_yaml
from jaxthermo.errors import InputError
from jaxthermo.parallel.devices import check_devices, check_shared
from jaxthermo.progress import Progress

from ..problem.reference import program_hash
from .case import Case
from .config import OptunaSampling, SweepConfig, load_sweep, sweep_hash
from .evaluate import MAX_TOGETHER, find_truth
from .fits import check_fit, with_fit
from .points import Choice, Study, cases_of, choices
from .pool import Pool, Task, open_pool
from .rows import Row, Rows, claim_folder
from .times import time_case


@dataclass(frozen=True)
class Options:
    """Options of the command, which do not change errors."""

    workers: int = 1
    scheduler: str | None = None
    retry: bool = False
    times: bool = True
    devices: int = 1

    def open_pool(self) -> AbstractContextManager[Pool]:
        """Processes that evaluate cases."""
        return open_pool(self.workers, scheduler=self.scheduler, devices=self.devices)


@dataclass
class Sweep:
    """A sweep in its folder, with its rows so far."""

    config: SweepConfig
    hash: str
    folder: Path
    cases: list[Case] = field(default_factory=list)
    """All cases, in the order of choices and loads."""
    rows: dict[str, Row] = field(default_factory=dict)
    """Rows of errors by the id of the case."""
    times: dict[str, Row] = field(default_factory=dict)
    """Rows of times by the id of the case."""

    @property
    def choices(self) -> dict[tuple[tuple[str, str], ...], list[Case]]:
        """Cases of each choice."""
        cases_by_choice: dict[tuple[tuple[str, str], ...], list[Case]] = {}
        for case in self.cases:
            cases_by_choice.setdefault(case.names, []).append(case)
        return cases_by_choice


def run_sweep(
    path: Path,
    folder: Path,
    overrides: Sequence[str],
    options: Options,
    progress: Progress,
) -> Sweep:
    """Run the missing cases of a sweep.

    Raises:
        InputError: for a mistake in the config, a folder of another config, or a
            scheduler or disk that fails; finished rows are kept.
        KeyboardInterrupt: with the way to continue.
    """
    config = load_sweep(path, overrides)
    progress.stage("reading the config")
    all_choices = choices(config)
    for choice in all_choices:
        check_fit(config, choice)
    # Report all mistakes before anything is written or fitted.
    cases = [
        case
        for choice in all_choices
        for case in _cases(path, config=config, choice=choice)
    ]
    sweep = Sweep(config=config, hash=sweep_hash(config), folder=folder, cases=cases)
    _check_devices(sweep, options.devices)
    claim_folder(folder, sweep.hash)
    if any(choice.fit is not None for choice in all_choices):
        sweep.cases = list(
            _fitted_cases(path, sweep=sweep, all_choices=all_choices, progress=progress)
        )
    write_text(folder / "config.yaml", to_yaml(config))
    try:
        _errors(path, sweep=sweep, options=options, progress=progress)
        if options.times:
            _times(sweep, options=options, progress=progress)
    except KeyboardInterrupt:
        done = len(sweep.rows)
        count = _count(sweep)
        raise KeyboardInterrupt(
            f"stopped: {done} of {count} cases are in {folder / 'rows.jsonl'}, and the "
            "same command goes on from there"
        ) from None
    return sweep


def _check_devices(sweep: Sweep, devices: int) -> None:
    check_devices(devices)
    # A study has no cases yet.
    largest = max((len(group) for group in groups(sweep.cases)), default=devices)
    shared = (
        "cases that differ in numbers only, of which this sweep has at most "
        f"{largest} together"
    )
    check_shared(devices, largest, shared)


def _fitted_cases(
    path: Path, sweep: Sweep, all_choices: list[Choice], progress: Progress
) -> Iterator[Case]:
    """Cases of choices, with the weights of their fits."""
    for choice in all_choices:
        if choice.fit is not None:
            progress.stage(f"fit of {', '.join(label for _, label in choice.labels)}")
        fitted = with_fit(sweep.config, choice=choice, folder=sweep.folder)
        yield from _cases(path, config=sweep.config, choice=fitted)


def _count(sweep: Sweep) -> int:
    sampling = sweep.config.sampling
    if isinstance(sampling, OptunaSampling):
        return sampling.count * len(sweep.config.loads)
    return len(sweep.cases)


def _cases(path: Path, config: SweepConfig, choice: Choice) -> list[Case]:
    try:
        return cases_of(config, choice)
    except InputError as error:
        # The changes are those of the config, not of the command line.
        lines = (line.removeprefix("--set ") for line in str(error).splitlines())
        raise InputError("\n".join(f"{path}: {line}" for line in lines)) from error


def _errors(path: Path, sweep: Sweep, options: Options, progress: Progress) -> None:
    rows = Rows(sweep.folder / "rows.jsonl", program_hash())
    try:
        if options.retry and (dropped := rows.drop_failed()):
            progress.line(f"{dropped} failed cases are run again")
        sweep.rows = rows.by_id
        evaluator = _Evaluator(
            sweep=sweep, rows=rows, options=options, progress=progress
        )
        sampling = sweep.config.sampling
        if isinstance(sampling, OptunaSampling):
            evaluator.study(path, sampling)
        else:
            evaluator.run(sweep.cases)
    finally:
        rows.close()


@dataclass
class _Evaluator:
    # Runs cases that have no row yet.
    sweep: Sweep
    rows: Rows
    options: Options
    progress: Progress

    def run(self, cases: Sequence[Case]) -> None:
        missing = [case for case in cases if case.id not in self.rows.by_id]
        if not missing:
            return
        self._find_truths(missing)
        done = len(cases) - len(missing)
        self.progress.stage("errors", done=done, total=len(cases))
        with self.options.open_pool() as pool:
            self._run(cases, pool)

    def _find_truths(self, missing: Iterable[Case]) -> None:
        # In this process, one after the other: each may fill the memory.
        for case in {case.truth_key: case for case in missing}.values():
            self.progress.stage(f"reference of {case.load}")
            find_truth(case, partial(self._announce, case.load))

    def _announce(self, load: str, text: str) -> None:
        self.progress.line(f"reference of {load}: {text}")

    def _run(self, cases: Sequence[Case], pool: Pool) -> None:
        tasks = []
        for group in groups(cases):
            if any(case.id not in self.rows.by_id for case in group):
                truths = {
                    case.load: find_truth(case, self.progress.line) for case in group
                }
                tasks.append(Task(group, truths))
        pictures = self.sweep.folder / "pictures"
        pictures.mkdir(exist_ok=True)
        for task, results in pool(tasks):
            new_rows = []
            for case, (row, picture) in zip(task.cases, results, strict=True):
                if case.id in self.rows.by_id:
                    continue
                if picture is not None:
                    with replacing(pictures / f"{case.id}.png") as temporary:
                        temporary.write_bytes(picture)
                    row = {**row, "picture": f"pictures/{case.id}.png"}
                else:
                    names = ", ".join(label for _, label in case.names)
                    self.progress.line(f"{names}, {case.load}: failed: {row['failed']}")
                new_rows.append(row)
            self.rows.append(new_rows)
            self.progress.advance(len(new_rows))

    def study(self, path: Path, sampling: OptunaSampling) -> None:
        config = self.sweep.config
        study = Study(config, sampling)
        requested = 0
        loads = len(config.loads)
        with self.options.open_pool() as pool:
            while requested < sampling.count:
                batch = study.ask(min(sampling.batch, sampling.count - requested))
                cases: list[tuple[Any, list[Case]]] = []
                for trial, choice in batch:
                    fitted = with_fit(config, choice=choice, folder=self.sweep.folder)
                    cases.append((trial, _cases(path, config=config, choice=fitted)))
                batch_cases = [case for _, of_choice in cases for case in of_choice]
                self._find_truths(c for c in batch_cases if c.id not in self.rows.by_id)
                # Progress counts cases.
                self.progress.stage(
                    "errors", done=loads * requested, total=loads * sampling.count
                )
                requested += len(batch)
                self._run(batch_cases, pool)
                earlier = {case.id for case in self.sweep.cases}
                self.sweep.cases += [
                    case for case in batch_cases if case.id not in earlier
                ]
                for trial, choice_cases in cases:
                    rows = [self.rows.by_id[case.id] for case in choice_cases]
                    study.tell(trial, error=worst_percent(rows), work=_work(rows))


def groups(cases: Sequence[Case]) -> Iterator[tuple[Case, ...]]:
    """Cases that may run in one program, whatever rows exist."""
    # A resumed sweep must group like an uninterrupted one, so that the errors of a case
    # have the same rounding.
    cases_by_shape: dict[str, list[Case]] = {}
    for case in {case.id: case for case in cases}.values():
        # Another material has another reference, though its arrays are of one shape.
        key = f"{case.load} {case.truth_key} {case.shape_key}"
        cases_by_shape.setdefault(key, []).append(case)
    for group in cases_by_shape.values():
        for first in range(0, len(group), MAX_TOGETHER):
            yield tuple(group[first : first + MAX_TOGETHER])


def worst_percent(rows: Sequence[Row]) -> float | None:
    """Error of a choice: the largest over its loads [%]; None if one failed."""
    percents = [row.get("error", {}).get("worst_rms_percent") for row in rows]
    return None if None in percents else max(percents)


def _work(rows: Sequence[Row]) -> float:
    """Largest number of nodes times steps of all loads."""
    return max(float(row.get("nodes", 0)) * row.get("steps", 0) for row in rows)


def _times(sweep: Sweep, options: Options, progress: Progress) -> None:
    finished = [c for c in sweep.cases if "error" in sweep.rows.get(c.id, {})]
    # Choices of one resolution and load share their full volume and their voxels.
    finished.sort(key=_voxels)
    rows = Rows(sweep.folder / "times.jsonl", program_hash())
    try:
        if options.retry:
            rows.drop_failed()
        sweep.times = rows.by_id
        count = sum(case.id in rows.by_id for case in finished)
        progress.stage("times", done=count, total=len(finished))
        for alike in _alike(finished, sweep.rows):
            missing = [case for case in alike if case.id not in rows.by_id]
            if missing:
                timed = _timed(alike[0], sweep.config.repeats)
                rows.append([_time_of(case, alike[0], timed) for case in missing])
                progress.advance(len(missing))
    finally:
        rows.close()


def _alike(cases: Sequence[Case], rows: Mapping[str, Row]) -> list[list[Case]]:
    """Loads of a choice whose runs differ in numbers only and take the same time.

    A load whose loop has no size is timed alone.
    """
    cases_by_size: dict[str, list[Case]] = {}
    for case in cases:
        size = rows[case.id].get("loop_size") or case.id
        cases_by_size.setdefault(f"{case.names} {case.shape_key} {size}", []).append(
            case
        )
    return list(cases_by_size.values())


def _time_of(case: Case, timed: Case, times: Row) -> Row:
    """Row of a case from the times of one that takes equally long."""
    row = {**times, "id": case.id, "load": case.load}
    return row if case is timed else {**row, "timed_as": timed.id}


def _voxels(case: Case) -> str:
    fields = ("mesh", "shape", "pitch", "voxels_high", "surface_cells", "sheet")
    bodies = [
        [str(getattr(body, name)) for name in fields] for body in case.config.bodies
    ]
    return f"{bodies} {case.load}"


def _timed(case: Case, repeats: int) -> Row:
    try:
        return time_case(case, repeats)
    except Exception as error:
        # A case that cannot be timed must not end the sweep.
        return {**case.head, "failed": f"{type(error).__name__}: {error}"[:500]}
