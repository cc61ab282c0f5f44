"""Results of a run for other programs: `summary.json` and CSV files."""

import resource
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from ..arrays import consecutive
from ..config.loader import config_hash, resolved
from ..config.schema.scene import SceneConfig
from ..geometry.mesh import describe_mesh
from ..integrate.energy import Energy, HeatRates
from ..integrate.ledger import pair_name
from ..integrate.run.solution import RESULTS, Solution, SteadySolution
from ..integrate.solver_statistics import SolverStatistics
from ..provenance import provenance
from ..report.columns import write_columns
from ..scene.air import bodies_around_air, bodies_with_surface
from ..scene.body_mass import body_mass
from ..scene.compile.body_names import body_labels
from ..scene.scene import Scene
from ..structures.report import StructureReport


def peak_memory() -> int:
    """Peak memory of this process so far [bytes]."""
    # Linux counts in KiB, macOS in bytes.
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def _balance(solution: Solution | SteadySolution) -> Energy | HeatRates:
    if isinstance(solution, SteadySolution):
        return solution.heat_rates
    return solution.energy


def _as_lists(balance: Energy | HeatRates) -> dict[str, list[float]]:
    return {name: column.tolist() for name, column in _columns(balance).items()}


class _TermResults(TypedDict):
    """Area and volume that one mechanism acts on, in `summary.json`; its heat rate."""

    mechanism: str
    bodies: list[int]
    body_names: list[str]
    """Empty names for bodies without one."""
    area_m2: float
    volume_m3: float
    mean_heat_rate_W: float | None
    """Mean of the run, or that of a steady state; from the first to the second of two
    bodies. None if the run has no length."""


class _BodyResults(TypedDict):
    """Results of one body in `summary.json`; lists are over the saved times."""

    name: str
    """Empty for a body without a name."""
    mesh: Mapping[str, Any]
    mass_kg: float
    volume_m3: float
    area_m2: float
    energy: dict[str, list[float]]
    surface_temperature_K: dict[str, list[float]]
    """Minimum, mean and maximum over the surface [K]."""
    mean_temperature_K: list[float]
    """Mean over the volume [K]."""


class _AirResults(TypedDict):
    """Results of the air in a body in `summary.json`; lists are over saved times."""

    inside_body: int
    number: int
    """Number of the air as a body, after all that have a surface."""
    mass_kg: float
    volume_m3: float
    energy: dict[str, list[float]]
    temperature_K: list[float]


class _ProbeResults(TypedDict):
    """Results of one probe in `summary.json`."""

    position_m: list[float]
    temperature_K: list[float]
    """Temperature at each saved time [K]."""


def _air(
    scene: Scene, solution: Solution | SteadySolution, index: int, around: int
) -> _AirResults:
    return _AirResults(
        inside_body=around,
        number=index,
        mass_kg=body_mass(scene.bodies[index]),
        volume_m3=scene.bodies[index].structure.volume,
        energy=_as_lists(_balance(solution).bodies[index]),
        temperature_K=np.asarray(solution.mean_temperature, float)[:, index].tolist(),
    )


def _bodies(
    scene: Scene, solution: Solution | SteadySolution
) -> Iterator[_BodyResults]:
    """Results of all bodies with a surface, in order."""
    bodies = bodies_with_surface(scene)
    # Read once: each attribute of a solution takes a pass over all of its bodies.
    balances = _balance(solution).bodies
    surface_temperature = np.asarray(solution.surface_temperature, float)
    mean_temperature = np.asarray(solution.mean_temperature, float)
    columns = consecutive(len(body.structure.grid.fragment_area) for body in bodies)
    for number, (body, of_body) in enumerate(zip(bodies, columns, strict=True)):
        grid = body.structure.grid
        temperature = surface_temperature[:, of_body]
        weight = grid.fragment_area / grid.fragment_area.sum()
        yield _BodyResults(
            name=body.name,
            mesh=describe_mesh(grid.mesh),
            mass_kg=body_mass(body),
            volume_m3=body.structure.volume,
            area_m2=float(grid.fragment_area.sum()),
            energy=_as_lists(balances[number]),
            surface_temperature_K={
                "min": temperature.min(axis=1).tolist(),
                "mean": (temperature @ weight).tolist(),
                "max": temperature.max(axis=1).tolist(),
            },
            mean_temperature_K=mean_temperature[:, number].tolist(),
        )


