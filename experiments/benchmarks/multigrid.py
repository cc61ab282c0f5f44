"""An implicit step and a steady state of the full volume, compared with scipy.

The same system for all, in float64, to the same relative residual, interleaved:
conjugate gradients with the diagonal and with multigrid, one of which a solver selects
by the step; scipy's with the diagonal and with pyamg's smoothed aggregation, whose
set-up is reported separately. All of them must reach that residual of the matrix, and
the same temperatures.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple, NotRequired, TypedDict

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pyamg
import scipy.sparse as sparse
from typing_extensions import override

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.console.terminal import open_console
from jaxthermo.geometry.shapes import figurine
from jaxthermo.integrate.implicit.conjugate_gradient import (
    AbstractStoppingNorm,
    ConjugateGradient,
)
from jaxthermo.integrate.implicit.jacobian import MULTIGRID_STEP_RATIO
from jaxthermo.network.multigrid import Hierarchy, hierarchy, jacobi
from jaxthermo.network.network import AbstractNetwork
from jaxthermo.physics.conduction import assemble_uniform
from jaxthermo.timing import Spread, timed_call

from ..harness.agreement import largest_difference, require_within
from ..harness.link_matrix import laplacian
from ..harness.measurement import MeasuredResult, Measurement, compared, plain_rows
from ..harness.present import show, table_of


QUICK = {"height": 48, "repeats": 2}

# Height of the figurine [m]; stainless steel [W/(m K)], [J/(m^3 K)]; air [W/(m^2 K)].
_HEIGHT = 0.5
_CONDUCTIVITY = 16.0
_HEAT_CAPACITY = 4e6
_AIR = 10.0

_STEPS = {"step of 5 s": 5.0, "step of 60 s": 60.0, "steady": None}

_DIAGONAL = "jaxthermo, diagonal"
_MULTIGRID = "jaxthermo, multigrid"

# Residual over right-hand side, in the norm of vectors, which scipy stops by.
_TOLERANCE = 1e-8
_MAX_ITERATIONS = 5000
# Conjugate gradients update their residual: the true one differs by rounding.
_MAX_RESIDUAL = 2 * _TOLERANCE
_MAX_DIFFERENCE = 1e-6
"""Largest difference of two solvers' temperatures, over the largest temperature [-]."""


class _System(NamedTuple):
    # (diag(m) - K) x = b, as a state and as a matrix of the solid voxels.
    network: AbstractNetwork
    levels: Hierarchy
    m: jax.Array
    b: jax.Array
    address: tuple[np.ndarray, ...]
    matrix: Any


class _Solved(NamedTuple):
    # Temperature of each solid voxel [K].
    values: np.ndarray
    iterations: int
    seconds: float


class _SolverRow(TypedDict):
    """Iterations, relative residual and times of one solver."""

    iterations: int
    residual: float
    solve_s: dict[str, float]
    spans_s: list[float]


class _Comparison(TypedDict):
    """All solvers of one system."""

    solvers: dict[str, _SolverRow]
    compile_s: float
    pyamg_set_up_s: float
    largest_difference: float
    stable_steps: float | None
    chosen: str
    faster_than_the_faster_peer: float
    iterations_at_half: NotRequired[int]


class _Result(MeasuredResult):
    height: int
    dtype: Dtype
    steps: dict[str, _Comparison]
    solid_voxels: int
    lattice: list[int]


def _system(height: int, dt: float | None) -> _System:
    # The figurine, heated from +x, in still air; at rest if there is no step.
    grid = jt.voxelize(figurine(_HEIGHT), _HEIGHT / height)
    structure = jt.FullVolume(grid).for_solves()
    network = assemble_uniform(
        structure,
        conductivity=_CONDUCTIVITY,
        volumetric_heat_capacity=_HEAT_CAPACITY,
        dtype=np.float64,
    )
    node = structure.fragment_node()
    n = structure.node_count
    surface = np.bincount(node, grid.fragment_area, n)
    shone_on = np.maximum(grid.fragment_normal[:, 0], 0) * grid.fragment_area
    m = _AIR * surface
    if dt is not None:
        m = m + _HEAT_CAPACITY * structure.nodes().volume / dt
    address = structure.node_address()
    state = np.zeros(structure.state_shape)

    def as_state(values: np.ndarray) -> jax.Array:
        return jnp.asarray(state).at[address].set(values)

    links = structure.links()
    # Cut voxels share a part of their faces, and their nodes lie elsewhere.
    g = _CONDUCTIVITY * links.area / links.length
    matrix = sparse.csr_array(laplacian(links, g, n) + sparse.diags_array(m))
    b = 5000.0 * np.bincount(node, shone_on, n)
    levels = hierarchy(structure, network)
    return _System(
        network=network,
        levels=levels,
        m=as_state(m),
        b=as_state(b),
        address=address,
        matrix=matrix,
    )


