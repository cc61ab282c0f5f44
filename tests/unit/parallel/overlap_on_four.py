"""Sections of four devices that are evaluated while planes are on their way."""

import re
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
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


def combined(stepped, other, weight):
    return other + weight * (stepped - other)


def step(stencil, state, other):
    return combined(stencil.euler_step(state, DT), other, WEIGHT)


def only_ends_wait(voxels: int) -> None:
    """Both forms have the values of one device; one waits for planes at the ends only.

    Where sections have no more than two planes, all of them are ends.
    """
    grid = jt.voxelize(jt.shapes.sphere(0.05), 0.1 / voxels, "dominant_axis")
    one = jt.FullVolume(grid)
    four = replace(one, devices=4)
    random = np.random.default_rng(0)
    values = random.normal(size=(2, one.node_count)).astype(np.float32)
    states = [jnp.asarray(one.state_of(each)) for each in values]
    given = material_network(one, STEEL, 300.0, jnp.float32), *states
    alone = jax.jit(step).lower(*given).compile(AS_USERS_RUN)(*given)
    network = material_network(four, STEEL, 300.0, jnp.float32)
    assert isinstance(network, ShardedStencil)
    states = [spread(network.devices, four.state_of(each)) for each in values]
    is_thin = len(states[0]) <= 4 * 4
    for form in (apply_after_exchange, apply_overlapping_exchange):
        program = _program(form, network, states)
        found = np.asarray(program(network.base, *states))
        expected = one.node_values(np.asarray(alone))
        np.testing.assert_array_equal(four.node_values(found), expected)
        text = program.as_text()
        assert text is not None
        assert _waits(text, states[0]) == (form is apply_after_exchange or is_thin)
    if not is_thin:
        no_copy(network, states)


def _program(form, network, states):
    own = lambda base, state, other: form(
        step, base, state, next_planes(state), (other,)
    )
    run = partial(on_each_device, network.devices, own)
    return jax.jit(run).lower(network.base, *states).compile(AS_USERS_RUN)


def no_copy(network: ShardedStencil, states: list[jax.Array]) -> None:
    """Two stages, as of RKL2, that exchange their buffers copy no lattice."""
    stage = lambda before, last: network.combined_step(
        last, DT, combined, before, WEIGHT
    )

    def two(_, pair):
        before, last = pair
        new = stage(before, last)
        return new, stage(last, new)

    @partial(jax.jit, donate_argnums=0)
    def stages(pair, count):
        return jax.lax.fori_loop(0, count, two, pair)

    text = stages.lower(tuple(states), jnp.int32(3)).compile(AS_USERS_RUN).as_text()
    assert text is not None
    loop = next(each for each in text.split("\n}") if "collective-permute(" in each)
    assert not re.search(rf"= {_section(states[0])}\S* copy\(", loop), loop


def _section(state: jax.Array) -> str:
    """Type of a section in the text of a compiled program."""
    return re.escape("f32[{},{},{}]".format(*state.addressable_data(0).shape))


def _waits(text: str, state: jax.Array) -> bool:
    """True if every section that is computed needs planes of other devices."""
    line = re.compile(r"%(\S+) = (\S+) ([\w-]+)\((.*)")
    waiting = {}
    computed = []
    for name, kind, operation, rest in line.findall(text[text.index("ENTRY") :]):
        needs = [waiting.get(each, False) for each in re.findall(r"%([\w.-]+)", rest)]
        waiting[name] = operation.startswith("collective-permute") or any(needs)
        if re.match(_section(state), kind) and operation == "fusion":
            computed.append(waiting[name])
    assert any(computed)
    return all(computed)
