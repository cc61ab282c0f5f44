"""Full volumes over four devices against one: a program for a process that has four."""

import sys
from dataclasses import replace
from pathlib import Path

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


# Four roundings of a temperature in float32.
ROUNDING = 1.3e-4
AT = 300.0, jnp.float32
END, SAVES = 20.0, [5.0, 20.0]


def scene() -> jt.Scene:
    mesh = jt.shapes.sphere(0.05)
    grid = jt.voxelize(mesh, 0.1 / 11, "dominant_axis")
    body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=300.0)
    terms = (jt.Convection(50.0, 280.0), jt.Sun((-1.0, 0.0, -0.2), 800.0))
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
    grid = jt.voxelize(jt.shapes.sphere(0.05), 0.1 / 11, "dominant_axis")
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
        ):
            found = []
            for own in (one, four):
                network, host = make(own), own.state_of(values)
                mesh = network.mesh
                state = jnp.asarray(host) if mesh is None else spread(mesh, host)
                result = np.asarray(jax.jit(law)(network, state))
                found.append(own.node_values(result))
                assert np.count_nonzero(result) <= one.node_count
            np.testing.assert_array_equal(*found)


def batches_equal() -> None:
    """Members of batches of any size have the results of one device, and no others."""
    mesh, law = mesh_of(4), lambda x, k: jnp.sin(k * x).sum()
    given = on_every_device(mesh, {"factor": jnp.float32(3.0), "law": law})

    def part(own, given):
        # A device has two members at most, and those of the padding are no others.
        assert len(own) <= 2
        rows = jax.vmap(lambda x: given["law"](x, given["factor"]))(own)
        return (rows, own), given["factor"]

    for count in (1, 5, 8):
        batch = jnp.arange(3.0 * count, dtype=jnp.float32).reshape(count, 3)
        run = lambda mesh, batch: eqx.filter_jit(over_devices)(mesh, part, batch, given)
        (rows, same_batch), factor = from_first_device(mesh, run(mesh, batch))
        alone = jax.vmap(lambda x: law(x, jnp.float32(3.0)))(batch)
        assert rows.shape == (count,) and float(factor) == 3.0
        np.testing.assert_array_equal(rows, alone)
        np.testing.assert_array_equal(same_batch, batch)
    first = lambda given: {"x": given["law"](jnp.ones(3), given["factor"]), "b": True}
    array = lambda given: jax.tree.map(jnp.asarray, first(given))
    found = eqx.filter_jit(on_first_device)(mesh, array, given)
    assert len(found["x"].sharding.device_set) == 4 and bool(found["b"])
    np.testing.assert_allclose(found["x"], 3 * np.sin(3.0), rtol=1e-6)


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
        batches_equal()
    else:
        networks_equal()
        equal(jt.BackwardEuler(dt=2.0))
        equal(jt.TRBDF2(dt=2.0))
    print("equal")
