"""Dimensionless numbers against values worked by hand."""

import jax.numpy as jnp
import numpy as np

from jaxthermo import dimensionless as dl


def test_conduction_numbers():
    np.testing.assert_allclose(dl.biot(10.0, 0.16, 16.0), 0.1)
    np.testing.assert_allclose(dl.fourier(4.0e-6, 100.0, 0.02), 1.0)
    np.testing.assert_allclose(dl.cell_fourier(4.0e-6, 0.5, 2e-3), 0.5)
    np.testing.assert_allclose(dl.characteristic_length(4 / 3, 4.0), 1 / 3)
    assert dl.time_constant(3600.0, 10.0) == 360.0
    np.testing.assert_allclose(dl.diffusion_length(4.0e-6, 100.0), 0.02)


def test_flow_numbers():
    np.testing.assert_allclose(dl.nusselt(26.0, 0.1, 0.026), 100.0)
    np.testing.assert_allclose(dl.reynolds(1.0, 0.1, 1.6e-5), 6250.0)
    np.testing.assert_allclose(dl.prandtl(1.6e-5, 2.25e-5), 0.71111, rtol=1e-4)
    grashof = dl.grashof(9.81, 1 / 300.0, 10.0, 0.1, 1.6e-5)
    np.testing.assert_allclose(grashof, 1.27734e6, rtol=1e-5)
    np.testing.assert_allclose(dl.rayleigh(2.0e6, 0.7), 1.4e6)


def test_arrays_pass_through():
    times = jnp.asarray([1.0, 4.0], jnp.float32)
    depth = dl.diffusion_length(jnp.asarray(1e-6, jnp.float32), times)
    assert jnp.asarray(depth).dtype == jnp.float32
    np.testing.assert_allclose(depth, [1e-3, 2e-3], rtol=1e-6)
    np.testing.assert_allclose(dl.fourier(1e-6, np.array([1.0, 2.0]), 1e-3), [1.0, 2.0])
