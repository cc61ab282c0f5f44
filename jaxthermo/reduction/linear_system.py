"""A linear scene as state space, with its operators applied and solved, not assembled.

    C dx/dt = -K x + sum_j b_j u_j(t),    y = T_ref + R x + sum_j d_j u_j(t),

x temperatures of all nodes above the reference of their body [K], C capacities [J/K],
K conduction with what linear surface terms and contacts take off [W/K], b_j the heat
rate of every node by one unit of input j [W per unit], y the surface temperatures [K],
R the surface map and d_j what input j adds at the surface above the nodes [K per unit].
All in float64: a slow mode is a small difference of large conductances.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..arrays import is_traced, precision
from ..choices import Dtype
from ..errors import InputError
from ..integrate.heat_rates import load_slopes, pair_values
from ..integrate.implicit.conjugate_gradient import ConjugateGradient, ResidualNorm
from ..integrate.implicit.jacobian import (
    ImplicitContext,
    arranged_for_solves,
    implicit_context,
    linearize,
)
from ..integrate.implicit.newton_stage import solve_linear
from ..physics.contact.links import PairNodes
from ..scene.compile.compile import compile_scene
from ..scene.compile.program import Compiled, Program, State
from ..scene.scene import Scene, SolvedSurface
from ..structures.surface_map import SurfaceState
from .inputs import Input, find_inputs
from .reduced_model import sampled


_TOLERANCE = 1e-9
"""Largest residual of a solve over the largest heat rate of its right-hand side [-]."""

Nodes = Float[np.ndarray, " n"]


class _Layout:
    """Nodes of all bodies in one vector, body after body."""

    def __init__(self, scene: Scene):
        structures = [body.structure for body in scene.bodies]
        self.shapes = [structure.state_shape for structure in structures]
        self.address = [structure.node_address() for structure in structures]
        counts = [structure.node_count for structure in structures]
        self.first = np.cumsum([0, *counts])

    def pack(self, states: State) -> Nodes:
        """Values of the nodes in one vector."""
        pairs = zip(states, self.address, strict=True)
        return np.concatenate([np.asarray(s, float)[where] for s, where in pairs])

    def unpack(self, values: Nodes) -> State:
        """One state per body; 0 where a lattice has no node."""
        states = []
        for body, (shape, where) in enumerate(
            zip(self.shapes, self.address, strict=True)
        ):
            state = np.zeros(shape)
            state[where] = values[self.first[body] : self.first[body + 1]]
            states.append(jnp.asarray(state))
        return tuple(states)

    def number(self, body: int, address: tuple[Any, ...]) -> Int[np.ndarray, " m"]:
        """Numbers in the vector of nodes at positions in a body's state."""
        numbers = np.full(self.shapes[body], -1)
        count = self.first[body + 1] - self.first[body]
        numbers[self.address[body]] = self.first[body] + np.arange(count)
        return numbers[tuple(np.asarray(index) for index in address)]


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """C, K, R and the inputs of a linear scene."""

    compiled: Compiled
    context: Callable[[], ImplicitContext]
    """Preconditioners and tolerances of the solves, prepared at the first call."""
    layout: _Layout
    inputs: tuple[Input, ...]
    dtype: Dtype
    """Type of the original scene; the system computes in float64."""

    @property
    def program(self) -> Program:
        """The only program of the scene: nothing moves."""
        return self.compiled.program

    @property
    def surfaces(self) -> tuple[SolvedSurface, ...]:
        """Surface of each body."""
        return self.compiled.surfaces

    @cached_property
    def capacity(self) -> Nodes:
        """Heat capacity of every node [J/K]."""
        pairs = zip(self.program.bodies, self.compiled.state_shapes, strict=True)
        with precision("float64"):
            capacities = [
                jnp.broadcast_to(body.network.capacity(), shape)
                for body, shape in pairs
            ]
            return self.layout.pack(tuple(capacities))

    @cached_property
    def start(self) -> Nodes:
        """Initial temperature of every node above the reference [K]."""
        with precision("float64"):
            return self.layout.pack(self.compiled.state)

    @cached_property
    def heat(self) -> Float[np.ndarray, "n k"]:
        """Heat rate of every node by one unit of each input [W per unit]."""
        columns = np.zeros((len(self.capacity), len(self.inputs)))
        for column, column_input in enumerate(self.inputs):
            for body, address, values in column_input.heat:
                np.add.at(columns[:, column], self.layout.number(body, address), values)
        return columns

    @cached_property
    def loss(self) -> Nodes:
        """Heat that every node loses by surface terms, part of K [W/K]."""
        with precision("float64"):
            slopes = _load_slopes(self.program, _zero(self.compiled.state))
            return self.capacity * self.layout.pack(slopes)

    @cached_property
    def direct(self) -> Float[np.ndarray, "s k"]:
        """Surface above the nodes by one unit of each input [K per unit]."""
        if not self.inputs:
            return np.zeros((len(self.reference), 0))
        with precision("float64"):
            columns = [
                np.concatenate(
                    [
                        _mapped(self.program, body, jnp.asarray(values))
                        for body, values in enumerate(column_input.excess)
                    ]
                )
                for column_input in self.inputs
            ]
        return np.stack(columns, axis=1)

    @cached_property
    def reference(self) -> Float[np.ndarray, " s"]:
        """Reference of the body of every fragment [K]."""
        bodies = zip(self.program.bodies, self.surfaces, strict=True)
        return np.concatenate(
            [
                np.full(len(s.geometry.fragment_area), float(body.reference))
                for body, s in bodies
            ]
        )

    @property
    def area(self) -> Float[np.ndarray, " s"]:
        """Area of every fragment [m^2]."""
        return np.concatenate([s.geometry.fragment_area for s in self.surfaces])

    def amplitudes(self, knots: Sequence[float]) -> Float[np.ndarray, "q k"]:
        """Amplitude of every input at knots, before a jump at the first of a pair."""
        columns = [sampled(load.amplitude, tuple(knots)) for load in self.inputs]
        return np.stack(columns, axis=1) if columns else np.zeros((len(knots), 0))

    def with_inputs(self, further: Sequence[Input]) -> "LinearSystem":
        """The system with further inputs, which get names that are not used yet."""
        inputs = list(self.inputs)
        names = {scene_input.name for scene_input in inputs}
        for new_input in further:
            name = new_input.name
            count = 1
            while name in names:
                count += 1
                name = f"{new_input.name} {count}"
            names.add(name)
            inputs.append(replace(new_input, name=name))
        return replace(self, inputs=tuple(inputs))

    def conduct(self, values: Nodes) -> Nodes:
        """K x [W]."""
        with precision("float64"):
            states = self.layout.unpack(values)
            return self.layout.pack(_conducted(self.program, self.context(), states))

    def solve(self, rate: float, heat: Nodes) -> Nodes:
        """Solution x of (rate C + K) x = heat, for a rate in 1/s.

        Raises:
            InputError: if the solve stops short of its tolerance.
        """
        with precision("float64"):
            states = self.layout.unpack(heat)
            solution, converged = _solved(
                self.program,
                context=self.context(),
                rate=jnp.asarray(float(rate)),
                heat=states,
            )
            if not bool(converged):
                raise InputError(
                    f"reduce: a linear solve for the rate {rate:.3g} 1/s stopped short "
                    "of its tolerance: check the materials for values far out of range"
                )
            return self.layout.pack(solution)

    def read(self, values: Nodes) -> Float[np.ndarray, " s"]:
        """R x [K]."""
        with precision("float64"):
            return np.asarray(_read(self.program, self.layout.unpack(values)))


