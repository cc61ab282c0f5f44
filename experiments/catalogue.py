"""All experiments by name, and how one is run and recorded."""

import difflib
import importlib
import json
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import jax

from jaxthermo.atomic import replacing
from jaxthermo.errors import InputError
from jaxthermo.extras import missing_package
from jaxthermo.provenance import processor, provenance

from .harness.measurement import Finished, Measurement, table, write
from .harness.present import show


@dataclass(frozen=True)
class Experiment:
    """A measurement: a module whose `run()` gives its result in plain types.

    One with options is given them, and the folder for the files it writes besides.
    """

    module: str
    about: str
    name: str
    options: tuple[str, ...]
    cases: str = ""
    """Exhibits of the thesis that it selects, if it is a part of that experiment."""

    @property
    def group(self) -> str:
        """The folder of its module."""
        return self.module.split(".")[0]

    @property
    def command(self) -> str:
        """The command that measures it alone."""
        return f"experiments run {self.name}"


_ABOUT = {
    "benchmarks.stencil": (
        "one conduction step in the full volume, compared with numba, JAX and a copy"
    ),
    "benchmarks.full_volume": (
        "explicit steps and RKL2 with a surface in sun and air, compared with numba"
    ),
    "benchmarks.calls": (
        "a call with other numbers, compared with its loop and a full volume in numba"
    ),
    "benchmarks.octree": "the octree, compared with the full volume at the same error",
    "benchmarks.steps": "a step of each structure, compared with its conduction",
    "benchmarks.growth": "time of a step over the number of nodes, to thirty million",
    "benchmarks.memory": "memory of a run: forecast against measured, by structure",
    "benchmarks.voxelize": "voxelization, compared with trimesh at the same pitch",
    "benchmarks.mixed": "the cost of each mechanism in a scene with all of them",
    "benchmarks.accelerator": (
        "copy, conduction, structures, implicit steps, Jacobians and a frame on a GPU"
    ),
    "benchmarks.devices": (
        "a step of the full volume on several devices, compared with one"
    ),
    "benchmarks.fit_devices": (
        "the Jacobian of a step of a fit on two devices, compared with one"
    ),
    "benchmarks.multigrid": (
        "an implicit step and a steady state, compared with scipy and pyamg"
    ),
    "benchmarks.lattice_boltzmann": (
        "a step of the lattice Boltzmann flow, compared with numba and a copy"
    ),
    "benchmarks.gradients": "a reverse-mode gradient, compared with its forward run",
    "thesis.exhibition": (
        "every table and figure of the thesis, claim by claim, on one page"
    ),
    "thesis.wake_data": "mean wakes by Reynolds number and their fits, as data",
    "camera.camera_ladder": (
        "effects of a thermal camera, added one by one to a scene"
    ),
    "front.run": ("error against run time: the best choices of a sweep, and rivals"),
    "front.reduction": (
        "reduced models of the best choice of a sweep, as rivals on its front"
    ),
    "front.budget": ("parts of an error: voxels, structure, time and reading"),
    "verification.verify": (
        "published cases and closed forms: expected, computed, tolerance, order"
    ),
    "measured.run": (
        "measured temperatures outdoors, compared with runs with and without a fit"
    ),
    "stiff.run": "stiff and extreme cases S01 to S22 through every solver",
    "random_scenes.run": (
        "energy, bounds and stated error in time of 300 scenes drawn at random"
    ),
    "plans.run": "true errors of the models planned for five parts, at 10, 5 and 3 %",
}
# The modules that measure several things, and have the name of what they measure.
_NAMES = {
    "verification.verify": "verification",
    "measured.run": "measured",
    "stiff.run": "stiff",
    "random_scenes.run": "random-scenes",
    "plans.run": "plans",
    "front.run": "front",
    "thesis.exhibition": "thesis",
}
# Commands that measure exhibits of the thesis by their subject, and those exhibits.
_OF_THESIS = {
    "counting": (
        "numbers of voxels of each structure, compared with the thesis",
        "section-6.1-cubes,figure-6.2,figure-6.9,figure-6.11,table-6.1",
    ),
    "radiation": (
        "radiation of bodies, sources and surroundings: C02, C03, C04, occlusion",
        "section-5.1-flux,section-5.1-neighbours,equation-3,section-5.1-occlusion",
    ),
    "convection": (
        "the local Nusselt number, averages, a cylinder in wind: C20, C21",
        "figure-5.6,figure-5.8,section-5.4-averages,section-3-cylinders",
    ),
    "wake": (
        "the flow behind a cylinder in two channels at four speeds: C22, C23, C24",
        "figure-5.7,figure-6.4,figure-6.5,figure-6.6,figure-6.7",
    ),
    "levels": (
        "structures at equilibrium, their levels and holes: C11 to C14",
        "C11,C12,C13,C14",
    ),
}
# The others take the height of their bodies, in voxels.
_OPTIONS = {
    **dict.fromkeys(("stencil", "voxelize", "lattice-boltzmann"), ()),
    "mixed": ("config", "height"),
    **dict.fromkeys(
        ("verification", "measured", "stiff", "random-scenes", "plans", "thesis"),
        ("cases",),
    ),
    **dict.fromkeys(("budget", "front", "reduction"), ("config",)),
}


def _experiment(module: str, about: str) -> Experiment:
    name = _NAMES.get(module, module.split(".")[1].replace("_", "-"))
    return Experiment(
        module=module, about=about, name=name, options=_OPTIONS.get(name, ("height",))
    )


# Experiments that are parts of others now, and what runs them.
_PARTS = {
    "structures": "front configs/sweeps/structures.yaml",
    "stepping": "front configs/sweeps/stepping.yaml",
    "contact": "thesis --cases C17,C18,C19",
}

