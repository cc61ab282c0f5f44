"""All benchmarks, one after the other, on one page: `experiments run benchmarks`.

Each runs in a process of its own, under the same conditions as alone: none inherits the
threads, the memory or the findings of another, and one that fails leaves the others.
"""

import json
from collections.abc import Sequence
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from jaxthermo.atomic import replacing
from jaxthermo.console.terminal import open_console
from jaxthermo.errors import InputError
from jaxthermo.provenance import processor, provenance

from . import catalogue
from .harness.measurement import Finished, plain_table, summary, table, write
from .harness.processes import in_new_process


NAME = "benchmarks"


def run_group(
    experiments: Sequence[catalogue.Experiment],
    folder: Path,
    *,
    quick: bool = False,
    resume: bool = False,
    **options: Any,
) -> dict[str, Any]:
    """Run benchmarks into folders of their own names, and write the page of all.

    The page is written after each, with those that have ended.

    Args:
        experiments: in the order of the page.
        folder: of the page, `result.json` and the folders.
        quick: small bodies and few repeats.
        resume: keep results in the folder that are of this commit, host and size.
        options: for each of them.

    Raises:
        InputError: if one of them does not take an option, or the folder cannot be
            written.
    """
    for experiment in experiments:
        catalogue.check_options(experiment, options)
    console = open_console()
    done: list[Finished] = []
    result: dict[str, Any] = {}
    for number, experiment in enumerate(experiments, 1):
        name = experiment.name
        console.print(f"[{number}/{len(experiments)}] {name}: {experiment.about}")
        earlier = None
        if resume and not options:
            earlier = _earlier(folder / name, quick)
        done.append(
            _ended(
                experiment,
                folder=folder / name,
                earlier=earlier,
                quick=quick,
                options=options,
            )
        )
        words = done[-1].error or f"{len(done[-1].rows)} rows"
        console.print(f"{name}: {words}, {done[-1].took_s:.0f} s")
        result = _write(folder, done, quick)
    console.print(table(done).rich(), soft_wrap=False)
    console.print(summary(done), soft_wrap=False)
    return result


def _ended(
    experiment: catalogue.Experiment,
    folder: Path,
    earlier: dict[str, Any] | None,
    quick: bool,
    options: dict[str, Any],
) -> Finished:
    try:
        result = earlier or in_new_process(
            catalogue.run, experiment, folder, quick, **options
        )
    except BrokenProcessPool:
        error = "its process was killed: too little memory?"
    except InputError as refusal:
        error = str(refusal)
    except Exception as failure:  # anything that a benchmark may raise
        error = f"{type(failure).__name__}: {failure}"
    else:
        return catalogue.finished_benchmark(experiment, folder, result)
    return Finished(
        name=experiment.name,
        about=experiment.about,
        folder=folder,
        command=experiment.command,
        error=error,
    )


def _earlier(folder: Path, quick: bool) -> dict[str, Any] | None:
    """An earlier result of this commit, host and size."""
    origin = provenance()
    # Changes that are not committed have no name.
    if origin.get("commit", "+changes").endswith("+changes"):
        return None
    try:
        result = json.loads((folder / "result.json").read_text("utf-8"))
    except (OSError, ValueError):
        return None
    same = all(
        result.get(key) == origin[key] for key in ("commit", "processor", "versions")
    )
    return result if same and result.get("quick") == quick else None


def _write(folder: Path, done: Sequence[Finished], quick: bool) -> dict[str, Any]:
    origin = provenance()
    versions = origin["versions"] | catalogue.peer_versions()
    origin = {**origin, "versions": versions}
    title = "Benchmarks, quick size" if quick else "Benchmarks"
    files = write(folder, title=title, benchmarks=done, origin=origin)
    body = {
        "sentences": [summary(done)],
        "rows": plain_table(done),
        "took_s": sum(benchmark.took_s for benchmark in done),
        "files": files,
    }
    head = {"experiment": NAME, "result": body, "quick": quick}
    result = {**head, **origin, "host": processor()}
    with replacing(folder / "result.json") as path:
        path.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return result