def _terms(solution: Solution | SteadySolution) -> list[_TermResults]:
    times = np.asarray(solution.times, float)
    balance = _balance(solution)
    # Heat over the time of a run is a rate; that of a steady state is one.
    duration = float(times[-1]) if isinstance(balance, Energy) else 1.0
    names = solution.receipt.body_names
    rows = []
    for part in solution.receipt.parts:
        if len(part.bodies) == 2:
            pair = pair_name(part.mechanism, part.bodies, names)
            heat = balance.contacts[pair]
        else:
            heat = balance.bodies[part.bodies[0]].mechanisms[part.mechanism]
        total = float(np.ravel(np.asarray(heat, float))[-1])
        rows.append(
            _TermResults(
                mechanism=part.mechanism,
                bodies=list(part.bodies),
                body_names=[names[number] for number in part.bodies],
                area_m2=part.area,
                volume_m3=part.volume,
                mean_heat_rate_W=total / duration if duration else None,
            )
        )
    return rows


def _columns(balance: Energy | HeatRates) -> dict[str, np.ndarray]:
    """Energies [J] or heat rates [W] by name, with the unit at the end of the name."""
    is_energy = isinstance(balance, Energy)
    unit = "J" if is_energy else "W"
    heats = {**balance.mechanisms, **balance.contacts}
    columns = {
        **({"stored_J": balance.stored_J} if is_energy else {}),
        **{f"{name}_{unit}": heat for name, heat in heats.items()},
        "residual_relative": balance.residual_relative,
    }
    return {
        name: np.atleast_1d(np.asarray(column, float))
        for name, column in columns.items()
    }


def summarize(
    config: SceneConfig,
    scene: Scene,
    solution: Solution | SteadySolution,
    times: dict[str, float],
    structures: Sequence[StructureReport],
    warnings: list[str],
) -> dict[str, Any]:
    """All results of a finished run except its fields, in plain types.

    Args:
        config: of the run.
        scene: built from the config.
        solution: of the scene.
        times: wall times by name.
        structures: `structure_report` of each body that has a surface.
        warnings: likely mistakes, and numbers outside the range of fit cards.
    """
    receipt = solution.receipt.as_dict()
    return {
        "result": RESULTS[solution.result] or "successful",
        "receipt": receipt,
        "warnings": warnings,
        "nodes": receipt["nodes"],
        "links": receipt["links"],
        "structures": structures,
        "solver": solution.run.solver,
        "steps": solution.run.steps,
        "dt_s": solution.run.dt,
        "stable_step_s": _finite(solution.run.stable_step),
        "time_error_K": solution.run.time_error,
        "time_error_limit_K": solution.run.time_error_limit,
        "effort": _effort(solution.run.statistics),
        **times,
        "peak_memory_bytes": peak_memory(),
        "times_s": np.asarray(solution.times, float).tolist(),
        "energy": _as_lists(_balance(solution)),
        "terms": _terms(solution),
        "bodies": list(_bodies(scene, solution)),
        "airs": [
            _air(scene, solution, air, around)
            for air, around in bodies_around_air(scene).items()
        ],
        "probes": _probes(solution),
        "config": resolved(config),
        **provenance(config_hash(config)),
    }


def _probes(solution: Solution | SteadySolution) -> dict[str, _ProbeResults]:
    return {
        probe.name: _ProbeResults(
            position_m=list(probe.position), temperature_K=column.tolist()
        )
        for probe, column in zip(solution.probes, _probe_columns(solution), strict=True)
    }


def _probe_columns(solution: Solution | SteadySolution) -> list[np.ndarray]:
    if solution.probe_temperature is None:
        return []
    return list(np.asarray(solution.probe_temperature, float).T)


def _effort(effort: SolverStatistics | None) -> dict[str, int | float] | None:
    if effort is None:
        return None
    return {
        "newton_steps": int(effort.newton_iterations),
        "linear_iterations": int(effort.linear_iterations),
        "accepted_steps": int(effort.accepted_steps),
        "rejected_steps": int(effort.rejected_steps),
        "largest_linear_residual_K": float(effort.largest_linear_residual),
    }


# JSON has no infinity.
def _finite(value: float | None) -> float | None:
    return value if value is not None and np.isfinite(value) else None


def write_energy(path: Path, scene: Scene, solution: Solution | SteadySolution) -> None:
    """Write the energies at each saved time, or the heat rates, as CSV, in one step.

    The first columns are of all bodies together, the following ones of each body.
    """
    balance = _balance(solution)
    columns = _columns(balance)
    if len(balance.bodies) > 1:
        labels = body_labels(scene)
        for label, body in zip(labels, balance.bodies, strict=True):
            for name, column in _columns(body).items():
                columns[f"{label}: {name}"] = column
    write_columns(path, np.asarray(solution.times, float).tolist(), columns)


def write_probes(path: Path, solution: Solution | SteadySolution) -> None:
    """Write the temperature of each probe [K] at each saved time, in one step."""
    names = [probe.name for probe in solution.probes]
    columns = dict(zip(names, _probe_columns(solution), strict=True))
    write_columns(path, np.asarray(solution.times, float).tolist(), columns)
