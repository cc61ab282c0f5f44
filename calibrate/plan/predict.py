"""Predictions of a candidate's error, run time and size from those that were run.

The error e of a candidate with voxels of pitch h, cells of size b and n steps is

    e^2 = (c_v h^p)^2 + (c_s b^q)^2 + (c_t n^-r)^2,

of its voxels, its structure and its steps, c_s for each line of candidates. A run takes

    t = E (a + c N) + R,    E = n s,

with E evaluations of N nodes, s stages a step, and R for reading the surface. Both are
fitted to what was run, with priors on all exponents and times, so that a single run is
enough; what is left over at candidates nearby corrects a prediction.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.sheets.through import GROWTH

from ..problem.sheet_cells import through_count
from .candidate import Candidate


_ORDERS = {"voxels": 2.0, "structure": 1.5, "euler": 1.0, "second": 2.0}
"""Orders of convergence before any run is known."""

_ORDER_SPREAD = 0.3
"""Standard deviation of the orders [-]."""

_PER_EVALUATION = 4e-5
"""Time of an evaluation before any run is known [s]."""

_PER_NODE = 1e-8
"""Time of a node in an evaluation before any run is known [s]."""

_SOLVE = 40.0
"""Time of an implicit step over that of an evaluation, before one is run [-]."""

_NEARBY = 1.5
"""Factor in sizes at which what is left over counts 1/e as much."""

_FLOOR = 0.1
"""Weight of a prediction without correction against that of one run nearby."""

_Line = tuple[str, str | None, bool]
"""Family, card, and True for implicit steps."""


class Measured(NamedTuple):
    """Error, cost and size of a candidate that was run."""

    candidate: Candidate
    error: float
    """Largest root mean square over the saved times, in the unit of the tolerance."""
    nodes: int
    fragments: int
    steps: int
    stages: int
    """Evaluations a step."""
    stable_step: float
    """Largest stable explicit step [s]; infinite if there is no limit."""
    run_time: float
    """Time of the compiled loop [s]."""
    memory: int
    """Peak memory as it is forecast [bytes]."""


class Size(NamedTuple):
    """Size of all bodies together, in the pitches of the scene's file."""

    volume: float
    """In cubes of the pitches [-]."""
    area: float
    """In squares of the pitches [-]."""
    sheet_area: float = 0.0
    """Area of sheets in squares of their pitches [-]."""
    through: float = 1.0
    """Mean number of cells through sheets [-]."""

    @property
    def is_of_sheets(self) -> bool:
        """True if there is no solid among the bodies."""
        return not self.volume

    def edge_of(self, nodes: int) -> float:
        """Edge of cells of which there are so many, without a solid's surface [-]."""
        of_sheets = self.sheet_area * self.through
        roots = np.roots([self.volume, of_sheets, 0.0, -float(nodes)])
        return 1 / float(roots[np.isreal(roots) & (roots.real > 0)].real[0])


def scene_size(scene: SceneConfig, pitches: tuple[float, ...]) -> Size:
    """Volume and area of all bodies of a scene, in their pitches [m]."""
    volume = 0.0
    area = 0.0
    sheet_area = 0.0
    sheet_nodes = 0.0
    for body, pitch in zip(scene.bodies, pitches, strict=True):
        mesh = body.build_mesh()
        cells = mesh.area / pitch**2
        if body.wall is None:
            volume += abs(mesh.volume) / pitch**3
            area += cells
        else:
            sheet_area += cells
            sheet_nodes += cells * through_count(body.wall)
    through = sheet_nodes / sheet_area if sheet_area else 1.0
    return Size(volume=volume, area=area, sheet_area=sheet_area, through=through)


class Forecast(NamedTuple):
    """Expected error and cost of a candidate."""

    error: float
    run_time: float
    """[s]"""
    memory: float
    """[bytes]"""


