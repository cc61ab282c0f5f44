"""All experiments by name, and how one is run and recorded."""

import difflib
import importlib
import json
import os
import platform
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax

from jaxthermo.atomic import replacing
from jaxthermo.errors import InputError


@dataclass(frozen=True)
class Experiment:
    """A measurement: a module whose `run()` gives its result in plain types.

    One with options is given them, and the folder for the files it writes besides.
    """

    name: str
    module: str
    group: str
    about: str
    options: tuple[str, ...] = ()


EXPERIMENTS = (
    Experiment(
        "stencil",
        "experiments.benchmarks.stencil",
        "benchmarks",
        "one full-volume step beside numba and a memory copy",
    ),
    Experiment(
        "voxelize",
        "experiments.benchmarks.voxelize",
        "benchmarks",
        "voxelizing beside trimesh at the same pitch",
    ),
    Experiment(
        "mixed",
        "experiments.benchmarks.mixed",
        "benchmarks",
        "what each mechanism costs in a scene of everything",
        options=("config", "height"),
    ),
    Experiment(
        "multigrid",
        "experiments.benchmarks.multigrid",
        "benchmarks",
        "an implicit step and a steady state beside scipy and pyamg",
        options=("height",),
    ),
    Experiment(
        "stepping",
        "experiments.benchmarks.stepping",
        "benchmarks",
        "work to a given error in time: every solver against the explicit loop",
        options=("height",),
    ),
    Experiment(
        "super-time-stepping",
        "experiments.benchmarks.super_time_stepping",
        "benchmarks",
        "RKL2 of the full volume beside the same scheme in numba",
        options=("height",),
    ),
    Experiment(
        "gradients",
        "experiments.benchmarks.gradients",
        "benchmarks",
        "a reverse-mode gradient beside its forward run",
        options=("height",),
    ),
    Experiment(
        "counting",
        "experiments.thesis.counting",
        "thesis",
        "how many voxels each structure has, against the thesis' counts",
    ),
    Experiment(
        "contact",
        "experiments.thesis.contact",
        "thesis",
        "area of contact by resolution, pruning, a ball on a head",
        options=("height",),
    ),
    Experiment(
        "radiation",
        "experiments.thesis.radiation",
        "thesis",
        "what bodies, sources and surroundings radiate: C02, C03, C04, occlusion",
        options=("height",),
    ),
    Experiment(
        "convection",
        "experiments.thesis.convection",
        "thesis",
        "the local Nusselt number, averages, a cylinder in wind: C20, C21",
        options=("height",),
    ),
    Experiment(
        "structures",
        "experiments.structures.compare",
        "structures",
        "every structure against the full volume: cost, error, pictures",
        options=("config", "height"),
    ),
    Experiment(
        "verification",
        "experiments.verification.verify",
        "verification",
        "published cases and closed forms: expected, computed, tolerance, order",
        options=("cases",),
    ),
    Experiment(
        "stiff",
        "experiments.stiff.run",
        "verification",
        "stiff and extreme cases S01 to S22 through every solver",
        options=("cases",),
    ),
)


def find(name: str) -> tuple[Experiment, ...]:
    """The experiment of that name, or else those of that group.

    Raises:
        InputError: if there is none.
    """
    found = tuple(e for e in EXPERIMENTS if name == e.name)
    found = found or tuple(e for e in EXPERIMENTS if name == e.group)
    if not found:
        names = sorted({e.name for e in EXPERIMENTS} | {e.group for e in EXPERIMENTS})
        close = difflib.get_close_matches(name, names, 1)
        hint = f"did you mean {close[0]}? " if close else ""
        raise InputError(f"no experiment {name!r}: {hint}there are {', '.join(names)}")
    return found


def run(experiment: Experiment, folder: Path, **options: Any) -> dict:
    """Run an experiment and write `result.json` into `folder`.

    Args:
        experiment: which.
        folder: for the results.
        options: those that were given.

    Raises:
        InputError: if the experiment takes no such option, a library that only
            measurements need is not installed, or the folder cannot be written.
    """
    for name in options:
        if name not in experiment.options:
            takes = ", ".join(experiment.options) or "no options"
            raise InputError(f"{name}: {experiment.name} takes {takes}; leave it out")
    try:
        module = importlib.import_module(experiment.module)
    except ModuleNotFoundError as error:
        raise InputError(
            f"{experiment.name} needs {error.name}: install jaxthermo[test]"
        ) from error
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {folder}: {error.strerror}; name a folder") from error
    given = {"folder": folder, **options} if experiment.options else {}
    result = {
        "experiment": experiment.name,
        "result": module.run(**given),
        "versions": {p: version(p) for p in ("jaxthermo", "jax", "numpy")},
        "host": f"{platform.machine()}, {os.cpu_count()} cores",
        "device": jax.devices()[0].device_kind,
    }
    with replacing(folder / "result.json") as path:
        path.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return result