def linear_system(scene: Scene, t1: float) -> LinearSystem:
    """Compile a scene and check that all of it is linear.

    Args:
        scene: bodies and terms.
        t1: end of the time that the reduced model is for [s].

    Raises:
        InputError: naming what is not linear.
    """
    if is_traced(scene):
        raise InputError("reduce: the scene holds traced values: give numbers")
    arranged = arranged_for_solves(replace(scene, dtype="float64"))
    with precision("float64"):
        compiled = compile_scene(
            arranged,
            1,
            t1,
            method="implicit",
            save_times=(float(t1),),
            joins=False,
        )
        inputs = find_inputs(compiled, t1)

    @cache
    def context() -> ImplicitContext:
        return implicit_context(
            arranged,
            compiled=compiled,
            stable_step=float(compiled.stable_step),
            max_dt=t1,
            tolerance=None,
            traced=False,
        )

    return LinearSystem(
        compiled=compiled,
        context=context,
        layout=_Layout(arranged),
        inputs=inputs,
        dtype=scene.dtype,
    )


def _zero(states: State) -> State:
    return jax.tree.map(jnp.zeros_like, states)


@eqx.filter_jit
def _load_slopes(program: Program, states: State) -> State:
    slopes, _ = load_slopes(program, states, jnp.zeros((), states[0].dtype))
    pairs = zip(slopes, states, strict=True)
    return tuple(jnp.broadcast_to(slope, state.shape) for slope, state in pairs)