class Predictor:
    """Models of error and run time, fitted to all runs so far."""

    def __init__(
        self,
        runs: Sequence[Measured],
        errors: Sequence[tuple[Candidate, float]],
        end: float,
        size: Size,
    ):
        """Fit to the runs.

        Args:
            runs: candidates that were run.
            errors: candidates whose errors are known without a run.
            end: of the scene's run [s].
            size: of the bodies.
        """
        self._runs = tuple(runs)
        self._end = end
        self._errors = [*((f.candidate, f.error) for f in runs), *errors]
        self._size = size
        self._lines = tuple(dict.fromkeys(run.candidate.line for run in runs))
        self._error_values = self._fit_errors()
        self._cost_values = self._fit_costs()

    def forecast(self, candidate: Candidate) -> Forecast:
        """Expected error, run time and memory."""
        nodes = self._nodes(candidate)
        evaluations = self._evaluations(candidate, self._stable_step(candidate))
        time = self._plain_time(candidate, evaluations, nodes)
        time *= self._left_over(
            candidate,
            lambda f: f.run_time / self._time_of(f),
        )
        error = math.exp(self._log_error(self._error_values, candidate))
        error *= self._left_over(
            candidate,
            lambda f: f.error / self._error_of(f),
        )
        per_node = self._left_over(candidate, lambda f: f.memory / self._bytes_of(f))
        memory = (nodes + self._fragments(candidate)) * per_node * 100.0
        return Forecast(error, time, memory)

    def _fit_errors(self) -> Float[np.ndarray, " v"]:
        logs = np.log([max(error, 1e-12) for _, error in self._errors])
        start = self._prior(float(logs.max()))

        def residuals(values: np.ndarray) -> np.ndarray:
            off = [
                self._log_error(values, candidate) - log
                for (candidate, _), log in zip(self._errors, logs, strict=True)
            ]
            spread = np.full(len(start), 3.0)
            spread[:4] = _ORDER_SPREAD
            return np.concatenate([np.array(off) / 0.1, (values - start) / spread])

        return least_squares(residuals, start, method="trf").x

    def _prior(self, largest: float) -> np.ndarray:
        # Orders, then logarithms of the coefficients: that of voxels, those of steps
        # of second order and of Euler, and one for each line.
        candidates = [candidate for candidate, _ in self._errors]
        coarsest = math.log(max(candidate.size for candidate in candidates))
        voxels = math.log(max(1 / candidate.refinement for candidate in candidates))
        steps = min((f.steps for f in self._runs if f.steps), default=10)
        lines = [largest - 1.0 - _ORDERS["structure"] * coarsest] * len(self._lines)
        coefficients = [
            largest - 1.0 - _ORDERS["voxels"] * voxels,
            largest - 2.0 + _ORDERS["second"] * math.log(steps),
            largest - 2.0 + _ORDERS["euler"] * math.log(steps),
        ]
        return np.array([*_ORDERS.values(), *coefficients, *lines])

    def _log_error(self, values: np.ndarray, candidate: Candidate) -> float:
        p, q, r_euler, r_second = values[:4]
        c_voxels, c_second, c_euler = values[4:7]
        log_errors = [c_voxels - p * math.log(candidate.refinement)]
        line = candidate.line
        if candidate.family not in ("full_volume", "sheet"):
            # A line that was not run is like those that were.
            line_values = values[7:]
            c = (
                line_values[self._lines.index(line)]
                if line in self._lines
                else line_values.mean()
            )
            log_errors.append(c + q * math.log(candidate.size))
        is_euler = candidate.method == "forward_euler"
        steps = candidate.steps or self._end / self._stable_step(candidate)
        r, c = (r_euler, c_euler) if is_euler else (r_second, c_second)
        log_errors.append(c - r * math.log(max(steps, 1.0)))
        return 0.5 * float(np.logaddexp.reduce(2 * np.array(log_errors)))

    def _error_of(self, run: Measured) -> float:
        return math.exp(self._log_error(self._error_values, run.candidate))

    def _fit_costs(self) -> dict[_Line, np.ndarray]:
        """Logarithms of the times of an evaluation and of a node in it, by line."""
        values = {}
        for line in dict.fromkeys(_cost_line(f.candidate) for f in self._runs):
            runs = [f for f in self._runs if _cost_line(f.candidate) == line]
            counts = np.array([(f.steps * f.stages, f.nodes) for f in runs], float)
            evaluations = counts[:, :1] * np.stack(
                [np.ones(len(runs)), counts[:, 1]], 1
            )
            times = np.array([f.run_time for f in runs])
            fitted = least_squares(
                _cost_residuals, _LOG_COSTS, args=(evaluations, times)
            )
            values[line] = fitted.x
        return values

    def _plain_time(
        self, candidate: Candidate, evaluations: float, nodes: float
    ) -> float:
        logs = self._cost_values.get(_cost_line(candidate))
        if logs is None:
            logs = np.mean(list(self._cost_values.values()), axis=0)
            logs = logs + math.log(_SOLVE) * (candidate.method == "trbdf2")
        a, c = np.exp(logs).tolist()
        return evaluations * (a + c * nodes)

    def _time_of(self, run: Measured) -> float:
        evaluations = float(run.steps * run.stages)
        return self._plain_time(run.candidate, evaluations, float(run.nodes))

    def _stable_step(self, candidate: Candidate) -> float:
        """Largest stable step, which rises with the square of the cells' size [s]."""
        alike = [f for f in self._runs if f.candidate.line == candidate.line]
        runs = [f for f in alike or self._runs if math.isfinite(f.stable_step)]
        if not runs:
            return math.inf
        size = _cell_size(candidate)
        near = min(runs, key=lambda f: abs(math.log(_cell_size(f.candidate) / size)))
        return near.stable_step * (size / _cell_size(near.candidate)) ** 2

    def _evaluations(self, candidate: Candidate, stable: float) -> float:
        # s stages of RKL2 cover (s^2 + s - 2) / 4 stable steps.
        if not candidate.steps:
            return self._end / stable
        if candidate.method == "trbdf2":
            return float(candidate.steps)
        ratio = self._end / candidate.steps / stable
        return candidate.steps * max(3.0, (math.sqrt(9 + 16 * ratio) - 1) / 2)

    def _nodes(self, candidate: Candidate) -> float:
        return expected_nodes(candidate, self._size) * self._left_over(
            candidate, lambda f: f.nodes / expected_nodes(f.candidate, self._size)
        )

    def _fragments(self, candidate: Candidate) -> float:
        size = self._size
        of_sheets = 4.0 * size.sheet_area / candidate.size**2
        return 1.5 * size.area * candidate.refinement**2 + of_sheets

    def _bytes_of(self, run: Measured) -> float:
        return 100.0 * (run.nodes + run.fragments)

    def _left_over(
        self, candidate: Candidate, ratio: Callable[[Measured], float]
    ) -> float:
        """Factor by which runs of the same line nearby are off."""
        total = 0.0
        weights = _FLOOR
        for run in self._runs:
            run_candidate = run.candidate
            if run_candidate.line != candidate.line:
                continue
            weight = math.exp(-_distance(run_candidate, candidate))
            total += weight * math.log(ratio(run))
            weights += weight
        return math.exp(total / weights)