class _Norm(AbstractStoppingNorm):
    # |r|, as scipy stops by; a solver's own norm is in kelvin.
    @override
    def initial(self, residual: Any) -> jax.Array:
        return jnp.sqrt(jnp.vdot(residual, residual))

    @override
    def after_step(self, residual: Any, moved: Any) -> jax.Array:
        return self.initial(residual)


@jax.jit
def _conjugate_gradients(
    network: AbstractNetwork, levels: Hierarchy | None, m: jax.Array, b: jax.Array
) -> tuple[jax.Array, jax.Array]:
    # The solution and how many iterations it took; without levels by the diagonal.
    operator = lx.FunctionLinearOperator(
        lambda v: m * v - network.heat_rate(v),
        jax.eval_shape(lambda: b),
        lx.positive_semidefinite_tag,
    )
    solver = ConjugateGradient(
        _Norm(), _TOLERANCE, relative=True, max_iterations=_MAX_ITERATIONS
    )
    cycle = jacobi(network, m) if levels is None else levels.cycle(m)
    options = {"preconditioner": cycle}
    solution = lx.linear_solve(operator, b, solver, options=options, throw=False)
    return solution.value, solution.stats["iterations"]


def _ours(system: _System, levels: Hierarchy | None) -> _Solved:
    (x, count), took = timed_call(
        lambda: _conjugate_gradients(system.network, levels, system.m, system.b)
    )
    return _Solved(np.asarray(x[system.address]), int(count), took)


def _scipy(system: _System, preconditioner: Any) -> _Solved:
    # scipy reports no iterations: its callback counts them.
    iterations = []
    b = np.asarray(system.b[system.address])

    def solve():
        return sparse.linalg.cg(
            system.matrix,
            b,
            M=preconditioner,
            callback=lambda _: iterations.append(1),
            rtol=_TOLERANCE,
            maxiter=_MAX_ITERATIONS,
        )

    (x, _), took = timed_call(solve)
    return _Solved(x, len(iterations), took)


def _compare(system: _System, dt: float | None, repeats: int) -> _Comparison:
    """Times, iterations and true residuals of one system."""
    stable = float(1 / system.network.max_rate())
    # As the solvers select it: for a short step the diagonal is good enough.
    is_long = dt is None or dt > MULTIGRID_STEP_RATIO * stable
    selected = _MULTIGRID if is_long else _DIAGONAL

    def compile_solve():
        lowered = _conjugate_gradients.lower(
            system.network, system.levels, system.m, system.b
        )
        return lowered.compile()

    _, compiled = timed_call(compile_solve)
    aggregation, set_up = timed_call(
        lambda: pyamg.smoothed_aggregation_solver(system.matrix, symmetry="symmetric")
    )
    diagonal = sparse.diags_array(1 / system.matrix.diagonal())
    solvers: dict[str, Callable[[], _Solved]] = {
        _DIAGONAL: partial(_ours, system, None),
        _MULTIGRID: partial(_ours, system, system.levels),
        "scipy, diagonal": partial(_scipy, system, diagonal),
        "scipy, pyamg": partial(_scipy, system, aggregation.aspreconditioner()),
    }
    # Each reports the time of its solve alone, without copying the result.
    last = {name: solve() for name, solve in solvers.items()}
    values = {name: solved.values for name, solved in last.items()}
    scale = float(np.abs(last[_DIAGONAL].values).max())
    difference = largest_difference(
        "temperatures", values, tolerance=_MAX_DIFFERENCE * scale, unit="K"
    )
    rounds = [[s().seconds for s in solvers.values()] for _ in range(repeats)]
    spans = dict(zip(solvers, zip(*rounds, strict=True), strict=True))
    b = np.asarray(system.b[system.address])

    def residual(x: np.ndarray) -> float:
        difference = b - system.matrix @ x
        return float(np.linalg.norm(difference) / np.linalg.norm(b))

    rows: dict[str, _SolverRow] = {
        name: {
            "iterations": solved.iterations,
            "residual": require_within(
                f"residual of {name}", residual(solved.values), tolerance=_MAX_RESIDUAL
            ),
            "solve_s": Spread.of(spans[name])._asdict(),
            "spans_s": list(spans[name]),
        }
        for name, solved in last.items()
    }
    fastest = min(median(t) for name, t in spans.items() if name.startswith("scipy"))
    return {
        "solvers": rows,
        "compile_s": compiled,
        "pyamg_set_up_s": set_up,
        "largest_difference": difference / scale,
        "stable_steps": None if dt is None else dt / stable,
        "chosen": selected,
        "faster_than_the_faster_peer": fastest / median(spans[selected]),
    }


