"""Plain arrays of one body's full volume, for solvers written by hand.

At the node i of each solid voxel, T above the reference temperature of the scene:

    C_i dT_i/dt = sum_j G_ij (T_j - T_i) + q_i(t) - s_i T_i    [W],

with the voxels, open areas, capacities and loads of the compiled scene. Nodes at the
surface have rows of their own. All others have six equal links, in runs along z.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxthermo.arrays import precision
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.plan import Plan, observation_time, plan_run
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.network.cut_stencil import CutStencil
from jaxthermo.network.stencil import Stencil, solid_degree
from jaxthermo.physics.run_conduction import NodeCells
from jaxthermo.scene.scene import Scene, SolvedSurface
from jaxthermo.voxels.grid import VoxelGrid


_PROBE = 1000.0
"""Temperature of all nodes at which linear loads are evaluated in addition to 0 [K]:
slopes are differences, which lose few digits of float32 between values so far apart."""


class Run(NamedTuple):
    """A solver that is ready to run, with its cost."""

    call: Callable[[], Float[np.ndarray, "t s"]]
    """Surface temperatures of all fragments at the saved times [K]."""
    steps: int
    memory_bytes: int
    """Memory of the solver's arrays."""


_Intervals = tuple[tuple[float, float, int], ...]
"""Start, end [s] and row of the saved time or -1; loads are constant in each."""


def step_counts(intervals: _Intervals, dt: float) -> list[int]:
    """Number of steps up to `dt` [s] in each interval."""
    spans = (end - start for start, end, _ in intervals)
    return [max(1, int(np.ceil(span / dt * (1 - 1e-9)))) for span in spans]


class _Rows(NamedTuple):
    """Links of some nodes in compressed rows."""

    node: Int[np.ndarray, " m"]
    """Position of each node in the state, increasing."""
    first: Int[np.ndarray, " m_and_1"]
    column: Int[np.ndarray, " e"]
    """Position of each linked node."""
    conductance: Float[np.ndarray, " e"]
    """Conductance of each link [W/K]."""
    capacity: Float[np.ndarray, " m"]
    """Heat capacity of the nodes [J/K]."""


@dataclass(frozen=True, eq=False)
class LinearBody:
    """A full volume of one material under linear loads."""

    grid: VoxelGrid
    conductance: float
    """Conductance of a whole link, k x pitch [W/K]."""
    capacity: float
    """Heat capacity of a whole voxel [J/K]."""
    surfaces: tuple[SolvedSurface, ...]
    reference: float
    """Temperature from which the state counts [K]."""
    start: Float[np.ndarray, " cells"]
    """Initial state of every cell of the lattice with its rim [K]."""
    intervals: _Intervals
    save_times: tuple[float, ...]
    stable_step: float
    """Largest explicit step [s]."""
    loaded: Int[np.ndarray, " p"]
    """Cells of nodes with loads, increasing."""
    gain: Float[np.ndarray, "i p"]
    """Heat rate of the loaded nodes at the reference temperature by interval [W]."""
    loss: Float[np.ndarray, " p"]
    """Loss of the loaded nodes per kelvin [W/K]."""
    read_cell: Int[np.ndarray, " s"]
    """Cell of the node of each fragment."""
    read_factor: Float[np.ndarray, " s"]
    """Surface temperature of a fragment per kelvin of its node [-]."""
    read_offset: Float[np.ndarray, "t s"]
    """Surface temperature of a fragment over a node at the reference, at each saved
    time [K]."""
    layout: str = "compact"
    """States have a value per solid voxel, or with "dense" one per cell."""

    @cached_property
    def node_cells(self) -> NodeCells:
        """All cells with the positions of their nodes in a state; -1 where none is."""
        inside = np.pad(self.grid.solid, 1)
        if self.layout == "dense":
            position = np.arange(inside.size, dtype=np.int32)
        else:
            position = np.full(inside.size, -1, np.int32)
            position[self.cells] = np.arange(len(self.cells), dtype=np.int32)
        return NodeCells(inside.shape, inside.reshape(-1), position)

    @property
    def position(self) -> Int[np.ndarray, " cells"]:
        """Position of each cell in a state, -1 where there is none."""
        return self.node_cells.position

    @cached_property
    def cells(self) -> Int[np.ndarray, " n"]:
        """Cells of all nodes, increasing."""
        return np.flatnonzero(np.pad(self.grid.solid, 1))

    @property
    def size(self) -> int:
        """Length of a state."""
        return len(self.position) if self.layout == "dense" else len(self.cells)

    def with_layout(self, layout: str) -> "LinearBody":
        """Body with states of another layout."""
        return replace(self, layout=layout)

    def initial(self) -> Float[np.ndarray, " n"]:
        """The initial state [K]."""
        if self.layout == "dense":
            return self.start.astype(np.float32)
        return self.start[self.cells].astype(np.float32)

    @cached_property
    def surface_cells(self) -> Int[np.ndarray, " m"]:
        """Cells of nodes that differ from one deep inside, increasing."""
        differs = np.zeros(len(self.position), bool)
        degree = np.pad(solid_degree(self.grid.solid), 1).reshape(-1)
        differs[self.cells] = degree[self.cells] < 6
        differs[self.loaded] = True
        cut = self.grid.cut
        if cut is not None:
            for voxel in (cut.voxel, cut.links.voxel, cut.links.voxel + cut.links.step):
                differs[self.node_cells.at(voxel)] = True
        return np.flatnonzero(differs)

    def rows(self, cells: Int[np.ndarray, " m"]) -> _Rows:
        """Links of the nodes of some cells, which include all at the surface."""
        cut = self.grid.cut
        table = self.node_cells.links(cells, cut, self.size)
        return _Rows(
            node=self.position[cells],
            first=table.indptr,
            column=table.indices,
            conductance=self.conductance * table.data,
            capacity=self.capacity * self.node_cells.volumes(cells, cut),
        )

    def runs(self) -> Int[np.ndarray, "r 6"]:
        """Runs along z of nodes with six whole links, by positions in the state.

        A row has the position of the first node, the number of nodes, and the positions
        of the first one's neighbours along +x, -x, +y, -y; the others of a run follow
        one after the other in every layout.
        """
        interior = self.node_cells.inside.copy()
        interior[self.surface_cells] = False
        return self.node_cells.runs(interior)


