"""A sweep from its config to its rows: errors in parallel, then times one by one."""

import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from calibrate.problem.reference import program_hash
from calibrate.runs.case import Case
from calibrate.runs.evaluate import MAX_TOGETHER, Row
from calibrate.runs.pool import Pool, Task, open_pool
from calibrate.runs.rows import Rows, claim_folder
from calibrate.runs.times import time_case
from calibrate.runs.truth import find_truth
from jaxthermo.atomic import replacing
from jaxthermo.errors import InputError
from jaxthermo.parallel.devices import check_devices, check_shared

from .config import OptunaSampling, SweepConfig, load_sweep, sweep_hash, to_yaml
from .fits import check_fit, with_fit
from .points import Choice, Study, cases_of, choices


@dataclass(frozen=True)
class Options:
    """Options of the command, none of which changes an error."""

    workers: int = 1
    scheduler: str | None = None
    retry: bool = False
    times: bool = True
    devices: int = 1

    @property
    def pool(self) -> tuple[int, str | None, int]:
        """Workers, scheduler and devices."""
        return self.workers, self.scheduler, self.devices


class Log:
    """Progress of a sweep; this one is silent."""

    def stage(self, text: str, done: int = 0, total: int | None = None) -> None:
        """Begin a stage of `total` cases, of which some are done."""

    def advance(self, count: int) -> None:
        """Finish some cases of the stage."""

    def line(self, text: str) -> None:
        """Tell of something that is done, or went wrong."""


@dataclass
class Sweep:
    """A sweep in its folder, with the rows that it has so far."""

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
        found: dict[tuple[tuple[str, str], ...], list[Case]] = {}
        for case in self.cases:
            found.setdefault(case.names, []).append(case)
        return found


def run_sweep(
    path: Path, folder: Path, overrides: Sequence[str], options: Options, log: Log
) -> Sweep:
    """Run what is missing of a sweep.

    Raises:
        InputError: for a mistake in the config, a folder of another config, or a
            scheduler or disk that fails; finished rows are kept.
        KeyboardInterrupt: saying how to go on.
    """
    config = load_sweep(path, overrides)
    log.stage("reading the config")
    chosen = choices(config)
    for choice in chosen:
        check_fit(config, choice)
    # All mistakes, before the folder is made and anything is fitted.
    cases = [case for choice in chosen for case in _cases(path, config, choice)]
    sweep = Sweep(config=config, hash=sweep_hash(config), folder=folder, cases=cases)
    _check_devices(sweep, options.devices)
    claim_folder(folder, sweep.hash)
    if any(choice.fit is not None for choice in chosen):
        sweep.cases = list(_fitted_cases(path, sweep=sweep, chosen=chosen, log=log))
    with replacing(folder / "config.yaml") as temporary:
        temporary.write_text(to_yaml(config), encoding="utf-8")
    try:
        _errors(path, sweep=sweep, options=options, log=log)
        if options.times:
            _times(sweep, options, log)
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
    path: Path, sweep: Sweep, chosen: list[Choice], log: Log
) -> Iterator[Case]:
    """Cases of choices, those with a fit with its weights."""
    for choice in chosen:
        if choice.fit is not None:
            log.stage(f"fit of {', '.join(label for _, label in choice.labels)}")
        yield from _cases(
            path, sweep.config, with_fit(sweep.config, choice, sweep.folder)
        )


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


