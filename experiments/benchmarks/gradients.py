"""Cost of a reverse-mode gradient beside its forward run, measured in turn.

The gradient of the mean of the final surface's temperature, with respect to all weights
of links, k, h, the emissivity and the sun, of the standard scene on a structure that
takes weights, by explicit steps from checkpoints within a stated memory.
"""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

import jaxthermo as jt
from jaxthermo.report.table import Table

from ..harness.meshes import END, HEIGHT, START, thesis_meshes
from ..harness.timing import interleaved, ratio_of, ratio_text, timing_of


MEMORY = 2**30
"""For kept states [bytes]."""

STRUCTURES: dict[str, Callable[..., Any]] = {
    "aggregate x4": lambda grid, weights: jt.Aggregate(grid, 4, weights=weights),
    "shell over core": lambda grid, weights: jt.ShellOverCore(
        grid, 1, 4, weights=weights
    ),
    "full volume": lambda grid, weights: jt.FullVolume(grid, weights=weights),
}

VALUES = jnp.array([1.0, 1.0, 1.0, 16.0, 10.0, 0.9, 5000.0], jnp.float32)
"""Weights within, between and at the surface, k, h, emissivity, sun."""


def _loss(make, grid, dt: float) -> Callable[[jax.Array], jax.Array]:
    def loss(values):
        within, between, surface, k, h, emissivity, sun = values
        weights = jt.ConductionWeights(within, between, surface)
        material = jt.Material(
            k,
            density=8000.0,
            specific_heat=500.0,
            emissivity=emissivity,
            absorptivity=1.0,
        )
        body = jt.Body(make(grid, weights), material, temperature=START)
        terms = (
            jt.Sun((-1.0, 0.0, 0.0), jt.Until(sun, END / 2)),
            jt.Convection(h, START),
            jt.Surroundings(START),
        )
        found = jt.simulate(
            jt.Scene((body,), terms),
            END,
            solver=jt.ForwardEuler(dt=dt),
            reverse_memory=MEMORY,
        )
        return found.surface_temperature[-1].mean()

    return loss


def _stable(make, grid) -> float:
    body = jt.Body(
        make(grid, jt.ConductionWeights()),
        jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.9),
        temperature=START,
    )
    terms = (jt.Convection(10.0, START), jt.Surroundings(START))
    return float(jt.compile_scene(jt.Scene((body,), terms), 1, END).stable_step)


def _measure(make, grid, repeats: int) -> dict[str, Any]:
    dt = 0.9 * _stable(make, grid)
    loss = _loss(make, grid, dt)
    calls, compiled = {}, {}
    for name, function in (("forward", loss), ("reverse", jax.grad(loss))):
        clock = time.perf_counter()
        calls[name] = jax.jit(function).lower(VALUES).compile()
        compiled[name] = time.perf_counter() - clock
    spans = interleaved({n: partial(c, VALUES) for n, c in calls.items()}, repeats)
    held = calls["reverse"].memory_analysis()
    return {
        "steps": int(np.ceil(END / dt)),
        "compile_s": compiled,
        "times_s": spans,
        "ratio": ratio_of(spans["reverse"], spans["forward"]),
        "temporary_bytes": None if held is None else int(held.temp_size_in_bytes),
        "gradient": np.asarray(calls["reverse"](VALUES), float).tolist(),
    }


def run(folder: Path, height: int = 128, repeats: int = 3) -> dict[str, Any]:
    """Times of both, their ratio, memory and the gradient, for each structure."""
    del folder
    name, mesh = next(iter(thesis_meshes().items()))
    grid = jt.voxelize(mesh, HEIGHT / height)
    rows = {kind: _measure(make, grid, repeats) for kind, make in STRUCTURES.items()}
    columns = ("", "steps", "forward", "reverse", "ratio", "memory", "compiled")
    lines = [
        [
            kind,
            str(row["steps"]),
            timing_of(row["times_s"]["forward"]).text(),
            timing_of(row["times_s"]["reverse"]).text(),
            ratio_text(row["ratio"]),
            f"{row['temporary_bytes'] / 2**30:.2f} GiB",
            f"{row['compile_s']['reverse']:.1f} s",
        ]
        for kind, row in rows.items()
    ]
    title = f"Reverse mode over {END:g} s of {name}, {height} high"
    table = Table(columns, lines, title)
    Console().print(table.rich())
    return {"mesh": name, "height": height, "budget_bytes": MEMORY, "runs": rows}
