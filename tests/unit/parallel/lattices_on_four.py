"""Full volumes over four devices against one: a program for a process that has four."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple, cast, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.integrate.run.checkpoint import load_checkpoint, save_checkpoint
from jaxthermo.integrate.run.plan import Plan, plan_run
from jaxthermo.integrate.run.segments import begin_run, finish_run, run_segments
from jaxthermo.integrate.solvers import AbstractSolver
from jaxthermo.parallel.batch import (
    from_first_device,
    on_every_device,
    on_first_device,
    over_devices,
)
from jaxthermo.parallel.devices import mesh_of
from jaxthermo.parallel.lattice import spread
from jaxthermo.physics.conduction import material_network, materials_network
from jaxthermo.scene.compile.on_devices import on_devices
from tests.unit.parallel.overlap_on_four import only_ends_wait


# Four roundings of a temperature in float32.
ROUNDING = 1.3e-4
AT = 300.0, jnp.float32

Cells = Literal["dominant_axis", "crossings"]
STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0)
LAYERED = jt.Material((3.0, 2.0, 1.0), density=1000.0, specific_heat=900.0)
TERMS = jt.Convection(50.0, 280.0), jt.Sun((-1.0, 0.0, -0.2), 800.0)


class Case(NamedTuple):
    """A ball in wind and sun, and when it is saved."""

    scene: jt.Scene
    end: float
    saves: list[float]


def ball(cells: Cells, voxels: int = 11, material=jt.materials["copper"]) -> jt.Body:
    grid = jt.voxelize(jt.shapes.sphere(0.05), 0.1 / voxels, cells)
    assert (grid.cut is not None) == (cells == "crossings")
    return jt.Body(jt.FullVolume(grid), material, temperature=300.0)


SMALL = Case(jt.Scene((ball("dominant_axis"),), TERMS), 20.0, [5.0, 20.0])


def check(solution: jt.Solution, expected: jt.Solution) -> None:
    expected_temperature = expected.surface_temperature
    apart = np.abs(np.asarray(solution.surface_temperature - expected_temperature))
    assert expected_temperature.min() < 299.9
    assert apart.max() <= ROUNDING, apart.max()
    assert np.abs(np.asarray(solution.energy.residual_relative)).max() < 1e-5


def equal(case: Case, solver: AbstractSolver) -> None:
    """A run on four devices is that on one."""
    expected = jt.simulate(*case, solver=solver)
    check(jt.simulate(*case, solver=solver, devices=4), expected)


def finished(plan: Plan, progress) -> jt.Solution:
    *_, last = run_segments(plan, progress, 0.0)
    return finish_run(plan, last)


def resumed(case: Case) -> None:
    """A run on one device goes on on four, and the other way round.

    It stops at the first time that is saved.
    """
    scene, end, saves = case
    plans = {
        count: plan_run(on_devices(scene, count), end, saves, jt.ForwardEuler())
        for count in (1, 4)
    }
    straight = {count: finished(plan, begin_run(plan)) for count, plan in plans.items()}
    check(straight[4], straight[1])
    path = Path("checkpoint.npz")
    for saving_count, resuming_count in ((4, 1), (1, 4)):
        plan = plans[saving_count]
        resumed_plan = plans[resuming_count]
        progress = next(iter(run_segments(plan, begin_run(plan), 0.0)))
        save_checkpoint(path, plan, progress, "key")
        loaded = load_checkpoint(path, resumed_plan, begin_run(resumed_plan), "key")
        assert loaded is not None and loaded.steps_taken == 2, loaded
        assert len(loaded.state.theta[0].sharding.device_set) == resuming_count
        check(finished(resumed_plan, loaded), straight[1])


def networks_equal(cells: Cells) -> None:
    """Stencils of every kind have the values of one device, and nothing elsewhere."""
    undivided = cast(jt.FullVolume, ball(cells).structure)
    structures = (undivided, replace(undivided, devices=4))
    random = np.random.default_rng(0)
    values = random.normal(size=undivided.node_count).astype(np.float32)
    number = random.integers(0, 2, undivided.node_count).astype(np.int32)

    def network_of(structure, materials):
        if len(materials) == 1:
            return material_network(structure, materials[0], *AT)
        return materials_network(structure, number, materials, *AT)

    stencil_materials = (
        (STEEL,),
        (STEEL, LAYERED),
        (LAYERED,),
        (STEEL, jt.materials["copper"]),
    )
    if cells == "crossings":
        # Cut voxels correct all these stencils alike.
        stencil_materials = stencil_materials[:2]
    for materials in stencil_materials:
        networks = [
            (structure, network_of(structure, materials)) for structure in structures
        ]
        expected, actual = (
            evaluated(structure, network, values) for structure, network in networks
        )
        for name, first, second in zip(LAWS, expected, actual, strict=True):
            # Sums are in another order.
            rtol = 1e-6 if name in ("stored", "total_capacity") else 0
            np.testing.assert_allclose(first, second, rtol, err_msg=name)
        nodes = np.arange(undivided.node_count)[::3]
        first, second = (
            network.capacity_at(tuple(map(jnp.asarray, structure.address_of(nodes))))
            for structure, network in networks
        )
        np.testing.assert_array_equal(first, second)


LAWS = {
    "heat_rate": lambda network, state: network.heat_rate(state),
    "face_heat_rate": lambda network, state: network.face_heat_rate(state),
    "euler_step": lambda network, state: network.euler_step(state, jnp.float32(1e-3)),
    "stored": lambda network, state: network.stored(state),
    "diagonal": lambda network, _: network.diagonal(),
    "capacity": lambda network, _: network.capacity(),
    "max_rate": lambda network, _: network.max_rate(),
    "total_capacity": lambda network, _: network.total_capacity(),
}


def evaluated(structure, network, values) -> list[np.ndarray]:
    """All laws of a network at these values of the nodes; states by node."""
    host = structure.state_of(values)
    state = jnp.asarray(host) if network.mesh is None else spread(network.mesh, host)

    # One program, which compiles sooner than one for each law.
    @jax.jit
    def evaluate(network, state):
        return [law(network, state) for law in LAWS.values()]

    laws = [np.asarray(law) for law in evaluate(network, state)]
    for law in laws:
        assert np.count_nonzero(law) <= structure.node_count
    return [structure.node_values(law) if law.ndim else law for law in laws]


def batches_equal() -> None:
    """Members of batches of any size have the results of one device, and no others."""
    mesh = mesh_of(4)

    def law(x, factor):
        return jnp.sin(factor * x).sum()

    constants = on_every_device(mesh, {"factor": jnp.float32(3.0), "law": law})

    def evaluate(members, constants):
        # A device has two members at most, and those of the padding are no others.
        assert len(members) <= 2
        factor = constants["factor"]
        rows = jax.vmap(lambda x: constants["law"](x, factor))(members)
        return (rows, members), factor

    def first_row(constants):
        row = constants["law"](jnp.ones(3), constants["factor"])
        return {"x": jnp.asarray(row), "b": jnp.asarray(True)}

    for count in (1, 5, 8):
        batch = jnp.arange(3.0 * count, dtype=jnp.float32).reshape(count, 3)
        sharded = eqx.filter_jit(over_devices)(mesh, evaluate, batch, constants)
        (rows, same_batch), factor = from_first_device(mesh, sharded)
        alone = jax.vmap(lambda x: law(x, jnp.float32(3.0)))(batch)
        assert rows.shape == (count,) and float(factor) == 3.0
        np.testing.assert_array_equal(rows, alone)
        np.testing.assert_array_equal(same_batch, batch)
    row = eqx.filter_jit(on_first_device)(mesh, first_row, constants)
    assert len(row["x"].sharding.device_set) == 4 and bool(row["b"])
    np.testing.assert_allclose(row["x"], 3 * np.sin(3.0), rtol=1e-6)


def refused() -> None:
    """Five of four devices are refused."""
    try:
        jt.simulate(SMALL.scene, SMALL.end, devices=5)
    except jt.InputError as error:
        assert "there are 4 cpu devices; give at most 4" in str(error)
        return
    raise AssertionError("five of four devices")


CUT = SMALL._replace(
    scene=jt.Scene(
        (ball("crossings"),), (*TERMS, jt.Surroundings(280.0), jt.HeatSource(-1e4))
    )
)


def every_kind() -> None:
    """Every stencil, cut voxels with nonlinear terms, and implicit steps."""
    for cells in get_args(Cells):
        networks_equal(cells)
    for voxels in (3, 7):
        only_ends_wait(voxels)
    equal(SMALL, jt.SuperTimeStepping(dt=1.0))
    equal(CUT, jt.ForwardEuler())
    equal(SMALL, jt.BackwardEuler(dt=2.0))


def large() -> None:
    """A ball 128 voxels wide, and implicit steps of cut voxels."""
    equal(CUT, jt.TRBDF2(dt=2.0))
    scene = jt.Scene((ball("crossings", 128, STEEL),), TERMS)
    case = Case(scene, 1.0, [0.5, 1.0])
    resumed(case)
    equal(case, jt.SuperTimeStepping(dt=0.25))
    equal(case, jt.BackwardEuler(dt=0.25))


def small() -> None:
    """Explicit steps of whole voxels, restarts, overlap, and batches."""
    resumed(SMALL)
    only_ends_wait(11)
    refused()
    batches_equal()


if __name__ == "__main__":
    assert jax.device_count() == 4
    {"small": small, "every_kind": every_kind, "large": large}[sys.argv[1]]()
    print("equal")
