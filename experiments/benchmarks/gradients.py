"""Cost of a reverse-mode gradient over its forward run, measured in turn.

The gradient of the mean of the final surface's temperature, with respect to all weights
of links, k, h, the emissivity and the sun, of the standard scene on a structure that
takes weights, by explicit steps from checkpoints within a stated memory. It must agree
with the difference of two runs along a direction in which all values change.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypedDict

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.host_memory import readable_bytes
from jaxthermo.timing import Spread, interleaved, ratio_of, timed_call

from ..harness.agreement import require_within
from ..harness.measurement import MeasuredResult, Measurement, compared, plain_rows
from ..harness.meshes import END, START, statue


QUICK = {"height": 32, "repeats": 2}

# For kept states [bytes]: small enough that the full volume recomputes some of them.
_MEMORY = 2**30

# A structure of each kind that takes weights.
_STRUCTURES: dict[str, Callable[..., Any]] = {
    "aggregate x4": partial(jt.Aggregate, factor=4),
    "shell over core": partial(jt.ShellOverCore, layers=1, factor=4),
    # It has weights, with which it runs as links.
    "full volume": partial(jt.FullVolume, stencil=False),
}

# Weights within, between and at the surface, k, h, emissivity, sun.
_VALUES = (1.0, 1.0, 1.0, 16.0, 10.0, 0.9, 5000.0)
# Relative change of each, of which a twentieth is taken: conduction becomes slower, so
# that steps stay stable in one of both ways.
_DIRECTION = (0.5, -1.0, 1.0, -0.5, 1.0, -1.0, -1.0)
_STEP = 0.05
_MAX_ERROR = 0.01
"""Largest error of the derivative in that direction, over the difference [-]."""


def _scene(make, grid, values) -> jt.Scene:
    within, between, surface, k, h, emissivity, sun = values
    material = jt.Material(
        k, density=8000.0, specific_heat=500.0, emissivity=emissivity, absorptivity=1.0
    )
    structure = make(grid, weights=jt.ConductionWeights(within, between, surface))
    terms = (
        jt.Sun((-1.0, 0.0, 0.0), jt.Until(sun, END / 2)),
        jt.Convection(h, START),
        jt.Surroundings(START),
    )
    return jt.Scene((jt.Body(structure, material, temperature=START),), terms)


class _Costs(TypedDict):
    """Costs of a run and of its gradient, which is among them."""

    steps: int
    compile_s: dict[str, float]
    times_s: dict[str, list[float]]
    ratio: Spread
    temporary_bytes: int | None
    derivative_error: float
    gradient: list[float]


class _Result(MeasuredResult):
    mesh: str
    height: int
    budget_bytes: int
    runs: dict[str, _Costs]


def _measure(make, grid, repeats: int) -> _Costs:
    stable = jt.compile_scene(_scene(make, grid, _VALUES), 1, END).stable_step
    # Fixed while tracing: a step that followed the values would need its own gradient.
    dt = 0.9 * float(stable)
    values = jnp.array(_VALUES, jnp.float32)

    def loss(values):
        scene = _scene(make, grid, values)
        solver = jt.ForwardEuler(dt=dt)
        solution = jt.simulate(scene, END, solver=solver, reverse_memory=_MEMORY)
        return solution.surface_temperature[-1].mean()

    calls = {}
    compiled = {}
    for name, function in (("forward", loss), ("reverse", jax.grad(loss))):
        compiling = partial(lambda f: jax.jit(f).lower(values).compile(), function)
        calls[name], compiled[name] = timed_call(compiling)
    gradient = np.asarray(calls["reverse"](values), float)
    error = _derivative_error(calls["forward"], gradient)
    spans = interleaved({n: partial(c, values) for n, c in calls.items()}, repeats)
    # Not every backend reports the memory of what it compiled.
    held = calls["reverse"].memory_analysis()
    return {
        "steps": int(np.ceil(END / dt)),
        "compile_s": compiled,
        "times_s": spans,
        "ratio": ratio_of(spans["reverse"], spans["forward"]),
        "temporary_bytes": None if held is None else int(held.temp_size_in_bytes),
        "derivative_error": error,
        "gradient": gradient.tolist(),
    }


def _derivative_error(
    forward: Callable[[jax.Array], jax.Array], gradient: np.ndarray
) -> float:
    """Error of a derivative against a central difference, over that difference [-]."""
    change = np.asarray(_VALUES) * _DIRECTION
    ends = [
        float(forward(jnp.asarray(_VALUES + sign * _STEP * change, jnp.float32)))
        for sign in (-1, 1)
    ]
    difference = (ends[1] - ends[0]) / (2 * _STEP)
    return require_within(
        "error of the derivative",
        abs(float(gradient @ change) / difference - 1),
        tolerance=_MAX_ERROR,
    )


def run(folder: Path, height: int = 128, repeats: int = 3) -> _Result:
    """Times of both, their ratio, memory and the gradient, for each structure."""
    name, grid = statue(height)
    rows = {
        structure_name: _measure(make, grid, repeats)
        for structure_name, make in _STRUCTURES.items()
    }
    label = f"{name}, {height} high"
    measured = []
    for structure_name, row in rows.items():
        measured += _measurements(f"{label}, {structure_name}", row)
    return {
        "mesh": name,
        "height": height,
        "budget_bytes": _MEMORY,
        "runs": rows,
        "measurements": plain_rows(measured),
    }


def _measurements(name: str, row: _Costs) -> list[Measurement]:
    memory = readable_bytes(row["temporary_bytes"] or 0)
    times = row["times_s"]
    return compared(
        name=f"{name}: reverse-mode gradient",
        ours=times["reverse"],
        peers={"its forward run": times["forward"]},
        overhead=True,
        note=f"{row['steps']} explicit steps; {memory}; compiled in "
        f"{row['compile_s']['reverse']:.1f} s; off the difference of two runs by "
        f"{100 * row['derivative_error']:.1g} %",
    )
