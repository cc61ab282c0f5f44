"""Sections of four devices that are evaluated while planes are on their way."""

import re
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.network.network import StepStart
from jaxthermo.network.overlap import apply_after_exchange, apply_overlapping_exchange
from jaxthermo.network.sharded_stencil import ShardedStencil
from jaxthermo.parallel.lattice import next_planes, on_each_device, spread
from jaxthermo.physics.conduction import material_network
from tests.xla_flags import HAS_FUSION_EMITTERS_FLAG


STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0)
DT = jnp.float32(1e-3)
WEIGHT = jnp.float32(0.7)
AS_USERS_RUN = {
    "xla_backend_optimization_level": 3,
    "xla_cpu_parallel_codegen_split_count": 32,
    **({"xla_cpu_use_fusion_emitters": True} if HAS_FUSION_EMITTERS_FLAG else {}),
}
"""Whatever flags a process has: their fusions are what is looked at here."""


def combined(stepped, previous, weight):
    return previous + weight * (stepped - previous)


def combined_with_rise(stepped, rise, previous, weight):
    return combined(stepped, previous, weight) + weight * rise


def step(stencil, state, previous):
    return combined(stencil.euler_step(state, DT), previous, WEIGHT)


def only_ends_wait(voxels: int) -> None:
    """Both forms have the values of one device; one waits for planes at the ends only.

    Where sections have no more than two planes, all of them are ends.
    """
    grid = jt.voxelize(jt.shapes.sphere(0.05), 0.1 / voxels, "dominant_axis")
    undivided = jt.FullVolume(grid)
    divided = replace(undivided, devices=4)
    random = np.random.default_rng(0)
    values = random.normal(size=(2, undivided.node_count)).astype(np.float32)
    network = material_network(undivided, STEEL, 300.0, jnp.float32)
    state, previous = (jnp.asarray(undivided.state_of(nodes)) for nodes in values)
    program = jax.jit(step).lower(network, state, previous).compile(AS_USERS_RUN)
    expected = undivided.node_values(np.asarray(program(network, state, previous)))
    network = material_network(divided, STEEL, 300.0, jnp.float32)
    assert isinstance(network, ShardedStencil)
    states = [spread(network.devices, divided.state_of(nodes)) for nodes in values]
    is_thin = len(states[0]) <= 4 * 4
    for form in (apply_after_exchange, apply_overlapping_exchange):
        program = _program(form, network, states)
        actual = divided.node_values(np.asarray(program(network.base, *states)))
        np.testing.assert_array_equal(actual, expected)
        text = program.as_text()
        assert text is not None
        assert _waits(text, states[0]) == (form is apply_after_exchange or is_thin)
    if not is_thin:
        no_copy(network, states)


def _program(form, network, states):
    def step_section(base, state, previous):
        return form(step, base, state, next_planes(state), (previous,))

    run = partial(on_each_device, network.devices, step_section)
    return jax.jit(run).lower(network.base, *states).compile(AS_USERS_RUN)


def no_copy(network: ShardedStencil, states: list[jax.Array]) -> None:
    """Two stages, as of RKL2, that exchange their buffers copy no lattice."""

    @partial(jax.jit, donate_argnums=0)
    def stages(pair, start, count):
        def stage(previous, change):
            return network.combined_step(
                change, start, DT, combined_with_rise, previous, WEIGHT
            )

        def two_stages(_, pair):
            previous, change = pair
            stepped = stage(previous, change)
            return stepped, stage(change, stepped)

        return jax.lax.fori_loop(0, count, two_stages, pair)

    start = StepStart(state=states[0], rise=states[1])
    lowered = stages.lower(tuple(states), start, jnp.int32(3))
    text = lowered.compile(AS_USERS_RUN).as_text()
    assert text is not None
    computations = text.split("\n}")
    loop = next(body for body in computations if "collective-permute(" in body)
    assert not re.search(rf"= {_section(states[0])}\S* copy\(", loop), loop


def _section(state: jax.Array) -> str:
    """Type of a section in the text of a compiled program."""
    return re.escape("f32[{},{},{}]".format(*state.addressable_data(0).shape))


def _waits(text: str, state: jax.Array) -> bool:
    """True if every section that is computed needs planes of other devices."""
    line = re.compile(r"%(\S+) = (\S+) ([\w-]+)\((.*)")
    waiting = {}
    computed = []
    for name, section, operation, operands in line.findall(text[text.index("ENTRY") :]):
        operand_names = re.findall(r"%([\w.-]+)", operands)
        needs = [waiting.get(operand, False) for operand in operand_names]
        waiting[name] = operation.startswith("collective-permute") or any(needs)
        if re.match(_section(state), section) and operation == "fusion":
            computed.append(waiting[name])
    assert any(computed)
    return all(computed)
