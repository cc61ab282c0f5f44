"""Bodies that overlap in a scene: warned of, or refused."""

import jax
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.scene.compile.compile import compile_scene
from tests.bodies import blocks


METAL = jt.Material(50.0, density=2000.0, specific_heat=500.0)
STRUCTURE = jt.FullVolume(blocks(np.ones((8, 3, 3), bool), 0.01))


def scene(pose) -> jt.Scene:
    """A bar of 8 x 3 x 3 cm, and another one on its axis."""
    still = jt.Body(STRUCTURE, METAL, temperature=300.0)
    return jt.Scene((still, jt.Body(STRUCTURE, METAL, temperature=300.0, pose=pose)))


def test_an_overlap_is_in_the_receipt_and_a_warning():
    apart = jt.Pose((0.1, 0.0, 0.0))
    touching = jt.Pose((0.07, 0.0, 0.0))
    assert compile_scene(scene(apart)).receipt.warnings == ()
    assert compile_scene(scene(touching)).receipt.warnings == ()
    deep = scene(jt.Pose((0.05, 0.0, 0.0)))
    (line,) = compile_scene(deep).receipt.warnings
    print(line)
    assert (
        line.startswith("bodies 0 and 1 overlap by 30 mm")
        and "2.7e-05 m3, 38 % of" in line
    )
    run = lambda: jt.simulate(deep, 1.0, solver=jt.ForwardEuler(dt=1.0)).times
    # Traced alone: the warning comes before the run is compiled.
    with pytest.warns(UserWarning, match="bodies 0 and 1 overlap by"):
        jax.eval_shape(run)
    with pytest.raises(jt.InputError, match="body 0 lies wholly in"):
        compile_scene(scene(jt.Pose()))


def test_a_body_that_moves_is_followed():
    """It comes as near as 4 cm, halfway between the snapshots at 4 and 5 s."""
    poses = [jt.Pose((x, 0.0, 0.0)) for x in (0.1, 0.04)]
    moving = scene(jt.Motion(jt.PoseTable([0.0, 5.0], poses), every=1.0))
    (line,) = compile_scene(moving, end=5.0).receipt.warnings
    assert line.startswith("at 4 s bodies 0 and 1 overlap by")
