"""`summary.json` and `energy.csv`: what a run was, found and cost, for machines."""

import csv
import io
import json
import platform
import resource
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..atomic import replacing
from ..config.loader import config_hash, resolved
from ..config.schema import SceneConfig
from ..geometry.verdict import describe_mesh
from ..integrate.solution import RESULTS, Solution
from ..scene.scene import Scene


def _versions() -> dict[str, str]:
    packages = ("jaxthermo", "jax", "jaxlib", "numpy", "equinox", "trimesh")
    return {"python": platform.python_version()} | {p: version(p) for p in packages}


def peak_memory() -> int:
    """Most memory this process has held so far [bytes]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def _body(scene: Scene, solution: Solution, index: int) -> dict[str, Any]:
    grid = scene.bodies[index].structure.grid
    temperature = np.asarray(solution.of_body(index), float)
    weight = grid.fragment_area / grid.fragment_area.sum()
    return {
        "mesh": describe_mesh(grid.mesh),
        "surface_temperature_K": {
            "min": temperature.min(axis=1).tolist(),
            "mean": (temperature @ weight).tolist(),
            "max": temperature.max(axis=1).tolist(),
        },
        "mean_temperature_K": np.asarray(
            solution.mean_temperature[:, index], float
        ).tolist(),
    }


def summarize(
    config: SceneConfig,
    scene: Scene,
    solution: Solution,
    times: dict[str, float],
    structures: list[dict[str, Any]],
) -> dict[str, Any]:
    """Everything about a finished run but its fields, in plain types.

    Args:
        config: that was run.
        scene: built of it.
        solution: of the scene.
        times: wall times by name.
        structures: the report of each body's.
    """
    receipt = solution.receipt.as_dict()
    energy = solution.energy
    device = jax.devices()[0]
    return {
        "result": RESULTS[solution.result] or "successful",
        "receipt": receipt,
        "nodes": receipt["nodes"],
        "links": receipt["links"],
        "structures": structures,
        "steps": solution.run.steps,
        "dt_s": solution.run.dt,
        "stable_step_s": _finite(solution.run.stable_step),
        **times,
        "peak_memory_bytes": peak_memory(),
        "times_s": np.asarray(solution.times, float).tolist(),
        "energy": {
            "stored_J": np.asarray(energy.stored_J, float).tolist(),
            **{
                f"{name}_J": np.asarray(heat, float).tolist()
                for name, heat in energy.mechanisms.items()
            },
            "residual_relative": np.asarray(energy.residual_relative, float).tolist(),
        },
        "bodies": [_body(scene, solution, b) for b in range(len(scene.bodies))],
        "config": resolved(config),
        "config_hash": config_hash(config),
        "versions": _versions(),
        "device": f"{device.platform}: {device.device_kind}",
        "seed": None,
    }


def _finite(value: float | None) -> float | None:
    """JSON has no infinity."""
    return value if value is not None and np.isfinite(value) else None


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write plain types as indented JSON, in one step."""
    with replacing(path) as temporary:
        text = json.dumps(content, indent=2, allow_nan=False)
        temporary.write_text(text + "\n", encoding="utf-8")


def write_energy(path: Path, solution: Solution) -> None:
    """Write the ledger at each saved time as CSV, in one step."""
    energy = solution.energy
    columns = {
        "time_s": solution.times,
        "stored_J": energy.stored_J,
        **{f"{name}_J": heat for name, heat in energy.mechanisms.items()},
        "residual_relative": energy.residual_relative,
    }
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    rows = zip(*(np.asarray(c, float) for c in columns.values()), strict=True)
    writer.writerows([f"{value:.9g}" for value in row] for row in rows)
    with replacing(path) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")
