"""Full volumes over four devices against one: a program for a process that has four."""

import sys
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo as jt
from jaxthermo.integrate.run.checkpoint import load_checkpoint, save_checkpoint
from jaxthermo.integrate.run.plan import Plan, plan_run
from jaxthermo.integrate.run.segments import begin_run, finish_run, run_segments
from jaxthermo.integrate.solvers import AbstractSolver
from jaxthermo.parallel.lattice import spread
from jaxthermo.physics.conduction import material_network, materials_network
from jaxthermo.scene.compile.on_devices import on_devices


# Four roundings of a temperature in float32.
ROUNDING = 1.3e-4
AT = 300.0, jnp.float32
END, SAVES = 20.0, [5.0, 20.0]


def scene() -> jt.Scene:
    """A ball with cut voxels, heated inside, with linear and nonlinear terms."""
    grid = jt.voxelize(jt.shapes.sphere(0.05), 0.1 / 11)
    assert grid.cut is not None and not grid.cut.is_empty
    body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=300.0)
    terms = (
        jt.Convection(50.0, 280.0),
        jt.Sun((-1.0, 0.0, -0.2), 800.0),
        jt.Surroundings(280.0),
        jt.HeatSource(-1e4),
    )
    return jt.Scene((body,), terms)


def check(solution: jt.Solution, other: jt.Solution) -> None:
    apart = np.abs(np.asarray(solution.surface_temperature - other.surface_temperature))
    assert other.surface_temperature.min() < 299.9
    assert apart.max() <= ROUNDING, apart.max()
    assert np.abs(np.asarray(solution.energy.residual_relative)).max() < 1e-5


def equal(solver: AbstractSolver) -> None:
    """A run on four devices is that on one."""
    one = jt.simulate(scene(), END, SAVES, solver=solver)
    check(jt.simulate(scene(), END, SAVES, solver=solver, devices=4), one)


def finished(plan: Plan, progress) -> jt.Solution:
    *_, last = run_segments(plan, progress, 0.0)
    return finish_run(plan, last)


def resumed() -> None:
    """A run on one device goes on on four, and the other way round."""
    plans = {
        count: plan_run(on_devices(scene(), count), END, SAVES, jt.ForwardEuler())
        for count in (1, 4)
    }
    straight = {count: finished(plan, begin_run(plan)) for count, plan in plans.items()}
    check(straight[4], straight[1])
    path = Path("checkpoint.npz")
    for before, after in ((4, 1), (1, 4)):
        plan, other = plans[before], plans[after]
        progress = next(iter(run_segments(plan, begin_run(plan), 0.0)))
        save_checkpoint(path, plan, progress, "key")
        kept = load_checkpoint(path, other, begin_run(other), "key")
        assert kept is not None and kept.steps_taken == 2, kept
        assert len(kept.state.theta[0].sharding.device_set) == after
        check(finished(other, kept), straight[1])


def networks_equal() -> None:
    """Stencils of every kind have the values of one device, and nothing elsewhere."""
    for cells in ("dominant_axis", "crossings"):
        grid = jt.voxelize(jt.shapes.sphere(0.05), 0.1 / 11, cells)
        assert (grid.cut is not None) == (cells == "crossings")
        networks_equal_on(grid)


def networks_equal_on(grid: jt.VoxelGrid) -> None:
    one = jt.FullVolume(grid, sections=False)
    four, random = replace(one, devices=4), np.random.default_rng(0)
    values = random.normal(size=one.node_count).astype(np.float32)
    number = random.integers(0, 2, one.node_count).astype(np.int32)
    steel = jt.Material(16.0, density=8000.0, specific_heat=500.0)
    layered = jt.Material((3.0, 2.0, 1.0), density=1000.0, specific_heat=900.0)
    by_material = lambda *made: lambda own: materials_network(own, number, made, *AT)
    for make in (
        lambda own: material_network(own, steel, *AT),
        lambda own: material_network(own, layered, *AT),
        by_material(steel, jt.materials["copper"]),
        by_material(steel, layered),
    ):
        for law in (
            lambda network, state: network.heat_rate(state),
            lambda network, state: network.face_heat_rate(state),
            lambda network, state: network.euler_step(state, jnp.float32(1e-3)),
            lambda network, _: network.diagonal(),
            lambda network, _: network.capacity(),
        ):
            found = []
            for own in (one, four):
                network, host = make(own), own.state_of(values)
                mesh = network.mesh
                state = jnp.asarray(host) if mesh is None else spread(mesh, host)
                result = np.asarray(jax.jit(law)(network, state))
                if not result.ndim:
                    # One capacity for all.
                    found.append(result)
                    continue
                found.append(own.node_values(result))
                assert np.count_nonzero(result) <= one.node_count
            np.testing.assert_array_equal(*found)
        sums_equal(make(one), make(four), one, four, values)


def sums_equal(network, other, one, four, values) -> None:
    """Sums over the body, the largest rate, and capacities of some nodes are equal."""
    for law, rtol in (
        (lambda network, _: network.max_rate(), 0.0),
        (lambda network, _: network.total_capacity(), 1e-6),
        (lambda network, state: network.stored(state), 1e-6),
    ):
        alone = jax.jit(law)(network, jnp.asarray(one.state_of(values)))
        state = spread(other.mesh, four.state_of(values))
        np.testing.assert_allclose(jax.jit(law)(other, state), alone, rtol=rtol)
    nodes = np.arange(one.node_count)[::3]
    at = [tuple(map(jnp.asarray, own.address_of(nodes))) for own in (one, four)]
    np.testing.assert_array_equal(other.capacity_at(at[1]), network.capacity_at(at[0]))


def refused() -> None:
    """Five of four devices are refused."""
    try:
        jt.simulate(scene(), END, devices=5)
    except jt.InputError as error:
        assert "there are 4 cpu devices; give at most 4" in str(error)
        return
    raise AssertionError("five of four devices")


if __name__ == "__main__":
    assert jax.device_count() == 4
    if sys.argv[1] == "explicit":
        resumed()
        equal(jt.SuperTimeStepping(dt=1.0))
        refused()
    else:
        networks_equal()
        equal(jt.BackwardEuler(dt=2.0))
        equal(jt.TRBDF2(dt=2.0))
    print("equal")
