"""An implicit step and a steady state of the full volume, beside scipy, in one run.

The same system for all, in float64, to the same relative residual: conjugate gradients
on the layout that solves take, with the diagonal and with this multigrid, whose
diagonals are recomputed for every solve, one of which a solver selects by the step; and
scipy's on a sparse matrix, with the diagonal and with pyamg's smoothed aggregation,
whose set-up is reported separately. They run interleaved.
"""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pyamg
import scipy.sparse as sparse
from rich.console import Console

import jaxthermo as jt
from jaxthermo.geometry.figurine import figurine
from jaxthermo.integrate.implicit.conjugate_gradient import (
    AbstractStoppingNorm,
    ConjugateGradient,
)
from jaxthermo.integrate.implicit.context import MULTIGRID_STEP_RATIO
from jaxthermo.network.multigrid import Hierarchy, hierarchy, jacobi
from jaxthermo.network.network import AbstractNetwork
from jaxthermo.physics.conduction import assemble_uniform
from jaxthermo.report.table import Table
from jaxthermo.timing import Timing

from ..harness.timing import timing_of


HEIGHT = 0.5
"""Height of the figurine [m]."""

CONDUCTIVITY, HEAT_CAPACITY, AIR = 16.0, 4e6, 10.0
"""Stainless steel [W/(m K)], [J/(m^3 K)], and heat transfer to air [W/(m^2 K)]."""

STEPS = {"step of 5 s": 5.0, "step of 60 s": 60.0, "steady": None}

DIAGONAL, MULTIGRID = "jaxthermo, diagonal", "jaxthermo, multigrid"

TOLERANCE = 1e-8
"""Residual over right-hand side, in the norm of vectors."""

MOST = 5000


class _System(NamedTuple):
    """(diag(m) - K) x = b, as a state and as a matrix of the solid voxels."""

    network: AbstractNetwork
    levels: Hierarchy
    m: jax.Array
    b: jax.Array
    address: tuple[np.ndarray, ...]
    matrix: Any


class _Solved(NamedTuple):
    """The result of one solver."""

    values: np.ndarray
    """Temperature of each solid voxel [K]."""
    iterations: int
    seconds: float


def system(height: int, dt: float | None) -> _System:
    """The figurine, heated from +x, in still air; at rest if there is no step."""
    grid = jt.voxelize(figurine(HEIGHT), HEIGHT / height)
    structure = jt.FullVolume(grid).for_solves()
    network = assemble_uniform(structure, CONDUCTIVITY, HEAT_CAPACITY, np.float64)
    node, n = structure.fragment_node(), structure.node_count
    surface = np.bincount(node, grid.fragment_area, n)
    shone_on = np.maximum(grid.fragment_normal[:, 0], 0) * grid.fragment_area
    m = AIR * surface
    if dt is not None:
        m = m + HEAT_CAPACITY * structure.nodes().volume / dt
    address, state = structure.node_address(), np.zeros(structure.state_shape)
    put = lambda values: jnp.asarray(state).at[address].set(values)
    links = structure.links()
    g = np.full(len(links.src), CONDUCTIVITY * grid.pitch)
    half = sparse.coo_array((g, (links.src, links.dst)), (n, n)).tocsr()
    k = half + half.T
    matrix = sparse.csr_array(sparse.diags_array(k.sum(axis=1) + m) - k)
    b = 5000.0 * np.bincount(node, shone_on, n)
    return _System(
        network, hierarchy(structure, network), put(m), put(b), address, matrix
    )


class _Norm(AbstractStoppingNorm):
    """The residual's, as scipy stops by."""

    def initial(self, residual: Any) -> jax.Array:
        """|r|."""
        return jnp.sqrt(jnp.vdot(residual, residual))

    def after_step(self, residual: Any, moved: Any) -> jax.Array:
        """|r|."""
        del moved
        return self.initial(residual)