def expected_nodes(candidate: Candidate, size: Size) -> float:
    """Number of nodes of a candidate before it is built."""
    voxel = 1 / candidate.refinement
    block = candidate.size
    cells = size.volume / voxel**3
    blocks = size.volume / block**3 + 0.6 * size.area / block**2
    layer = min(size.area / voxel**2, cells)
    of_solids = {
        "full_volume": cells,
        "aggregate": blocks,
        "octree": min(2.0 * layer, cells),
        "shell_over_core": min(layer + blocks, cells),
        "sheet": 0.0,
    }[candidate.family]
    through = 1.0
    if size.through > 1:
        # Half as wide at both faces, and each cell wider than the one before.
        through = max(size.through - 2 * math.log(block) / math.log(GROWTH), 1.0)
    return of_solids + through * size.sheet_area / block**2


_LOG_COSTS = np.log([_PER_EVALUATION, _PER_NODE])


def _cell_size(candidate: Candidate) -> float:
    # Cells of an octree or of a shell are voxels.
    if candidate.family == "aggregate":
        return candidate.size
    return 1 / candidate.refinement


def _distance(a: Candidate, b: Candidate) -> float:
    """Sum of the logarithms of the ratios of their sizes, in those of _NEARBY."""
    steps = (a.steps or 1000) / (b.steps or 1000)
    ratios = (a.refinement / b.refinement, a.factor / b.factor, steps)
    return sum(abs(math.log(ratio)) for ratio in ratios) / math.log(_NEARBY)


def _cost_line(candidate: Candidate) -> _Line:
    return *candidate.line, candidate.method == "trbdf2"


def _cost_residuals(
    logs: Float[np.ndarray, " 2"],
    evaluations: Float[np.ndarray, "r 2"],
    times: Float[np.ndarray, " r"],
) -> Float[np.ndarray, " n"]:
    # Relative differences count: runs of milliseconds as much as those of seconds.
    return np.concatenate(
        [np.log(evaluations @ np.exp(logs) / times), (logs - _LOG_COSTS) / 2.0]
    )
