"""What a full volume with kernels of numba refuses, each in one line."""

import importlib.util
from typing import Any

import jax
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.native import call
from jaxthermo.native.call import require_native
from tests.bodies import single_body_scene


GRID = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0)
BY_AXIS = jt.Material((16.0, 16.0, 2.0), density=8000.0, specific_heat=500.0)


def scene(material: Any = STEEL, **options: Any):
    structure = jt.FullVolume(GRID, kernels="numba", **options)
    return single_body_scene(
        structure, material, 350.0, jt.Convection(10.0, 290.0), dtype="float32"
    )


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (
            lambda: jt.FullVolume(GRID, kernels="fast"),  # type: ignore
            "'fast'.*leave it out",
        ),
        (lambda: jt.simulate(scene(BY_AXIS), 1.0), "one conductivity for all axes"),
        (
            lambda: jt.simulate(scene(weights=jt.ConductionWeights(0.9)), 1.0),
            "has no weights",
        ),
        (lambda: jt.simulate(scene(), 1.0, devices=2), "devices"),
        (
            lambda: jt.simulate(scene(jt.MaterialMap(STEEL)), 1.0),
            "one material",
        ),
    ],
)
def test_scenes_that_its_loops_do_not_compute(make, says, monkeypatch):
    monkeypatch.setattr("jaxthermo.physics.run_conduction.require_native", lambda _: 0)
    with pytest.raises(InputError, match=says):
        make()


@pytest.fixture
def fresh():
    require_native.cache_clear()
    yield
    require_native.cache_clear()


@pytest.mark.usefixtures("fresh")
def test_without_numba(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install '\.\[native\]'"):
        require_native("a")


@pytest.mark.usefixtures("fresh")
def test_on_another_device(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    with pytest.raises(InputError, match="JAX computes on a gpu: leave it out"):
        require_native("a")


@pytest.mark.usefixtures("fresh")
def test_where_another_version_of_xla_cannot_call(monkeypatch):
    monkeypatch.setattr(call, "called", lambda *_: np.zeros(3, np.float32))
    with pytest.raises(InputError, match="cannot call what numba compiles"):
        require_native("a")
