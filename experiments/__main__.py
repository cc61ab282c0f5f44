"""The command line of the experiments: list, run and sweep; compare results."""

from jaxthermo.console import interrupt as _interrupt  # noqa: F401


# isort: split
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from jaxthermo.console.entry import Flag, Overrides, make_app, run_app
from jaxthermo.errors import InputError

from . import benchmark_group, catalogue
from .harness.agreement import DisagreementError


# Exit status of a benchmark of things that are not equal.
_NOT_EQUAL = 3

# Without stored programs (`entry.compiles`): compilations are measured too.
app = make_app("experiments", "Run measurements by name, and compare their results.")


@app.command(name="list")
def _list_all() -> None:
    """List the experiments in groups."""
    width = max(len(experiment.name) for experiment in catalogue.EXPERIMENTS)
    for title, experiments in catalogue.in_groups().items():
        sys.stdout.write(f"{title}:\n")
        for experiment in experiments:
            sys.stdout.write(f"  {experiment.name:{width}}  {experiment.about}\n")


@app.command
def _run(
    name: str,
    config: Path | None = None,
    /,
    *,
    height: int | None = None,
    cases: str | None = None,
    out: Path | None = None,
    quick: Flag = False,
    resume: Flag = False,
    device: Literal["cpu", "gpu", "tpu"] | None = None,
) -> None:
    """Run an experiment, or several that share a group name.

    A benchmark whose peer gives another result exits with status 3.

    Args:
        name: Name of an experiment in `list`, "benchmarks" for all benchmarks on one
            page, or "thesis" for every table and figure of the thesis.
        config: Config of an experiment that takes one, a YAML file; the shipped config
            by default. For `front` and `budget` that of a sweep, or the folder of a
            finished one.
        height: Number of voxels along z, instead of that of the config.
        cases: Cases of an experiment that has several, such as S01,S06; for `thesis`
            exhibits or claims, such as figure-4.3,C09.
        out: Folder for result.json; results/experiments/NAME by default.
        quick: Take small bodies and few repeats, in benchmarks and in `thesis`.
        resume: Reuse the results of "benchmarks" with the same commit, host and size.
        device: Device on which to compute. On a GPU or TPU, "benchmarks" are those of
            `accelerator`.
    """
    if device is not None:
        catalogue.use_device(device)
    arguments = {"config": config, "height": height, "cases": cases}
    options = {key: value for key, value in arguments.items() if value is not None}
    experiments = catalogue.find(name)
    default = Path("results/experiments")
    if name == benchmark_group.NAME:
        on_accelerators = catalogue.find(catalogue.ON_ACCELERATORS)
        if device in (None, "cpu"):
            experiments = tuple(e for e in experiments if e not in on_accelerators)
        else:
            experiments = on_accelerators
        folder = out or default / name
        benchmark_group.run_group(
            experiments, folder, quick=quick, resume=resume, **options
        )
        sys.stdout.write(f"{folder / 'report.html'}\n")
        return
    if resume:
        raise InputError("--resume: only `run benchmarks` takes it; leave it out")
    for experiment in experiments:
        folder = out or default / experiment.name
        try:
            catalogue.run(experiment, folder, quick, **options)
        except DisagreementError as error:
            sys.stderr.write(f"experiments: {experiment.name}: {error}\n")
            sys.exit(_NOT_EQUAL)
        sys.stdout.write(f"{folder / 'result.json'}\n")


@app.command
def _compare(
    old: Path,
    new: Path,
    /,
    *,
    json: Flag = False,
) -> None:
    """Show what changed between two results beyond noise.

    Args:
        old: Folder of a run, a fit, a sweep, an experiment or a reduced model, or the
            file of its results.
        new: Another result of the same kind.
        json: Print plain values instead of tables.
    """
    from .results.commands import compare_results

    compare_results(old, new, json)


@app.command
def _report(folder: Path, /) -> None:
    """Write index.html, one page of all results in a folder.

    Args:
        folder: Folder with results, at any depth.
    """
    from .results.commands import report_results

    report_results(folder)


@app.command
def _sweep(
    config: Path,
    /,
    *,
    out: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    retry: Flag = False,
    times: bool = True,
    devices: int = 1,
    overrides: Overrides = (),
) -> None:
    """Measure error and run time over axes of a scene.

    The same command continues an interrupted sweep from its last row.

    Args:
        config: Sweep, a YAML file.
        out: Folder for rows.jsonl and the other results; results/sweeps/NAME by
            default.
        workers: Number of processes that compute errors, 0 or 1 for this process alone;
            by default 2, and 1 with devices.
        scheduler: Address of a dask scheduler, such as tcp://10.0.0.1:8786, instead of
            workers.
        retry: Run failed cases again.
        times: Time every case after its error, one after the other.
        devices: Number of devices of this process that share cases which differ in
            numbers only; refused where no cases do.
        overrides: Value of the config to change, such as repeats=3; may be repeated.
    """
    from calibrate.study.command import default_workers, sweep
    from calibrate.study.sweep import Options

    default = default_workers() if devices == 1 else 1
    count = default if workers is None else workers
    options = Options(
        workers=count, scheduler=scheduler, retry=retry, times=times, devices=devices
    )
    folder = out or Path("results/sweeps") / config.stem
    sweep(config, out=folder, overrides=overrides, options=options)


@app.command
def _schema() -> None:
    """Print the JSON Schema of a sweep's config, with units, for editors."""
    from calibrate.study.config import SweepConfig
    from jaxthermo.config.json_schema import json_schema

    sys.stdout.write(json_schema(SweepConfig))


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs one command and exits: 0 if it worked, 2 for a mistake of the user."""
    run_app(app, "experiments", arguments)


if __name__ == "__main__":
    main()
