"""The shipped scene of figure 5.5, a hot ball on the Max Planck head, up to 2 s."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

import jaxthermo as jt
from jaxthermo.config.loader import load_config
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.physics.contact.search import ContactPairs, find_contacts

from ..harness.meshes import mesh_files
from .bodies import CONFIGS


TIMES = (0.0, 0.05, 2.0)
"""Saved times: start, first heat after about a frame of the thesis, and its end [s]."""
HEAD, BALL = 0, 1
"""Numbers of the bodies."""
_CONFIG = CONFIGS / "scenes" / "hat-ball-on-planck.yaml"
# Height of the head in that file [mm].
_TALL = 500.0
# Width and height of the scene's pictures, which are shown side by side [px].
_PICTURE = 275, 400
# Rise of a texel that counts as warmed [K].
_WARMED = 1.0


class BallOnHead(NamedTuple):
    """A run of the scene, with the texels that touch."""

    config: SceneConfig
    head: jt.VoxelGrid
    pairs: ContactPairs
    solution: jt.Solution

    def celsius(self, body: int, time: int) -> Float[np.ndarray, " s"]:
        """Surface temperature of a body's texels at a saved time [degC]."""
        return np.asarray(self.solution.of_body(body)[time], float) - ZERO_CELSIUS

    def conduction_texture(self, time: int) -> Float[np.ndarray, " s"]:
        """Temperature of the ball at the texels of the head that it touches [degC]."""
        pairs, size = self.pairs, len(self.head.fragment_area)
        of_ball = self.celsius(BALL, time)[pairs.fragment_b]
        total = np.bincount(pairs.fragment_a, pairs.area, minlength=size)
        heat = np.bincount(pairs.fragment_a, pairs.area * of_ball, minlength=size)
        # A texel without contact has none of it.
        return np.where(total > 0, heat / np.where(total > 0, total, 1), np.nan)

    def in_contact(self, body: int, time: int) -> float:
        """Mean temperature of a body's texels over the contact [degC]."""
        fragment = self.pairs.fragment_a if body == HEAD else self.pairs.fragment_b
        return float(
            np.average(self.celsius(body, time)[fragment], weights=self.pairs.area)
        )

    def warmed_area(self, time: int) -> float:
        """Area of the head that is warmer than at first, by 1 K and more [m^2]."""
        rise = self.celsius(HEAD, time) - self.celsius(HEAD, 0)
        return float(self.head.fragment_area[rise >= _WARMED].sum())

    def conducted(self) -> tuple[float, float]:
        """Heat into the head and into the ball through their contact [J]."""
        # What each body stores, less what it radiates.
        head, ball = (
            float(energy.stored_J[-1] - sum(v[-1] for v in energy.mechanisms.values()))
            for energy in self.solution.energy.bodies
        )
        return head, ball


def _config(height: int) -> SceneConfig:
    # The ball's voxels are as large as the head's; sums of energy are to 1e-10.
    texts = (
        f"bodies.{HEAD}.mesh.path={mesh_files()['Max Planck'].resolve()}",
        f"bodies.{HEAD}.voxels_high={height}",
        f"bodies.{BALL}.pitch={_TALL / height} mm",
        "dtype=float64",
        f"camera.width={_PICTURE[0]}",
        f"camera.height={_PICTURE[1]}",
    )
    return load_config(_CONFIG, texts)


def contact_pairs(scene: jt.Scene) -> ContactPairs:
    """Texels of head and ball that touch at the start."""
    head, ball = (
        PlacedGrid(scene.bodies[body].structure.grid, scene.bodies[body].pose.at(0.0))
        for body in (HEAD, BALL)
    )
    return find_contacts(head, ball)


def contact_area(height: int) -> float:
    """Area of contact with a head of so many voxels [m^2]."""
    return float(contact_pairs(_config(height).build()).area.sum())


def ball_on_head(height: int) -> BallOnHead:
    """Simulate 2 s with a head of `height` voxels; the mesh must be there."""
    config = _config(height)
    scene = config.build()
    solution = jt.simulate(scene, TIMES[-1], TIMES, solver=config.solver.build())
    grid = scene.bodies[HEAD].structure.grid
    return BallOnHead(config, grid, contact_pairs(scene), solution)