@eqx.filter_jit
def _conducted(program: Program, context: ImplicitContext, states: State) -> State:
    zero = jnp.zeros((), states[0].dtype)
    return linearize(
        program, context=context, states=_zero(states), rate=zero, time=zero
    ).operator.mv(states)


@eqx.filter_jit
def _solved(
    program: Program, context: ImplicitContext, rate: Float[Array, ""], heat: State
) -> tuple[State, Array]:
    at = linearize(
        program,
        context=context,
        states=_zero(heat),
        rate=rate,
        time=jnp.zeros_like(rate),
    )
    solver = ConjugateGradient(ResidualNorm(1.0), _TOLERANCE, relative=True)
    solve = solve_linear(at, heat, solver)
    return solve.change, solve.converged


@eqx.filter_jit
def _read(program: Program, states: State) -> Float[Array, " s"]:
    # Without limits the surface is affine in the states: subtract its temperature at
    # states of 0.
    time = jnp.zeros((), states[0].dtype)
    above, zero = (
        jnp.concatenate(
            program.surface_temperatures(
                read_states,
                time,
                _by_contacts(program, read_states),
                is_limited=False,
            )
        )
        for read_states in (states, _zero(states))
    )
    return above - zero


def _by_contacts(program: Program, states: State) -> list[Any]:
    """Excess of each body's fragments over their nodes by contacts [K]."""
    excess: list[Any] = [None] * len(program.bodies)
    zero = jnp.zeros((), states[0].dtype)
    for contact in program.contacts:
        first, second = pair_values(contact, states)
        heat = contact.heat(zero, PairNodes((first, second), (zero, zero)))
        for side, body in enumerate(contact.bodies):
            fragments = program.bodies[body].node.shape[0]
            side_excess = contact.fragment_excess(heat.excess, side, fragments)
            excess[body] = (
                side_excess if excess[body] is None else excess[body] + side_excess
            )
    return excess


@eqx.filter_jit
def _mapped(program: Program, number: int, excess: Float[Array, " s"]):
    """Reading of a body's fragments with an excess over nodes that are all at 0 [K]."""
    body = program.bodies[number]
    capacity = body.network.capacity()
    shape = jax.eval_shape(body.network.diagonal).shape
    theta = jnp.zeros(shape, capacity.dtype)
    nodes, _ = body.below(theta)
    held = program.held_fragments()[number]
    acting = SurfaceState(excess, held=held, equilibrium=None)
    return body.surface_map.read(theta, nodes, body.node, acting)