def linear_body(
    scene: Scene, end: float, save_at: Sequence[float] | None = None
) -> LinearBody:
    """Arrays of one full volume up to the end of a run [s].

    Raises:
        InputError: if the scene is more than one body of one isotropic material with
            constant properties, under surface terms that are linear and constant
            between events.
    """
    with precision(scene.dtype):
        return _linear_body(
            plan_run(scene, t1=end, save_at=save_at, solver=ForwardEuler())
        )


def _linear_body(plan: Plan) -> LinearBody:
    compiled = plan.compiled
    program = compiled.program
    network = program.bodies[0].network
    base = network.base if isinstance(network, CutStencil) else network
    is_single = len(program.bodies) == 1 and len(compiled.programs) == 1
    linear = program.fragment_terms.is_linear and program.enclosure is None
    if not (
        is_single
        and linear
        and isinstance(base, Stencil)
        and base.conductance.ndim == 0
    ):
        raise InputError(
            "rivals written by hand have one full volume of one isotropic material "
            "with constant properties, and linear surface terms: this scene has none"
        )
    body = program.bodies[0]
    if program.contacts or body.sources or body.surface_map.gradient is not None:
        raise InputError("rivals written by hand have surface loads only")
    theta = compiled.state[0]
    loads = _loads(plan, theta.shape)
    factor, offset = _readings(plan)
    address = tuple(np.asarray(index) for index in body.address)
    cell = np.ravel_multi_index(address, theta.shape)
    rows = {t: n for n, t in enumerate(plan.save_times)}
    return LinearBody(
        grid=plan.scene.bodies[0].structure.grid,
        conductance=float(base.conductance),
        capacity=float(base.node_capacity),
        surfaces=compiled.surfaces,
        reference=float(body.reference),
        start=np.asarray(theta).reshape(-1),
        intervals=tuple((i.start, i.end, rows.get(i.end, -1)) for i in plan.intervals),
        save_times=plan.save_times,
        stable_step=float(compiled.stable_step),
        loaded=loads.cells,
        gain=loads.gain,
        loss=loads.loss,
        read_cell=cell[np.asarray(body.node)],
        read_factor=factor,
        read_offset=offset,
    )


class _Loads(NamedTuple):
    """Linear loads of some cells."""

    cells: Int[np.ndarray, " p"]
    gain: Float[np.ndarray, "i p"]
    """Heat rate at the reference temperature by interval [W]."""
    loss: Float[np.ndarray, " p"]
    """Loss per kelvin above it [W/K]."""


def _loads(plan: Plan, shape: tuple[int, ...]) -> _Loads:
    program = plan.compiled.program
    if program.surface is None:
        return _Loads(
            cells=np.zeros(0, int),
            gain=np.zeros((len(plan.intervals), 0)),
            loss=np.zeros(0),
        )
    load = program.surface.by_cell
    (cells,) = load.cells
    zero = jnp.zeros(cells.node.shape, plan.dtype)

    def heat(time: float, theta: Any) -> np.ndarray:
        heat_rate = load.terms.heat(jnp.asarray(time, plan.dtype), theta)[0]
        return np.bincount(
            cells.node, np.asarray(heat_rate, float), len(cells.slots[0])
        )

    gain = []
    for i in plan.intervals:
        inner = [heat(i.start + f * (i.end - i.start), zero) for f in (0.01, 0.5, 0.99)]
        if not all(np.allclose(rates, inner[0], rtol=1e-5) for rates in inner):
            raise InputError(
                "rivals written by hand have loads that are constant between events: "
                f"one changes within {i.start:g} to {i.end:g} s"
            )
        gain.append(inner[1])
    middle = (plan.intervals[0].start + plan.intervals[0].end) / 2
    loss = (gain[0] - heat(middle, zero + _PROBE)) / _PROBE
    address = tuple(np.asarray(index) for index in cells.address)
    return _Loads(
        cells=np.ravel_multi_index(address, shape), gain=np.stack(gain), loss=loss
    )


def _readings(plan: Plan) -> tuple[Any, Any]:
    """Factor [-] and offset [K] of every fragment's temperature at the saved times."""
    program = plan.compiled.program
    state = plan.compiled.state[0]

    def surface(time: float, level: float) -> np.ndarray:
        uniform = jnp.full_like(state, level)
        temperatures = program.surface_temperatures(
            (uniform,), jnp.asarray(time, plan.dtype), [None]
        )
        return np.asarray(temperatures[0], float)

    times = [observation_time(plan, i) for i in plan.intervals if i.saved]
    offset = np.stack([surface(t, 0.0) for t in times])
    factor = (surface(times[0], _PROBE) - offset[0]) / _PROBE
    return factor, offset