@jax.jit
def _conjugate_gradients(
    network: AbstractNetwork, levels: Hierarchy | None, m: jax.Array, b: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """The solution and how many iterations it took; without levels by the diagonal."""
    operator = lx.FunctionLinearOperator(
        lambda v: m * v - network.heat_rate(v),
        jax.eval_shape(lambda: b),
        lx.positive_semidefinite_tag,
    )
    solver = ConjugateGradient(_Norm(), TOLERANCE, relative=True, max_iterations=MOST)
    cycle = jacobi(network, m) if levels is None else levels.cycle(m)
    options = {"preconditioner": cycle}
    found = lx.linear_solve(operator, b, solver, options=options, throw=False)
    return found.value, found.stats["iterations"]


def _ours(given: _System, levels: Hierarchy | None) -> _Solved:
    clock = time.perf_counter()
    x, count = _conjugate_gradients(given.network, levels, given.m, given.b)
    jax.block_until_ready(x)
    seconds = time.perf_counter() - clock
    return _Solved(np.asarray(x[given.address]), int(count), seconds)


def _scipy(given: _System, preconditioner: Any) -> _Solved:
    count = 0

    def counted(_):
        nonlocal count
        count += 1

    b = np.asarray(given.b[given.address])
    clock = time.perf_counter()
    x, _ = sparse.linalg.cg(
        given.matrix,
        b,
        rtol=TOLERANCE,
        maxiter=MOST,
        M=preconditioner,
        callback=counted,
    )
    return _Solved(x, count, time.perf_counter() - clock)


def _compare(given: _System, dt: float | None, repeats: int) -> dict[str, Any]:
    """Times, iterations and true residuals of one system."""
    stable = float(1 / given.network.max_rate())
    chosen = MULTIGRID if dt is None or dt > MULTIGRID_STEP_RATIO * stable else DIAGONAL
    clock = time.perf_counter()
    arguments = given.network, given.levels, given.m, given.b
    _conjugate_gradients.lower(*arguments).compile()
    compiled = time.perf_counter() - clock
    clock = time.perf_counter()
    aggregation = pyamg.smoothed_aggregation_solver(given.matrix, symmetry="symmetric")
    set_up = time.perf_counter() - clock
    diagonal = sparse.diags_array(1 / given.matrix.diagonal())
    solvers: dict[str, Callable[[], _Solved]] = {
        DIAGONAL: partial(_ours, given, None),
        MULTIGRID: partial(_ours, given, given.levels),
        "scipy, diagonal": partial(_scipy, given, diagonal),
        "scipy, pyamg": partial(_scipy, given, aggregation.aspreconditioner()),
    }
    last = {name: solve() for name, solve in solvers.items()}
    spans = {name: [] for name in solvers}
    for _ in range(repeats):
        for name, solve in solvers.items():
            spans[name].append(solve().seconds)
    b = np.asarray(given.b[given.address])
    left = lambda x: np.linalg.norm(b - given.matrix @ x) / np.linalg.norm(b)
    rows = {
        name: {
            "iterations": solved.iterations,
            "residual": float(left(solved.values)),
            "solve_s": timing_of(spans[name])._asdict(),
        }
        for name, solved in last.items()
    }
    fastest = min(median(t) for name, t in spans.items() if name.startswith("scipy"))
    return {
        "solvers": rows,
        "compile_s": compiled,
        "pyamg_set_up_s": set_up,
        "stable_steps": None if dt is None else dt / stable,
        "chosen": chosen,
        "faster_than_the_faster_peer": fastest / median(spans[chosen]),
    }


def run(
    folder: Path | None = None, height: int = 128, repeats: int = 3
) -> dict[str, Any]:
    """Every step at `height` voxels, and how iterations grow from half of it."""
    result: dict[str, Any] = {"height": height, "dtype": "float64", "steps": {}}
    with jax.enable_x64(True):
        for name, dt in STEPS.items():
            given, coarser = system(height, dt), system(height // 2, dt)
            found = _compare(given, dt, repeats)
            half = _ours(coarser, coarser.levels)
            found["iterations_at_half"] = half.iterations
            result["steps"][name] = found
            result["solid_voxels"] = given.matrix.shape[0]
            result["lattice"] = list(given.m.shape)
            _show(name, found, result)
    return result


def _show(name: str, found: dict[str, Any], result: dict[str, Any]) -> None:
    size = f"{result['height']} high, {result['solid_voxels']} voxels"
    lines = [
        [
            solver,
            Timing(**row["solve_s"]).text(),
            str(row["iterations"]),
            f"{row['residual']:.1e}",
        ]
        for solver, row in found["solvers"].items()
    ]
    columns = ("", "solve (fastest-slowest)", "iterations", "residual")
    table = Table(columns, lines, f"{name}, {size}, float64 to {TOLERANCE:g}")
    console = Console()
    console.print(table.rich())
    console.print(
        f"chosen: {found['chosen']}, {found['faster_than_the_faster_peer']:.2f} times "
        "as fast as the faster peer"
    )
    console.print(
        f"{found['iterations_at_half']} cycles at half the height; compiled in "
        f"{found['compile_s']:.1f} s, pyamg set up in {found['pyamg_set_up_s']:.1f} s"
    )
