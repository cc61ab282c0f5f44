"""All that matters on a GPU, in one script that needs no network: `--device gpu`.

A copy of memory and a step of conduction in the thesis' lattice, as a share of it; a
step of each structure with sun and air; implicit steps; a Jacobian over its forward run
by the number of parameters; and a rendered frame. Beside torch and cupy where they are
installed: their steps must give the same temperatures. So must Jacobians of any number
of parameters, and the difference of two runs. It runs on processors too, where it is
tested.
"""

import importlib
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.solvers import AbstractSolver
from jaxthermo.network.stencil import solid_degree
from jaxthermo.timing import interleaved

from ..harness.agreement import largest_difference
from ..harness.measurement import MeasuredResult, Measurement, compared, plain_rows
from ..harness.meshes import END, START, STEEL, standard_scene, statue
from ..harness.scenes import stable_step
from ..thesis.table_6_1 import FULL, TABLE_TIMES
from .loops import loop_of, per_item
from .scaling_model import STEP_BYTES
from .steps import MAX_DT, STRUCTURES, conduction_of, random_state


QUICK = {"height": 40, "shape": (40, 96, 40), "repeats": 2, "copied": 2**22}

_STEPS = 100
_SOLVERS: dict[str, tuple[AbstractSolver, int]] = {
    "explicit step": (jt.ForwardEuler(), 1000),
    "implicit step": (jt.TRBDF2(dt=END / 4), 8),
}
_TURNS = 10
_THESIS_SHAPE = (228, 550, 228)
_MAX_DIFFERENCE = 1e-5
"""Largest difference of states after these steps, which are 0 to 1 at the start."""
_MAX_JACOBIAN_DIFFERENCE = 0.02
"""Largest difference of derivatives, over the largest of them [-]."""
_CHANGE = 0.05
"""Relative change of a parameter by which derivatives are compared."""
_SHARE = 0.7
"""Share of the bandwidth of a copy that a step must reach."""
_STRUCTURES = {**STRUCTURES, "single shell": jt.SingleShell}
_PARAMETERS = (1, 2, 4, 8)
_CAMERA = jt.Camera((1.6, 0.6, 0.4), (0.0, 0.0, 0.25), width=640, height=480)


class _Result(MeasuredResult):
    device: str
    copy_bytes_per_s: float


def run(
    folder: Path,
    height: int = 250,
    shape: tuple[int, int, int] = _THESIS_SHAPE,
    repeats: int = 7,
    copied: int = 2**28,
) -> _Result:
    """Times of all of them, and the card's or processor's name.

    Args:
        folder: of the result.
        height: of the statue, in voxels.
        shape: of the lattice of conduction.
        repeats: of every call.
        copied: values of the array that is copied.
    """
    device = jax.devices()[0]
    bandwidth, rows = _copy(copied, repeats)
    rows += _conduction(shape, repeats, bandwidth)
    mesh, grid = statue(height)
    name = f"{mesh}, {height} high"
    for label, structure in _STRUCTURES.items():
        rows += _steps(f"{name}, {label}", standard_scene(structure(grid)), repeats)
    scene = standard_scene(_STRUCTURES["blocks x4"](grid))
    rows += _jacobians(f"{name}, blocks x4", scene, repeats)
    rows += _frame(name, scene, repeats)
    device_name = f"{device.platform}: {device.device_kind}"
    return {
        "device": device_name,
        "copy_bytes_per_s": bandwidth,
        "measurements": plain_rows(rows),
    }


def _copy(count: int, repeats: int) -> tuple[float, list[Measurement]]:
    """Bandwidth of a copy, read and written [B/s]."""
    values = jnp.ones(count, jnp.float32)
    # Several in one call: the call itself takes some microseconds.
    copy_repeatedly = jax.jit(
        lambda a: jax.lax.fori_loop(0, _TURNS, lambda _, a: a + 1.0, a)
    )
    spans = interleaved({"copy": lambda: copy_repeatedly(values)}, repeats)
    copy_spans = per_item(spans, {"copy": _TURNS})["copy"]
    bandwidth = 2 * 4 * count / min(copy_spans)
    note = f"{bandwidth / 1e9:.4g} GB/s read and written"
    return bandwidth, [Measurement("copy of an array", "s", copy_spans, note=note)]


def _conduction(
    shape: tuple[int, int, int], repeats: int, bandwidth: float
) -> list[Measurement]:
    x, y, z = (1e-3 * n for n in shape)
    grid = jt.voxelize(jt.shapes.box((x, y, z)), 1e-3, "dominant_axis")
    structure = jt.FullVolume(grid)
    conduct = conduction_of(structure)
    calls: dict[str, Callable[[], Any]] = {"ours": partial(conduct, _STEPS)}
    states = {"ours": np.asarray(conduct(_STEPS))}
    degree = np.zeros(structure.state_shape, np.uint8)
    degree[1:-1, 1:-1, 1:-1] = solid_degree(grid.solid)
    for name, make in _PEERS.items():
        if find_spec(name) is not None and _has_device(name):
            calls[name] = make(random_state(structure), degree)
            state = calls[name]()
            states[name] = np.asarray(state.get() if name == "cupy" else state.cpu())
    largest_difference(f"state after {_STEPS} steps", states, tolerance=_MAX_DIFFERENCE)
    step_spans = per_item(interleaved(calls, repeats), dict.fromkeys(calls, _STEPS))
    ours = step_spans.pop("ours")
    ideal = STEP_BYTES * int(np.prod(shape)) / bandwidth
    label = " x ".join(map(str, shape)) + ": step of conduction"
    share = f"{100 * ideal / min(ours):.0f} % of the copy's bandwidth"
    if tuple(shape) == _THESIS_SHAPE:
        step_spans["thesis, 9800GT"] = [TABLE_TIMES[FULL]]
    return [
        *compared(
            name=label, ours=ours, peers={"a copy": [ideal]}, bound=_SHARE, note=share
        ),
        *compared(label, ours, step_spans),
    ]


