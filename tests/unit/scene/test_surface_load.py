"""Surface cells in the time loop: an even number of them, the spare ones idle."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.integrate.heat_rates import add_loads
from jaxthermo.memo.found import forget_findings
from jaxthermo.scene.compile import surface_cells as module
from jaxthermo.scene.compile.compile import compile_scene


STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.9)
TERMS = (
    jt.Sun((0.5, 0.3, -1.0), 800.0),
    jt.FreeConvection(285.0, length=0.05),
    jt.RadiativeExchange(280.0, max_patches=24, directions=24),
    jt.FixedTemperature(310.0, on=jt.Side((0.0, 0.0, -1.0))),
)


@pytest.mark.parametrize("count", [1, 16, 17, 57, 511, 512, 4097, 73101, 10**6 + 1])
def test_a_size_is_even_and_little_larger(count):
    size = module._even_size(count)
    assert size % 16 == 0 and count <= size < count + max(16, count / 16 + 1)
    assert size % 1024 == 0 or count < 16384
    assert module._even_size(size) == size


@eqx.filter_jit
def _loaded(program, states):
    now = jnp.full((), 0.5)
    return add_loads(program, states, states, now, jnp.ones(()))


@pytest.mark.slow
def test_spare_cells_do_nothing(monkeypatch):
    grid = jt.voxelize(jt.shapes.sphere(0.025), 0.01)
    bodies = tuple(
        jt.Body(jt.Octree(grid), STEEL, temperature=start, pose=jt.Pose((x, 0.0, 0.0)))
        for x, start in ((0.0, 300.0), (0.06, 320.0))
    )
    scene = jt.Scene(bodies, TERMS, dtype="float64")
    # Whatever the number of cells is, which may be even without spare ones.
    monkeypatch.setattr(module, "_even_size", lambda count: count + 7)
    even = compile_scene(scene)
    # Cells are kept by what they are found from, which the size is no part of.
    forget_findings()
    monkeypatch.setattr(module, "_even_size", lambda count: count)
    plain = compile_scene(scene)
    cells = lambda compiled: compiled.program.surface.by_cell.cells
    for padded, unpadded in zip(cells(even), cells(plain), strict=True):
        assert len(padded.node) > len(unpadded.node)
    chance = np.random.default_rng(0)
    states = tuple(s + chance.uniform(-5, 5, s.shape) for s in even.state)
    actual, expected = (_loaded(compiled.program, states) for compiled in (even, plain))
    for state, expected_state in zip(actual[0], expected[0], strict=True):
        assert np.abs(state - states[0]).max() > 1e-3
        np.testing.assert_allclose(state, expected_state, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(actual[1], expected[1], rtol=1e-12, atol=1e-14)