def _errors(path: Path, sweep: Sweep, options: Options, log: Log) -> None:
    rows = Rows(sweep.folder / "rows.jsonl", program_hash())
    try:
        if options.retry and (dropped := rows.drop_failed()):
            log.line(f"{dropped} failed cases are run again")
        sweep.rows = rows.by_id
        evaluator = _Evaluator(sweep=sweep, rows=rows, options=options, log=log)
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
    log: Log

    def run(self, cases: Sequence[Case]) -> None:
        missing = [case for case in cases if case.id not in self.rows.by_id]
        if not missing:
            return
        self._find_truths(missing)
        self.log.stage("errors", len(cases) - len(missing), len(cases))
        with open_pool(*self.options.pool) as pool:
            self._run(cases, pool)

    def _find_truths(self, missing: Iterable[Case]) -> None:
        # In this process, one after the other: each may fill the memory.
        for case in {case.truth_key: case for case in missing}.values():
            self.log.stage(f"reference of {case.load}")
            find_truth(case, lambda text, case=case: self.log.line(
                f"reference of {case.load}: {text}"
            ))  # fmt: skip

    def _run(self, cases: Sequence[Case], pool: Pool) -> None:
        tasks = [
            Task(group, {case.load: find_truth(case, self.log.line) for case in group})
            for group in groups(cases)
            if any(case.id not in self.rows.by_id for case in group)
        ]
        pictures = self.sweep.folder / "pictures"
        pictures.mkdir(exist_ok=True)
        for task, results in pool(tasks):
            made = []
            for case, (row, picture) in zip(task.cases, results, strict=True):
                if case.id in self.rows.by_id:
                    continue
                if picture is not None:
                    with replacing(pictures / f"{case.id}.png") as temporary:
                        temporary.write_bytes(picture)
                    row = {**row, "picture": f"pictures/{case.id}.png"}
                else:
                    names = ", ".join(label for _, label in case.names)
                    self.log.line(f"{names}, {case.load}: failed: {row['failed']}")
                made.append(row)
            self.rows.append(made)
            self.log.advance(len(made))

    def study(self, path: Path, sampling: OptunaSampling) -> None:
        config, asked = self.sweep.config, 0
        study = Study(config, sampling)
        with open_pool(*self.options.pool) as pool:
            while asked < sampling.count:
                batch = study.ask(min(sampling.batch, sampling.count - asked))
                asked += len(batch)
                cases = [
                    (
                        trial,
                        _cases(
                            path, config, with_fit(config, choice, self.sweep.folder)
                        ),
                    )
                    for trial, choice in batch
                ]
                every = [case for _, own in cases for case in own]
                self._find_truths(c for c in every if c.id not in self.rows.by_id)
                # Cases, as they are counted while they finish.
                done, loads = asked - len(batch), len(config.loads)
                self.log.stage("errors", loads * done, loads * sampling.count)
                self._run(every, pool)
                known = {case.id for case in self.sweep.cases}
                self.sweep.cases += [case for case in every if case.id not in known]
                for trial, own in cases:
                    found = [self.rows.by_id[case.id] for case in own]
                    study.tell(trial, worst_percent(found), _work(found))


def groups(cases: Sequence[Case]) -> Iterator[tuple[Case, ...]]:
    """Cases that may run in one program, the same however many have rows."""
    # A sweep that is resumed must group as one that was left alone: the errors of a
    # case then have the same rounding.
    found: dict[str, list[Case]] = {}
    for case in {case.id: case for case in cases}.values():
        # Another material has another reference, though its arrays are of one shape.
        key = f"{case.load} {case.truth_key} {case.shape_key}"
        found.setdefault(key, []).append(case)
    for group in found.values():
        for first in range(0, len(group), MAX_TOGETHER):
            yield tuple(group[first : first + MAX_TOGETHER])


def worst_percent(rows: Sequence[Row]) -> float | None:
    """Error of a choice: the largest over its loads [%]; None if one failed."""
    found = [row.get("error", {}).get("worst_rms_percent") for row in rows]
    return None if None in found else max(found)


def _work(rows: Sequence[Row]) -> float:
    """Largest number of nodes times steps."""
    return max(float(row.get("nodes", 0)) * row.get("steps", 0) for row in rows)


def _times(sweep: Sweep, options: Options, log: Log) -> None:
    finished = [c for c in sweep.cases if "error" in sweep.rows.get(c.id, {})]
    # Choices of one resolution and load share their full volume and their voxels.
    finished.sort(key=lambda case: _voxels(case))
    rows = Rows(sweep.folder / "times.jsonl", program_hash())
    try:
        if options.retry:
            rows.drop_failed()
        sweep.times = rows.by_id
        count = sum(case.id in rows.by_id for case in finished)
        log.stage("times", count, len(finished))
        for alike in _alike(finished, sweep.rows):
            missing = [case for case in alike if case.id not in rows.by_id]
            if missing:
                found = _timed(alike[0], sweep.config.repeats)
                rows.append([_time_of(case, alike[0], found) for case in missing])
                log.advance(len(missing))
    finally:
        rows.close()


def _alike(cases: Sequence[Case], rows: Mapping[str, Row]) -> list[list[Case]]:
    """Loads of a choice whose runs differ in numbers only, and so take the same time.

    One whose loop has no size of its own is timed alone.
    """
    found: dict[str, list[Case]] = {}
    for case in cases:
        size = rows[case.id].get("loop_size") or case.id
        found.setdefault(f"{case.names} {case.shape_key} {size}", []).append(case)
    return list(found.values())


def _time_of(case: Case, timed: Case, found: Row) -> Row:
    """The row of a case, of the times of one that takes the same."""
    row = {**found, "id": case.id, "load": case.load}
    return row if case is timed else {**row, "timed_as": timed.id}


def _voxels(case: Case) -> str:
    fields = ("mesh", "shape", "pitch", "voxels_high", "surface_cells")
    own = [[str(getattr(body, name)) for name in fields] for body in case.config.bodies]
    return f"{own} {case.load}"


def _timed(case: Case, repeats: int) -> Row:
    try:
        return time_case(case, repeats)
    except Exception as error:
        # A time that cannot be measured must not end those of the others.
        return {**case.head, "failed": f"{type(error).__name__}: {error}"[:500]}


def median_loop(row: Row | None) -> float | None:
    """Run time of a case [s]: the median of its loop."""
    return None if row is None or "failed" in row else statistics.median(row["loop_s"])
