"""The command line of the experiments: list, run and sweep; compare results."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from jaxthermo.cli.entry import Overrides, make_app, run_app
from jaxthermo.errors import InputError

from . import benchmark_group, catalogue


# Without stored programs (`entry.compiles`): compilations are measured too.
app = make_app("experiments", "Measurements that can be run again by name.")


@app.command(name="list")
def _list_all() -> None:
    """List the experiments."""
    for experiment in catalogue.EXPERIMENTS:
        sys.stdout.write(f"{experiment.name:12} {experiment.about}\n")


@app.command
def _run(
    name: str,
    config: Path | None = None,
    /,
    *,
    height: int | None = None,
    cases: str | None = None,
    out: Path | None = None,
    quick: Annotated[bool, Parameter(negative="")] = False,
    resume: Annotated[bool, Parameter(negative="")] = False,
    device: Literal["cpu", "gpu", "tpu"] | None = None,
) -> None:
    """Run an experiment, or several that share a group name.

    Args:
        name: As `list` shows it, or "benchmarks" for all of them, on one page; "thesis"
            for every table and figure of the thesis.
        config: A YAML file, for an experiment that takes one; the standard one if not
            given. For `front` the config of a sweep, or the folder of one; for `budget`
            the config of a sweep.
        height: Voxels along up, instead of the config's.
        cases: Which ones, such as S01,S06, of an experiment that has cases; of `thesis`
            exhibits or claims, such as figure-4.3,C09.
        out: The folder for result.json; results/experiments/NAME if not given.
        quick: Small bodies and few repeats, for a benchmark or all of them, and for
            `thesis`.
        resume: For "benchmarks": keep results of this commit, host and size.
        device: Where to compute; refused where JAX sees none. "benchmarks" on a GPU or
            TPU are those of `accelerator`.
    """
    if device is not None:
        catalogue.use_device(device)
    given = {"config": config, "height": height, "cases": cases}
    options = {k: v for k, v in given.items() if v is not None}
    found, default = catalogue.find(name), Path("results/experiments")
    if name == benchmark_group.NAME:
        own = catalogue.find(catalogue.ON_ACCELERATORS)
        found = tuple(each for each in found if each not in own)
        found = found if device in (None, "cpu") else own
        folder = out or default / name
        sizes = {"quick": quick, "resume": resume}
        benchmark_group.run_group(found, folder, **sizes, **options)
        sys.stdout.write(f"{folder / 'report.html'}\n")
        return
    if resume:
        raise InputError("--resume: only `run benchmarks` takes it; leave it out")
    for experiment in found:
        folder = out or default / experiment.name
        catalogue.run(experiment, folder, quick, **options)
        sys.stdout.write(f"{folder / 'result.json'}\n")


@app.command
def _compare(
    old: Path,
    new: Path,
    /,
    *,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Show what changed between two results: configs first, then numbers beyond noise.

    Args:
        old: Folder of a run, a fit, a sweep, an experiment or a reduced model, or the
            file of its results.
        new: Another one of the same kind.
        json: Print plain values instead of tables.
    """
    from .results.commands import compare_results

    compare_results(old, new, json)


@app.command
def _report(folder: Path, /) -> None:
    """Write one page of all results in a folder, index.html.

    Args:
        folder: Searched with all folders below it.
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
    retry: bool = False,
    times: bool = True,
    devices: int = 1,
    overrides: Overrides = (),
) -> None:
    """Measure error and run time over axes of a scene.

    A sweep that was interrupted or killed goes on from its last row.

    Args:
        config: The sweep, a YAML file.
        out: The folder for rows.jsonl and the rest; results/sweeps/NAME by default.
        workers: Number of processes that errors are computed in; 0 or 1 for this one,
            2 by default, and 1 with devices.
        scheduler: Address of a dask scheduler, such as tcp://10.0.0.1:8786, instead.
        retry: Run cases that failed again.
        times: Time every case after its error, one after the other.
        devices: Number of devices of this process that share cases which differ in
            numbers only; refused where no cases do.
        overrides: A value of the config to change, such as repeats=3; may be repeated.
    """
    from .sweep.command import default_workers, sweep
    from .sweep.run import Options

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
    from jaxthermo.config.json_schema import json_schema

    from .sweep.config import SweepConfig

    sys.stdout.write(json_schema(SweepConfig))


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs one command and exits: 0 if it worked, 2 for a mistake of the user."""
    run_app(app, "experiments", arguments)


if __name__ == "__main__":
    main()
