"""A scene that is bound as a function of its numbers equals one bound with them."""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.errors import InputError
from jaxthermo.scene.body_materials import MaterialLabels, MaterialMap
from jaxthermo.scene.compile.compile import _bind
from jaxthermo.scene.compile.traced_scene import separate_numbers, trace_scene


COPPER = jt.Material(390.0, density=8900.0, specific_heat=385.0, emissivity=0.2)
STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.9)
GRID = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), 0.01)
FULL = jt.FullVolume(GRID)
TOP = jt.Side((0.0, 0.0, 1.0))
AIR = jt.Convection(10.0, 290.0)


def _body(
    structure: Any = FULL,
    material: Any = STEEL,
    temperature: Any = 350.0,
    **options: Any,
) -> jt.Body:
    return jt.Body(structure, material, temperature=temperature, **options)


def _labels() -> MaterialLabels:
    labels = np.zeros(GRID.solid.shape, np.int32)
    labels[2:] = 1
    return MaterialLabels(labels, (COPPER, STEEL))


PAIR = (_body(), _body(material=COPPER, temperature=300, pose=jt.Pose((0.04, 0, 0))))
PAINTED = MaterialMap(COPPER, ((jt.Region((-1, -1, 0), (1, 1, 1)), STEEL),))
BODIES = {
    "full": (_body(),),
    "aggregate": (_body(jt.Aggregate(GRID, 2)),),
    "labels": (_body(material=_labels()),),
    "painted": (_body(material=PAINTED),),
    "uneven": (_body(temperature=lambda x: 300 + 100 * x[:, 0]),),
    "shared": PAIR,
}
TERMS = {
    "none": (),
    "convection": (AIR,),
    "zero_and_one": (jt.Convection(0, 290), jt.Surroundings(1.0)),
    "of_jax": (jt.Convection(jnp.asarray(10.0), np.float32(290.0)),),
    "function": (jt.Convection(10.0, lambda time: 290.0 + time),),
    "surroundings": (AIR, jt.Surroundings(280.0)),
    "flux": (jt.HeatFlux(200.0, on=TOP), AIR),
    "heat": (jt.HeatSource(1e5), AIR),
    "exchange": (jt.RadiativeExchange(280.0),),
    "sun": (jt.Sun((0.0, 0.6, -0.8), 800.0), AIR),
    "lamp": (jt.PointSource((0.0, 0.0, 0.2), 50.0), AIR),
    "wind": (jt.Wind((2.0, 0.0, 0.0), 290.0),),
    "free": (jt.FreeConvection(290.0),),
    "fixed": (jt.FixedTemperature(300.0, on=TOP), AIR),
    "table": (jt.Convection(10.0, jt.Table([0.0, 9.0], [290.0, 295.0])),),
}


@pytest.mark.parametrize("terms", TERMS)
@pytest.mark.parametrize("bodies", BODIES)
def test_traced_and_bound_are_equal(bodies, terms):
    # Surroundings of 1 K are meant.
    _check(jt.Scene(BODIES[bodies], TERMS[terms], allow_extreme_temperatures=True))


@pytest.mark.parametrize("bodies", BODIES)
def test_traced_and_bound_are_equal_in_double_precision(bodies):
    with precision("float64"):
        _check(jt.Scene(BODIES[bodies], TERMS["surroundings"], dtype="float64"))


def test_contact():
    _check(jt.Scene(PAIR, (jt.Contact(500.0), AIR)))


def _check(scene: jt.Scene) -> None:
    bind = partial(
        _bind,
        classes=(0,) * len(scene.bodies),
        starts=(0.0,),
        end=20.0,
        duration=20.0,
        prune=True,
    )
    bound = bind(scene)
    numbers = separate_numbers(scene)
    # Not `compile_scene`, which binds what cannot be traced.
    traced_scene = trace_scene(scene, numbers, bind=bind, by=("test",))
    assert traced_scene is not None
    traced = traced_scene(numbers.values)
    assert traced.receipt.as_dict() == bound.receipt.as_dict()
    assert traced.acting == bound.acting
    expected = jax.tree.leaves(bound)
    actual = jax.tree.leaves(traced)
    assert len(actual) == len(expected)
    for value, reference in zip(actual, expected, strict=True):
        if isinstance(reference, float | np.ndarray | jax.Array):
            reference = np.asarray(reference)
            tolerance = 1e-13 if scene.dtype == "float64" else 3e-6
            scale = np.abs(reference).max(initial=0) if reference.size else 0
            scale = scale if np.isfinite(scale) else 0
            np.testing.assert_allclose(
                np.asarray(value), reference, rtol=tolerance, atol=tolerance * scale
            )
        elif not callable(reference):
            assert value == reference


class Choosing(jt.AbstractSurfaceTerm):
    """A term that reads its number to choose what it does."""

    name = "choosing"
    coefficient: Any

    def bind(self, surface):
        factor = 2.0 if self.coefficient > 5 else 1.0
        return jt.Convection(factor * float(self.coefficient), 290.0).bind(surface)


@pytest.mark.parametrize(("coefficient", "equal"), [(4.0, 4.0), (6.0, 12.0)])
def test_a_term_may_read_its_numbers(coefficient, equal):
    steps = [
        float(jt.compile_scene(jt.Scene((_body(),), (term,))).stable_step)
        for term in (Choosing(coefficient), jt.Convection(equal, 290.0))
    ]
    assert steps[0] == pytest.approx(steps[1], rel=1e-6)


def test_a_term_that_reads_its_numbers_is_traced_once():
    bound = []

    class Counting(Choosing):
        def bind(self, surface):
            bound.append(isinstance(self.coefficient, jax.core.Tracer))
            return super().bind(surface)

    body = _body()
    for coefficient in (4.0, 6.0):
        jt.compile_scene(jt.Scene((body,), (Counting(coefficient),)))
    # Traced in vain, then bound with its numbers, and only so from then on.
    assert bound == [True, False, False]


class Gradient(eqx.Module):
    """A temperature that rises along x [K]."""

    slope: Any

    def __call__(self, position):
        return 300 + self.slope * position[:, 0]


def test_temperatures_of_a_module_are_checked():
    jt.compile_scene(jt.Scene((_body(temperature=Gradient(100.0)),), (AIR,)))
    scene = jt.Scene((_body(temperature=Gradient(-30000.0)),), (AIR,))
    with pytest.raises(InputError, match="gives -150 K"):
        jt.compile_scene(scene)
