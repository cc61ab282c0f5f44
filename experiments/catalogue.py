"""All experiments by name, and how one is run and recorded."""

import difflib
import importlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxthermo.atomic import replacing
from jaxthermo.errors import InputError
from jaxthermo.provenance import processor, provenance


@dataclass(frozen=True)
class _Experiment:
    """A measurement: a module whose `run()` gives its result in plain types.

    One with options is given them, and the folder for the files it writes besides.
    """

    module: str
    about: str
    name: str
    options: tuple[str, ...]

    @property
    def group(self) -> str:
        """The folder of its module."""
        return self.module.split(".")[0]


_ABOUT = {
    "benchmarks.stencil": "one full-volume step beside numba and a memory copy",
    "benchmarks.steps": "a step of each structure, beside its conduction and scipy",
    "benchmarks.growth": "time of a step over the number of nodes, to thirty million",
    "benchmarks.memory": "memory of a run: forecast against measured, by structure",
    "benchmarks.voxelize": "voxelizing beside trimesh at the same pitch",
    "benchmarks.mixed": "what each mechanism costs in a scene of everything",
    "benchmarks.multigrid": (
        "an implicit step and a steady state beside scipy and pyamg"
    ),
    "benchmarks.super_time_stepping": (
        "RKL2 of the full volume beside the same scheme in numba"
    ),
    "benchmarks.gradients": "a reverse-mode gradient beside its forward run",
    "thesis.counting": "how many voxels each structure has, against the thesis' counts",
    "thesis.contact": "area of contact by resolution, pruning, a ball on a head",
    "thesis.radiation": (
        "what bodies, sources and surroundings radiate: C02, C03, C04, occlusion"
    ),
    "thesis.convection": (
        "the local Nusselt number, averages, a cylinder in wind: C20, C21"
    ),
    "thesis.levels": "structures at equilibrium, their levels and holes: C11 to C14",
    "front.run": (
        "error against run time: the best choices of a sweep, beside numba and scipy"
    ),
    "front.reduction": (
        "reduced models of a sweep's best choice, as rivals on its front"
    ),
    "front.budget": (
        "how much of an error is due to voxels, structure, time and reading"
    ),
    "verification.verify": (
        "published cases and closed forms: expected, computed, tolerance, order"
    ),
    "stiff.run": "stiff and extreme cases S01 to S22 through every solver",
}
# The modules that measure several things, and have the name of what they measure.
_NAMES = {
    "verification.verify": "verification",
    "stiff.run": "stiff",
    "front.run": "front",
}
# The others take the height of their bodies, in voxels.
_OPTIONS = {
    **dict.fromkeys(("stencil", "voxelize", "counting"), ()),
    "mixed": ("config", "height"),
    "levels": ("height", "cases"),
    **dict.fromkeys(("verification", "stiff"), ("cases",)),
    **dict.fromkeys(("budget", "front", "reduction"), ("config",)),
}


def _experiment(module: str, about: str) -> _Experiment:
    name = _NAMES.get(module, module.split(".")[1].replace("_", "-"))
    return _Experiment(module, about, name, _OPTIONS.get(name, ("height",)))


# Experiments that are sweeps now, and what runs them.
_SWEEPS = {
    "structures": "front configs/sweeps/structures.yaml",
    "stepping": "front configs/sweeps/stepping.yaml",
}

EXPERIMENTS = tuple(_experiment(*item) for item in _ABOUT.items())


def find(name: str) -> tuple[_Experiment, ...]:
    """The experiment of that name, or else those of that group.

    Raises:
        InputError: if there is none.
    """
    found = tuple(e for e in EXPERIMENTS if name == e.name)
    found = found or tuple(e for e in EXPERIMENTS if name == e.group)
    if name in _SWEEPS:
        command = f"experiments run {_SWEEPS[name]}"
        raise InputError(f"{name} is the front of a sweep now: use `{command}`")
    if not found:
        names = sorted({n for e in EXPERIMENTS for n in (e.name, e.group)})
        close = difflib.get_close_matches(name, names, 1)
        hint = f"did you mean {close[0]}? " if close else ""
        raise InputError(f"no experiment {name!r}: {hint}there are {', '.join(names)}")
    return found


def run(experiment: _Experiment, folder: Path, **options: Any) -> dict:
    """Run an experiment with its options and write `result.json` into `folder`.

    Raises:
        InputError: if the experiment takes no such option, a library that only
            measurements need is not installed, or the folder cannot be written.
    """
    for name in options:
        if name not in experiment.options:
            takes = ", ".join(experiment.options) or "no options"
            raise InputError(f"{name}: {experiment.name} takes {takes}; leave it out")
    # Only here: some measurements need libraries that are there for tests alone.
    try:
        module = importlib.import_module(f"experiments.{experiment.module}")
    except ModuleNotFoundError as error:
        raise InputError(
            f"{experiment.name} needs {error.name}: install jaxthermo[test]"
        ) from error
    # Before the measurement, which may take hours.
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {folder}: {error.strerror}; name a folder") from error
    given = {"folder": folder, **options} if experiment.options else {}
    found = module.run(**given)
    result = {
        "experiment": experiment.name,
        "result": found,
        **provenance(found.get("config_hash"), found.get("seed")),
        "host": processor(),
    }
    with replacing(folder / "result.json") as path:
        path.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return result