def _steps(label: str, scene: jt.Scene, repeats: int) -> list[Measurement]:
    """An explicit and an implicit step, with surface and ledger, and a whole call."""
    run = jt.compile_simulation(scene, END)
    calls: dict[str, Callable[[], Any]] = {"call": lambda: run().surface_temperature}
    for name, (solver, count) in _SOLVERS.items():
        plan = plan_run(scene, t1=END, save_at=None, solver=solver)
        calls[name] = loop_of(plan, count)
        calls[f"no {name}"] = loop_of(plan, 0)
    spans = interleaved(calls, repeats)
    nodes = f"{run.plan.compiled.receipt.nodes:,} nodes"
    run_info = run().run
    call = f"{nodes}, {run_info.steps} steps of {run_info.solver}"
    rows = []
    for name, (_, count) in _SOLVERS.items():
        # Starting a loop takes as long as many of its steps.
        start = min(spans[f"no {name}"])
        step_spans = [(span - start) / count for span in spans[name]]
        rows.append(Measurement(f"{label}: {name}", "s", step_spans, note=nodes))
    name = f"{label}: call of {END:g} s"
    rows.append(Measurement(name, "s", spans["call"], note=call))
    return rows


def _jacobians(label: str, scene: jt.Scene, repeats: int) -> list[Measurement]:
    """Exact derivatives of the surface by as many parameters, over a forward run."""
    solver = jt.ForwardEuler(dt=0.8 * stable_step(scene))
    body = scene.bodies[0]
    conductivity = STEEL.conductivity
    assert isinstance(conductivity, float)

    def surface(factors: jax.Array) -> jax.Array:
        # As many parameters as factors, which all scale the conductivity.
        material = jt.Material(
            conductivity * factors.prod(),
            density=STEEL.density,
            specific_heat=STEEL.specific_heat,
        )
        warmer = jt.Body(body.structure, material, temperature=START)
        warmer_scene = jt.Scene((warmer,), scene.terms)
        run = jt.simulate(warmer_scene, END, solver=solver)
        return run.surface_temperature[-1]

    calls: dict[str, Callable[[], Any]] = {}
    forward = jax.jit(surface)
    calls["forward"] = partial(forward, jnp.ones(1))
    for count in _PARAMETERS:
        jacobian = jax.jit(jax.jacfwd(surface))
        calls[str(count)] = partial(jacobian, jnp.ones(count))
    columns = {
        f"{count} parameters": np.asarray(calls[str(count)](), float)[:, -1]
        for count in _PARAMETERS
    }
    above, below = (
        np.asarray(forward(jnp.array([1 + change])), float)
        for change in (_CHANGE, -_CHANGE)
    )
    largest_difference(
        f"{label}: derivatives",
        {"a difference": (above - below) / (2 * _CHANGE), **columns},
        tolerance=_MAX_JACOBIAN_DIFFERENCE
        * float(np.abs(columns["1 parameters"]).max()),
        unit="K",
    )
    spans = interleaved(calls, repeats)
    peers = {"a forward run": spans["forward"]}
    rows = []
    for count in _PARAMETERS:
        name = f"{label}: Jacobian of {count} parameter{'s' * (count > 1)}"
        rows += compared(name=name, ours=spans[str(count)], peers=peers, overhead=True)
    return rows


def _frame(label: str, scene: jt.Scene, repeats: int) -> list[Measurement]:
    solution = jt.simulate(scene, END / 10)
    calls = {"frame": lambda: jt.render(solution, _CAMERA).radiance}
    spans = interleaved(calls, repeats)["frame"]
    return [Measurement(f"{label}: frame of 640 x 480", "s", spans)]


def _torch_steps(start: np.ndarray, degree: np.ndarray) -> Callable[[], Any]:
    torch = importlib.import_module("torch")
    on_gpu = jax.default_backend() == "gpu"
    device = "cuda" if on_gpu else "cpu"
    state = torch.tensor(start, device=device)
    wait = torch.cuda.synchronize if on_gpu else lambda: None
    neighbours = torch.tensor(degree, device=device)
    return partial(slice_steps, state, torch.zeros_like(state), neighbours, wait)


def _cupy_steps(start: np.ndarray, degree: np.ndarray) -> Callable[[], Any]:
    cupy = importlib.import_module("cupy")
    state = cupy.asarray(start)
    wait = cupy.cuda.Device().synchronize
    return partial(
        slice_steps, state, cupy.zeros_like(state), cupy.asarray(degree), wait
    )


def slice_steps(a: Any, b: Any, degree: Any, wait: Callable[[], None]) -> Any:
    """Steps of the same stencil in slices of an array library, from the state `a` on.

    `degree` is the number of neighbours of each voxel; outside of the body all are 0.
    """
    i = slice(1, -1)
    low = slice(None, -2)
    high = slice(2, None)
    ratio = MAX_DT / 6
    for _ in range(_STEPS // 2):
        for old, new in ((a, b), (b, a)):
            total = old[low, i, i] + old[high, i, i] + old[i, low, i]
            total += old[i, high, i]
            total += old[i, i, low]
            total += old[i, i, high]
            total -= degree[i, i, i] * old[i, i, i]
            new[i, i, i] = old[i, i, i] + ratio * total
    wait()
    return a


def _has_device(name: str) -> bool:
    """True if the library can compute where JAX does."""
    return name == "torch" or jax.default_backend() == "gpu"


_PEERS: dict[str, Callable[..., Callable[[], Any]]] = {
    "torch": _torch_steps,
    "cupy": _cupy_steps,
}