def run(folder: Path, height: int = 128, repeats: int = 3) -> _Result:
    """Every step at `height` voxels, and how iterations grow from half of it."""
    result: _Result = {
        "height": height,
        "dtype": "float64",
        "steps": {},
        "solid_voxels": 0,
        "lattice": [],
        "measurements": [],
    }
    measured: list[Measurement] = []
    with jax.enable_x64(True):
        for name, dt in _STEPS.items():
            system = _system(height, dt)
            coarser = _system(height // 2, dt)
            comparison = _compare(system, dt, repeats)
            half = _ours(coarser, coarser.levels)
            comparison["iterations_at_half"] = half.iterations
            result["steps"][name] = comparison
            result["solid_voxels"] = system.matrix.shape[0]
            result["lattice"] = list(system.m.shape)
            measured += _measurements(name, comparison)
            _show(
                name,
                comparison=comparison,
                height=height,
                voxels=result["solid_voxels"],
            )
    result["measurements"] = plain_rows(measured)
    return result


def _measurements(name: str, comparison: _Comparison) -> list[Measurement]:
    """The solver that is selected, compared with the faster one of scipy."""
    selected = comparison["chosen"]
    solvers = comparison["solvers"]
    spans = {solver: row["spans_s"] for solver, row in solvers.items()}
    peer = min(
        (solver for solver in spans if solver.startswith("scipy")),
        key=lambda solver: median(spans[solver]),
    )
    preconditioner = selected.split(", ")[1]
    iterations = solvers[selected]["iterations"]
    peer_iterations = solvers[peer]["iterations"]
    difference = comparison["largest_difference"]
    note = (
        f"{preconditioner}; {iterations} iterations, the peer {peer_iterations}; all "
        f"solutions agree to {difference:.1g} of the largest temperature"
    )
    return compared(
        name=f"figurine: {name}",
        ours=spans[selected],
        peers={peer: spans[peer]},
        note=note,
    )


def _show(name: str, comparison: _Comparison, height: int, voxels: int) -> None:
    size = f"{height} high, {voxels} voxels"
    columns = [
        ("", "{name}"),
        ("solve (fastest-slowest)", lambda row: Spread(**row["solve_s"]).text()),
        ("iterations", "{iterations}"),
        ("residual", "{residual:.1e}"),
    ]
    title = f"{name}, {size}, float64 to {_TOLERANCE:g}"
    solvers = comparison["solvers"].items()
    rows = [{"name": solver, **row} for solver, row in solvers]
    show(table_of(rows, columns, title))
    console = open_console()
    console.print(
        "chosen: {chosen}, {faster_than_the_faster_peer:.2f} times as fast as the "
        "faster peer".format_map(comparison)
    )
    console.print(
        "{iterations_at_half} cycles at half the height; compiled in "
        "{compile_s:.1f} s, pyamg set up in {pyamg_set_up_s:.1f} s".format_map(
            comparison
        )
    )
