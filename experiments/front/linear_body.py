"""Plain arrays of one body's full volume, for solvers written by hand.

At the node i of each solid voxel, T above the reference temperature of the scene:

    C_i dT_i/dt = sum_j G_ij (T_j - T_i) + q_i(t) - s_i T_i    [W],

with the voxels, open areas, capacities and loads of the compiled scene. Nodes at the
surface have rows of their own. All others have six equal links, in runs along z.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxthermo.arrays import precision
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.plan import Plan, observation_time, plan_run
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.network.cut_stencil import CutStencil
from jaxthermo.network.stencil import Stencil, solid_degree
from jaxthermo.physics.run_conduction import NodeCells
from jaxthermo.reduction.linear_system import LinearSystem, linear_system
from jaxthermo.scene.scene import Scene, SolvedSurface
from jaxthermo.voxels.grid import VoxelGrid


_WITHIN = (0.01, 0.5, 0.99)
"""Fractions of an interval at which its loads are the same [-]."""


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
    counts = [int(np.ceil(span / dt * (1 - 1e-9))) for span in spans]
    return [max(1, count) for count in counts]


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
        plan = plan_run(scene, t1=end, save_at=save_at, solver=ForwardEuler())
        return _linear_body(scene, plan)


def _linear_body(scene: Scene, plan: Plan) -> LinearBody:
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
    system = linear_system(scene, plan.save_times[-1])
    loaded = np.flatnonzero((system.loss > 0) | system.heat.any(axis=1))
    # Amplitudes are those of spans: at their start, and just before their end.
    observed = [
        time
        for i in plan.intervals
        if i.saved
        for time in (i.start + observation_time(plan, i), i.end)
    ]
    grid = plan.scene.bodies[0].structure.voxels
    address = tuple(np.asarray(index) for index in body.address)
    cell = np.ravel_multi_index(address, theta.shape)
    rows = {t: n for n, t in enumerate(plan.save_times)}
    return LinearBody(
        grid=grid,
        conductance=float(base.conductance),
        capacity=float(base.node_capacity),
        surfaces=compiled.surfaces,
        reference=float(body.reference),
        start=np.asarray(theta).reshape(-1),
        intervals=tuple(
            (interval.start, interval.end, rows.get(interval.end, -1))
            for interval in plan.intervals
        ),
        save_times=plan.save_times,
        stable_step=float(compiled.stable_step),
        loaded=np.flatnonzero(np.pad(grid.solid, 1))[loaded],
        gain=_gain(system, plan, loaded),
        loss=system.loss[loaded],
        read_cell=cell[np.asarray(body.node)],
        read_factor=system.read(np.ones(len(system.capacity))),
        read_offset=system.amplitudes(observed)[::2] @ system.direct.T,
    )


def _gain(
    system: LinearSystem, plan: Plan, loaded: Int[np.ndarray, " p"]
) -> Float[np.ndarray, "i p"]:
    """Heat rate of the loaded nodes at the reference temperature by interval [W]."""
    gain = []
    for i in plan.intervals:
        first, half, last = (i.start + f * (i.end - i.start) for f in _WITHIN)
        rates = system.amplitudes([first, half, half, last]) @ system.heat[loaded].T
        middle = rates[2]
        if not np.allclose(rates, middle, rtol=1e-5):
            raise InputError(
                "rivals written by hand have loads that are constant between events: "
                f"one changes within {i.start:g} to {i.end:g} s"
            )
        gain.append(middle)
    return np.stack(gain)
