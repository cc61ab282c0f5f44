"""`experiments run structures`: measures, and writes tables, plots and pictures."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
from rich.console import Console

from jaxthermo.cli.console import doing, open_console, tell
from jaxthermo.errors import InputError

from .cases import all_cases, case_loads
from .claims import equilibrium_claim, levels_claim, limb_claim
from .claims_table import capacity_claim, path_claim, speed_claims
from .config import (
    ComparedBody,
    ComparisonConfig,
    EntryConfig,
    config_hash,
    load_comparison,
    resolved,
)
from .equilibrium import Equilibrium
from .levels import level_rows
from .local import local_rows
from .progress import Steps, counted
from .record import Record, Row, program_hash
from .report import Findings, write_report
from .study import Study
from .summary import summarize
from .tables import show_table


DEFAULT = Path(__file__).parents[2] / "configs" / "experiments" / "structures.yaml"


def run(
    folder: Path, config: Path | None = None, height: int | None = None
) -> dict[str, Any]:
    """Every structure of the config against the full volume.

    Args:
        folder: for the results; a run that was cut off there goes on.
        config: a YAML file; the standard comparison if not given.
        height: voxels along up, instead of the config's.

    Raises:
        InputError: for a mistake in the config, or a mesh that is not there.
    """
    if config is None and not DEFAULT.is_file():
        raise InputError(
            f"the standard comparison, {DEFAULT}, is not installed: name a config file"
        )
    comparison = load_comparison(config or DEFAULT, height)
    record, console = Record(folder), open_console()
    studies = [Study(body, comparison, record) for body in comparison.bodies]
    with doing(console, "voxelizing"):
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
        tell(console, f"{record.reused} rows were there from an earlier run")
    with doing(console, "drawing"):
        files = write_report(findings, folder, host())
    show_table(console, findings.lines)
    return {
        "config": resolved(comparison),
        "config_hash": config_hash(comparison),
        "program_hash": program_hash(),
        "seed": None,
        "table": findings.lines,
        "claims": findings.claims,
        "rows": [*findings.rows, *findings.limb_rows],
        "level_rows": findings.level_rows,
        "equilibrium_rows": findings.equilibrium_rows,
        "files": files,
    }


def host() -> str:
    """What it ran on."""
    device = jax.devices()[0]
    return f"{os.cpu_count()} cores, {device.device_kind}"


def _measure(
    console: Console, config: ComparisonConfig, studies: list[Study]
) -> Findings:
    """All rows and what follows from them, with a bar on a terminal."""
    claims = config.claims
    limb = limb_study(config, studies[0].record)
    with counted(console, count_rows(config, limb)) as steps:
        rows = [row for study in studies for row in _rows(study, steps)]
        swept, even = [], []
        if claims.levels is not None:
            swept = list(steps.each(level_rows(studies[0], claims.levels), "levels"))
        if claims.equilibrium is not None:
            name = claims.equilibrium.body or studies[0].body.name
            chosen = next(s for s in studies if s.body.name == name)
            made = Equilibrium(chosen, claims.equilibrium).rows()
            even = list(steps.each(made, "equilibrium"))
        on_limb = [] if limb is None else list(_rows(limb, steps))
    lines = summarize(rows, config)
    local = [] if limb is None else local_rows(limb, on_limb)
    return Findings(
        studies=studies,
        limb=limb,
        rows=rows,
        limb_rows=on_limb,
        level_rows=swept,
        equilibrium_rows=even,
        local=local,
        lines=lines,
        claims=[
            *speed_claims(lines),
            *equilibrium_claim(even),
            *path_claim(lines),
            *levels_claim(swept),
            *(limb_claim(local, claims.limb) if claims.limb else ()),
            *capacity_claim(rows),
        ],
    )


def _rows(study: Study, steps: Steps) -> Iterator[Row]:
    for _ in steps.each(study.reference_rows(), f"{study.body.name}, reference"):
        pass
    for case in all_cases(study.config):
        yield from steps.each(study.rows(case), f"{study.body.name}, {case.label}")


def limb_study(config: ComparisonConfig, record: Record) -> Study | None:
    """The body with thin limbs, under the load that the pictures show."""
    limb = config.claims.limb
    if limb is None:
        return None
    update = {
        "voxels_high": limb.voxels_high,
        "loads": (config.picture.load,),
        "structures": tuple(EntryConfig(**dict(named)) for named in limb.structures),
        "full_volume_as_links": False,
    }
    return Study(
        ComparedBody(shape=limb.shape), config.model_copy(update=update), record
    )


def count_rows(config: ComparisonConfig, limb: Study | None) -> int:
    """How many rows there will be."""
    claims = config.claims
    total = len(config.bodies) * count_body_rows(config)
    if claims.levels is not None:
        total += (len(claims.levels.counts) + 1) * len(claims.levels.hollow)
    if claims.equilibrium is not None:
        total += len(all_cases(config))
    return total + (0 if limb is None else count_body_rows(limb.config))


def count_body_rows(config: ComparisonConfig) -> int:
    """References, and every structure under its loads."""
    each = (len(case_loads(case, config)) for case in all_cases(config))
    return len(config.loads) + sum(each)
