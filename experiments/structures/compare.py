"""`experiments run structures`: every structure against the full volume."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import jax
from rich import progress
from rich.console import Console

from jaxthermo.cli.console import open_console, print_line, status
from jaxthermo.errors import InputError
from jaxthermo.provenance import processor

from ..harness.record import Record, Row, program_hash
from .claims import show_table, summarize, thesis_claims
from .config import (
    ComparedBody,
    ComparisonConfig,
    EntryConfig,
    config_hash,
    load_comparison,
    resolved,
)
from .report import Findings, write_report
from .study import Study, all_cases, case_loads
from .sweeps import equilibrium_rows, level_rows, local_rows
from .truth import Truth, with_truth


class _Steps:
    # Counts rows on a progress bar and prints each when it is done.
    def __init__(self, console: Console, bar: progress.Progress, total: int):
        self.console, self.bar = console, bar
        self.task = bar.add_task("", total=total)

    def each(self, rows: Iterable[Row], what: str) -> Iterator[Row]:
        self.bar.update(self.task, description=what)
        for row in rows:
            self.bar.advance(self.task)
            print_line(self.console, _row_in_words(row))
            yield row


def _progress(console: Console) -> progress.Progress:
    text, bar = progress.TextColumn("{task.description}"), progress.BarColumn(None)
    counts = progress.MofNCompleteColumn(), progress.TimeElapsedColumn()
    quiet = not console.is_terminal
    return progress.Progress(
        text, bar, *counts, console=console, transient=True, disable=quiet
    )


def _row_in_words(row: Row) -> str:
    names = ("body", "load", "hollow", "asked_for", "label")
    where = " ".join(str(row[name]) for name in names if name in row)
    if "refused" in row:
        return f"{row['what']}, {where}: {row['refused']}"
    texts = {
        "reference": "reference, {where}: {steps} steps, {took_s:.3g} s in all",
        "equilibrium": "equilibrium, {where}: mean {mean_K:.6f} K, uneven by "
        "{surface_range_K:.1g} K after {steps} steps",
        "levels": "levels, {where}: {nodes} nodes, "
        "error {error[worst_rms_percent]:.3g} %",
        "truth reference": "truth reference, {where}: "
        "{costs[0][nodes]} nodes, own error about {own_error[worst_rms_kelvin]:.3g} K",
        "truth": "truth, {where}: {error[worst_rms_kelvin]:.3g} K",
        "structure": "{where}: {nodes} nodes, {steps} steps in "
        "{run_time_s[median]:.3g} s, {times_faster[median]:.3g} times faster "
        "({times_faster[least]:.3g} to {times_faster[most]:.3g}), "
        "error {error[worst_rms_percent]:.3g} %",
    }
    return texts[row["what"]].format(**row, where=where)


# The modules that rows follow from; the others only draw and print them.
_MEASURING = tuple(
    Path(__file__).with_name(f"{name}.py")
    for name in ("config", "measure", "study", "sweeps", "truth")
)

_DEFAULT = Path(__file__).parents[2] / "configs" / "experiments" / "structures.yaml"


def run(
    folder: Path, config: Path | None = None, height: int | None = None
) -> dict[str, Any]:
    """Every structure of the config against the full volume, at `height` voxels.

    A run that was cut off in the same folder goes on.

    Raises:
        InputError: for a mistake in the config, or a mesh that is not there.
    """
    if config is None and not _DEFAULT.is_file():
        raise InputError(
            f"the standard comparison, {_DEFAULT}, is not installed: name a config file"
        )
    comparison = load_comparison(config or _DEFAULT, height)
    record, console = Record(folder, _MEASURING), open_console()
    studies = [Study(body, comparison, record) for body in comparison.bodies]
    with status(console, "voxelizing"):
        for study in studies:
            study.check()
    try:
        findings = _measure(console, comparison, studies)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"stopped with {len(record.rows)} rows in {record.path}; "
            "the same command goes on from there"
        ) from None
    if all("refused" in row for row in findings.rows):
        raise InputError(f"nothing could be run: {findings.rows[0]['refused']}")
    if record.reused:
        print_line(console, f"{record.reused} rows were there from an earlier run")
    host = f"{processor()}, {jax.devices()[0].device_kind}"
    with status(console, "drawing"):
        files = write_report(findings, folder, host)
    show_table(findings.lines)
    return {
        "config": resolved(comparison),
        "config_hash": config_hash(comparison),
        "program_hash": program_hash(_MEASURING),
        "seed": None,
        "table": findings.lines,
        "claims": findings.claims,
        "rows": [*findings.rows, *findings.limb_rows],
        "level_rows": findings.level_rows,
        "equilibrium_rows": findings.equilibrium_rows,
        "truth_references": findings.truth_references,
        "files": files,
    }


def _measure(
    console: Console, config: ComparisonConfig, studies: list[Study]
) -> Findings:
    # All rows first, then what follows from them: an interrupted run keeps its rows.
    claims = config.claims
    limb = _limb_study(config, studies[0].record)
    swept, even, local = [], [], []
    with _progress(console) as bar:
        steps = _Steps(console, bar, _count_rows(config, limb))
        rows = [row for study in studies for row in _rows(study, steps)]
        if claims.levels is not None:
            swept = [*steps.each(level_rows(studies[0], claims.levels), "levels")]
        if claims.equilibrium is not None:
            name = claims.equilibrium.body or studies[0].body.name
            chosen = next(s for s in studies if s.body.name == name)
            made = equilibrium_rows(chosen, claims.equilibrium.voxels_high)
            even = [*steps.each(made, "equilibrium")]
        on_limb = [] if limb is None else [*_rows(limb, steps)]
        references, found = _truths(config, studies, steps)
    rows = with_truth(rows, found)
    lines = summarize(rows, config)
    if limb is not None:
        local = local_rows(limb, on_limb)
    judged = thesis_claims(rows, lines, swept, even, local, claims.limb)
    made = rows, on_limb, swept, even, local, references
    return Findings(studies, limb, *made, lines, judged)


def _truths(
    config: ComparisonConfig, studies: list[Study], steps: _Steps
) -> tuple[list[Row], list[Row]]:
    """Rows of the runs of finer voxels, and of the structures beside them."""
    references, found = [], []
    if config.truth is None:
        return references, found
    for study in studies:
        truth, name = Truth(study, config.truth), study.body.name
        made = truth.reference_rows()
        references += steps.each(made, f"{name}, finer voxels")
        for case in truth.cases:
            found += steps.each(truth.rows(case), f"{name}, {case.label}: truth")
    return references, found


def _rows(study: Study, steps: _Steps) -> Iterator[Row]:
    references = map(study.reference_row, study.config.loads)
    for _ in steps.each(references, f"{study.body.name}, reference"):
        pass  # a row of its own in the record, but none of the comparison
    for case in all_cases(study.config):
        yield from steps.each(study.rows(case), f"{study.body.name}, {case.label}")


def _limb_study(config: ComparisonConfig, record: Record) -> Study | None:
    # Under the load that the pictures show: its local error is one of them.
    limb = config.claims.limb
    if limb is None:
        return None
    update = {
        "voxels_high": limb.voxels_high,
        "loads": (config.picture.load,),
        "structures": tuple(EntryConfig(**dict(named)) for named in limb.structures),
        "full_volume_as_links": False,
        "truth": None,
    }
    body = ComparedBody(shape=limb.shape)
    return Study(body, config.model_copy(update=update), record)


def _count_rows(config: ComparisonConfig, limb: Study | None) -> int:
    # References, every structure under its loads, and the rows of the claims.
    loads = lambda c: sum(len(case_loads(case, c)) for case in all_cases(c))
    claims, parts = config.claims, [config] * len(config.bodies)
    if limb is not None:
        parts.append(limb.config)
    total = sum(len(part.loads) + loads(part) for part in parts)
    if config.truth is not None:
        # References, the full volume and the structures, under every load.
        here = (2 + len(config.structures)) * len(config.loads)
        total += here * len(config.bodies)
    if claims.levels is not None:
        total += (len(claims.levels.counts) + 1) * len(claims.levels.hollow)
    if claims.equilibrium is not None:
        total += len(all_cases(config))
    return total
