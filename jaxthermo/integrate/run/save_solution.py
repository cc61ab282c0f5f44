"""Writes `solution.npz`, which `solution_file` reads without all that runs a scene."""

from pathlib import Path
from typing import Any

import numpy as np

from ...archive import write_archive
from ...physics.radiation.irradiation import Irradiance
from ...scene.scene import SURFACE_OUTPUTS
from .solution import Solution
from .solution_file import (
    FORMAT_VERSION,
    KIND,
    RunArrays,
    StoredSolution,
    body_arrays,
)


def save_solution(path: Path, solution: Solution) -> StoredSolution:
    """Write a solution with its energies in one step; return what is read again.

    Raises:
        InputError: if the file cannot be written.
    """
    rows = [solution.irradiance(k) for k in range(len(solution.times))]
    irradiance = Irradiance(
        *(
            np.stack([np.asarray(a) for a in column])
            for column in zip(*rows, strict=True)
        )
    )
    arrays: dict[str, Any] = {
        name: getattr(solution, name) for name in RunArrays._fields[:3]
    }
    arrays["irradiance"] = irradiance.thermal
    arrays["irradiance_sources"] = irradiance.sources
    arrays["source_spectrum"] = irradiance.spectrum
    arrays["stored_J"] = solution.energy.stored_J
    # Optional outputs of the scene.
    for name in (*SURFACE_OUTPUTS, "probe_temperature"):
        if getattr(solution, name) is not None:
            arrays[name] = getattr(solution, name)
    if solution.probes:
        arrays["probe_position"] = [probe.position for probe in solution.probes]
    for name, heat in solution.energy.mechanisms.items():
        arrays[f"energy_{name}_J"] = heat
    for b, surface in enumerate(solution.surfaces):
        stored = body_arrays(surface, np.asarray(solution.times, float))
        for field, value in stored.present().items():
            arrays[f"body{b}_{field}"] = value
    write_archive(path, format_name=KIND, version=FORMAT_VERSION, arrays=arrays)
    return StoredSolution(
        times=solution.times,
        surface_temperature=solution.surface_temperature,
        surfaces=solution.surfaces,
        irradiance=irradiance,
        **{name: getattr(solution, name) for name in SURFACE_OUTPUTS},
    )
