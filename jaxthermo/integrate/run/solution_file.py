"""Reads `solution.npz`, from which the images of a run can be drawn again."""

from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import UInt8

from ...archive import read_archive, select_arrays
from ...errors import InputError
from ...physics.radiation.irradiation import Irradiance
from ...scene.named import Probe
from ...scene.receipt_model import Receipt
from ...scene.surface_outputs import SURFACE_OUTPUTS
from .abstract_solution import SOLUTION_FILE, StoredSolution
from .plain_values import built_value
from .run_summary import RunSummary
from .solution_arrays import (
    FORMAT_VERSION,
    KIND,
    BodyArrays,
    RunArrays,
    json_content,
    solved_surface,
    stored_energy,
    stored_heat_rates,
)
from .stored_terms import stored_terms


_REMEDY = "run the simulation again"


def load_run(folder: str | Path) -> StoredSolution:
    """Read the run in a folder of `jaxthermo simulate` or of `solution.save`.

    Returns:
        The temperatures, energies and surfaces of the run, its receipt and its steps,
        which `render`, `frames`, `probe` and `surface_error` take as the solution
        itself.

    Raises:
        InputError: if the folder has no run, or one that is damaged or of another
            version.

    Example:
        >>> import tempfile
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> copper = jt.materials["copper"]
        >>> body = jt.Body(jt.FullVolume(grid), copper, temperature=350.0)
        >>> warm = jt.steady(jt.Scene((body,), (jt.Convection(10.0, 290.0),)))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     warm.save(folder)
        ...     run = jt.load_run(folder)
        >>> run.surface_temperature.shape  # times, fragments
        (1, 96)
    """
    return load_solution(Path(folder).expanduser() / SOLUTION_FILE)


def load_solution(path: Path) -> StoredSolution:
    """Read a file of a run.

    Raises:
        InputError: if it is missing, damaged, or of another version.
    """
    if not path.exists():
        raise InputError(
            f"{path}: no such file; `jaxthermo simulate` makes it when a run is done"
        )
    arrays = read_archive(
        path, format_name=KIND, version=FORMAT_VERSION, remedy=_REMEDY
    )
    try:
        return _stored_solution(arrays)
    except InputError as error:
        raise InputError(f"{path}: {error}; {_REMEDY}") from error


def _stored_solution(arrays: dict[str, np.ndarray]) -> StoredSolution:
    run = select_arrays(RunArrays, arrays)
    # Each body stores one pitch.
    count = sum(name.endswith("_pitch") for name in arrays)
    bodies = [select_arrays(BodyArrays, arrays, f"body{b}_") for b in range(count)]
    _check_names(arrays, count)
    fragments = sum(len(body.fragment_area) for body in bodies)
    if run.surface_temperature.shape[1] != fragments:
        raise InputError(
            f"surface_temperature has {run.surface_temperature.shape[1]} columns, and "
            f"its bodies have {fragments} fragments"
        )
    if not len(run.times) or (np.diff(run.times) <= 0).any():
        raise InputError("times do not increase")
    surfaces = tuple(solved_surface(body, run.times) for body in bodies)
    return StoredSolution(
        times=run.times,
        surface_temperature=run.surface_temperature,
        surfaces=surfaces,
        irradiances=Irradiance(
            run.irradiance, run.irradiance_sources, run.source_spectrum
        ),
        terms=stored_terms(json_content(run.terms, "terms")),
        mean_temperature=run.mean_temperature,
        energy=stored_energy(run),
        heat_rates=stored_heat_rates(run),
        receipt=_stored(Receipt, run.receipt, "receipt"),
        run=_stored(RunSummary, run.run, "run"),
        probes=_probes(run),
        probe_temperature=run.probe_temperature,
        **{name: getattr(run, name) for name in SURFACE_OUTPUTS},
    )


_StoredT = TypeVar("_StoredT")


def _stored(
    cls: type[_StoredT], array: UInt8[np.ndarray, " n"] | None, name: str
) -> _StoredT | None:
    """A receipt or a summary from its array; None if there is none."""
    if array is None:
        return None
    value = built_value(json_content(array, name), name)
    if not isinstance(value, cls):
        raise InputError(f"{name} is no {cls.__name__}")
    return value


def _check_names(arrays: dict[str, np.ndarray], bodies: int) -> None:
    expected_names = set(RunArrays._fields)
    expected_names |= {
        f"body{b}_{name}" for b in range(bodies) for name in BodyArrays._fields
    }
    for name in arrays.keys() - expected_names:
        raise InputError(f"{name} is no part of a solution")


def _probes(run: RunArrays) -> tuple[Probe, ...]:
    if run.probe_temperature is None:
        return ()
    if run.probe_names is None or run.probe_position is None:
        raise InputError("probe_temperature has no names or no positions")
    names = json_content(run.probe_names, "probe_names")
    if not isinstance(names, list) or len(names) != len(run.probe_position):
        raise InputError("probe_names is not one name for each position")
    return tuple(
        Probe(str(name), (x, y, z))
        for name, (x, y, z) in zip(names, run.probe_position.tolist(), strict=True)
    )
