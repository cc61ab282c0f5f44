"""Small results of all kinds, as the commands store them."""

import json
from typing import Any

from calibrating import RESULT

from calibrate.config.fit_record import write_fit
from jaxthermo.archive import signed


ORIGIN = {
    "config_hash": "01",
    "seed": None,
    "versions": {"jax": "0.10.2"},
    "device": "cpu: cpu",
    "processor": "A, 2 cores",
    "date": "2026-01-02T03:04:05+00:00",
}


def run_summary(**changes):
    """A summary of a run, as `jaxthermo simulate` writes it."""
    surface = {"min": [290.0, 291.0], "mean": [295.0, 296.0], "max": [300.0, 310.0]}
    return {
        "result": "successful",
        "receipt": {},
        "nodes": 100,
        "links": 240,
        "steps": 12,
        "solver": "ForwardEuler",
        "run_time_s": 1.0,
        "compile_time_s": 1.0,
        "setup_time_s": 1.0,
        "peak_memory_bytes": 10**9,
        "times_s": [5.0, 10.0],
        "energy": {"stored_J": [1.0, 2.0], "sun_J": [10.0, 20.0]},
        "bodies": [{"surface_temperature_K": surface}],
        "probes": {"tip": {"temperature_K": [300.0, 301.0]}},
        "truth_error": None,
        "config": {"name": "block", "terms": [{"direction": [1, 0, 0]}]},
        **ORIGIN,
        **changes,
    }


def stored(folder, name, content, rows=None, times=None):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(json.dumps(content))
    for file, lines in (("rows.jsonl", rows), ("times.jsonl", times)):
        if lines is not None:
            text = "".join(json.dumps(line) + "\n" for line in lines)
            (folder / file).write_text(text)
    return folder


def fit(folder, value, error: float | None = 0.1, **changes):
    folder.mkdir(parents=True)
    row = {**RESULT["parameters"]["weights.within"], "value": value}
    rows = {"weights.within": {**row, "standard_error": error}}
    result: Any = {**RESULT, "parameters": rows, **changes}
    write_fit(folder / "fit.json", result)
    return folder


def row(name, kelvin, load="+x", **changes):
    error = {"worst_rms_kelvin": kelvin, "worst_rms_percent": 10 * kelvin}
    return {"id": f"{name}{load}", "choice": {"structure": name}, "load": load,
            "error": error, "nodes": 10, **changes}  # fmt: skip


def sweep(folder, rows, times):
    spans = [{"id": key, "loop_s": seconds} for key, seconds in times.items()]
    line = {"choice": {"structure": "full"}, "rms_kelvin": 0.2, "rms_percent": 2.0}
    content = {"experiment": "sweep", "config": {"scene": "a/ball.yaml"}, **ORIGIN}
    content["choices"] = [{**line, "loop_s": 0.01}]
    return stored(folder, name="result.json", content=content, rows=rows, times=spans)


def experiment(folder, **values):
    content = {"experiment": "stencil", "result": values, **ORIGIN}
    return stored(folder, "result.json", content)


def plan(folder, median):
    """The folder of a plan whose scene runs in so many seconds."""
    record = {
        "config": {"name": "a"},
        "words": ["blocks of 8 mm from 4 mm voxels."],
        "chosen": {"structure": "blocks", "factor": 2},
        "miss": None,
        "run_time_s": {"median": median, "fastest": median, "slowest": median},
        "trials": [],
        "provenance": ORIGIN,
    }
    return stored(folder, "plan.json", signed("plan", 1, record))
