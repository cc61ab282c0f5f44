"""Bodies in their full volume, and scenes of one, for cases with a known answer."""

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.choices import Dtype
from jaxthermo.integrate.run.plan import plan_run


def stable_step(scene: jt.Scene) -> float:
    """The largest explicit step [s]."""
    with precision(scene.dtype):
        limit = plan_run(scene, 0.0, None).stable_step
    assert limit is not None
    return limit


def full(grid: jt.VoxelGrid, material, temperature, x: float = 0.0) -> jt.Body:
    """A body moved along x [m]; material and temperature as of `Body`."""
    pose = jt.Pose(translation=(x, 0.0, 0.0))
    return jt.Body(jt.FullVolume(grid), material, temperature=temperature, pose=pose)


def single(
    grid: jt.VoxelGrid, material, temperature, *terms, dtype: Dtype = "float64"
) -> jt.Scene:
    """A scene of one such body, with terms."""
    # Some cases start at 0 K, or have surroundings of 0 K.
    return jt.Scene(
        (full(grid, material, temperature),),
        terms,
        dtype=dtype,
        allow_extreme_temperatures=True,
    )