_PEERS = ("numba", "pyamg", "torch", "cupy")

ON_ACCELERATORS = "accelerator"
"""Name of the benchmark of GPUs and the like."""

EXPERIMENTS = (
    *(_experiment(module, about) for module, about in _ABOUT.items()),
    *(
        Experiment(
            module="thesis.exhibition",
            about=about,
            name=name,
            options=("cases",) if name == "levels" else (),
            cases=cases,
        )
        for name, (about, cases) in _OF_THESIS.items()
    ),
)


# Titles of the groups of a list, by the folders of their modules.
_TITLES = {
    "benchmarks": "benchmarks, all with `experiments run benchmarks`",
    "front": "error against run time",
    "thesis": "the thesis, all with `experiments run thesis`",
}
_OTHERS = "how true it is"


def in_groups() -> dict[str, list[Experiment]]:
    """The experiments by the title of their group."""
    groups: dict[str, list[Experiment]] = {
        title: [] for title in (*_TITLES.values(), _OTHERS)
    }
    for experiment in EXPERIMENTS:
        groups[_TITLES.get(experiment.group, _OTHERS)].append(experiment)
    return groups


def find(name: str) -> tuple[Experiment, ...]:
    """The experiment of that name, or else those of that group.

    Raises:
        InputError: if there is none.
    """
    experiments = tuple(e for e in EXPERIMENTS if name == e.name)
    experiments = experiments or tuple(e for e in EXPERIMENTS if name == e.group)
    if name in _PARTS:
        command = f"experiments run {_PARTS[name]}"
        raise InputError(f"{name} is a part of another experiment now: use `{command}`")
    if not experiments:
        names = sorted({n for e in EXPERIMENTS for n in (e.name, e.group)})
        close = difflib.get_close_matches(name, names, 1)
        hint = f"did you mean {close[0]}? " if close else ""
        raise InputError(f"no experiment {name!r}: {hint}there are {', '.join(names)}")
    return experiments


def use_device(device: str) -> None:
    """Compute on a kind of device from here on, in processes that follow too.

    Raises:
        InputError: if JAX sees none, or another first.
    """
    if device == "cpu":
        os.environ["JAX_PLATFORMS"] = device
        jax.config.update("jax_platforms", device)
    backend = jax.default_backend()
    if backend != device:
        raise InputError(
            f"--device {device}: JAX computes on {backend} here; install the JAX of "
            "that device, such as jax[cuda13], or leave it out"
        )


def check_options(experiment: Experiment, options: Mapping[str, Any]) -> None:
    """Refuse options that an experiment does not take, with an InputError."""
    for name in options:
        if name not in experiment.options:
            takes = ", ".join(experiment.options) or "no options"
            raise InputError(f"{name}: {experiment.name} takes {takes}; leave it out")


def run(
    experiment: Experiment, folder: Path, quick: bool = False, **options: Any
) -> dict[str, Any]:
    """Run an experiment with its options and write `result.json` into `folder`.

    With `quick` in the small size that its module names in `QUICK`, of which no bound
    is asked. Measurements among the result are also written as a page and a CSV file.

    Raises:
        InputError: if the experiment takes no such option, a library that only
            measurements need is not installed, or the folder cannot be written.
    """
    check_options(experiment, options)
    # Only here: some measurements need libraries that are there for tests alone.
    try:
        module = importlib.import_module(f"experiments.{experiment.module}")
    except ModuleNotFoundError as error:
        raise missing_package(
            f"{experiment.name} needs", package=str(error.name), extra="test"
        ) from error
    # Before the measurement, which may take hours.
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {folder}: {error.strerror}; name a folder") from error
    sizes = getattr(module, "QUICK", None) if quick else {}
    if sizes is None:
        raise InputError(f"--quick: {experiment.name} has no quick size; leave it out")
    arguments: dict[str, Any] = {**sizes, **options}
    if experiment.options or experiment.cases:
        arguments["folder"] = folder
    if experiment.cases:
        arguments.setdefault("cases", experiment.cases)
    clock = time.perf_counter()
    body = module.run(**arguments)
    result = {
        "experiment": experiment.name,
        "result": body,
        **provenance(body.get("config_hash"), body.get("seed")),
        "host": processor(),
        "quick": quick,
        "took_s": round(time.perf_counter() - clock, 1),
    }
    if "measurements" in body:
        if quick:
            # They are asked of the bodies that the full size measures.
            for row in body["measurements"]:
                row["bound"] = None
        result["versions"] |= peer_versions()
        _write_page(experiment, folder, result)
    with replacing(folder / "result.json") as path:
        path.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return result


def peer_versions() -> dict[str, str]:
    """Versions of the libraries that only benchmarks use, of those installed."""
    versions = {}
    for name in _PEERS:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return versions


def finished_benchmark(
    experiment: Experiment, folder: Path, result: Mapping[str, Any]
) -> Finished:
    """A benchmark that has ended with a result, the whole of its `result.json`."""
    body = result["result"]
    rows = tuple(Measurement(**row) for row in body.get("measurements", ()))
    error = "" if rows else "no measurement in the form of this table: see result.json"
    return Finished(
        name=experiment.name,
        about=experiment.about,
        folder=folder,
        command=experiment.command,
        rows=rows,
        error=error,
        charts=tuple(body.get("charts", {}).items()),
        took_s=float(result.get("took_s", 0.0)),
    )


def _write_page(experiment: Experiment, folder: Path, result: dict[str, Any]) -> None:
    done = [finished_benchmark(experiment, folder, result)]
    show(table(done))
    files = write(
        folder, title=f"Benchmark: {experiment.name}", benchmarks=done, origin=result
    )
    body = result["result"]
    body["files"] = [*files, *body.get("files", ())]
