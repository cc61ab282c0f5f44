"""5.3: a hot ball on the Max Planck head, the shipped scene of figure 5.5."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from PIL import Image

import jaxthermo as jt
from jaxthermo.config.camera_framing import camera_on
from jaxthermo.config.loader import load_config
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.image.colour.palette import apply_palette
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.physics.contact.search import ContactPairs, find_contacts
from jaxthermo.report.sheet import Tile, colour_bar, enlarged, sheet
from jaxthermo.voxels.lattice import pixel_axes

from ...harness.meshes import mesh_files
from ...harness.present import Shot, thermal_sheet
from ..bodies import CONFIGS, planck
from ..exhibit import Finding, exhibit, imbalance, judged


TIMES = (0.0, 0.05, 2.0)
"""Saved times: start, first heat after about a frame of the thesis, and its end [s]."""
HEAD = 0
BALL = 1
"""Numbers of the bodies."""
_CONFIG = CONFIGS / "scenes" / "hat-ball-on-planck.yaml"
# Height of the head in that file [mm].
_TALL = 500.0
# Rise of a texel that counts as warmed [K].
_WARMED = 1.0
# Allowed difference of what one body loses and the other gains, relative [-].
_MAX_IMBALANCE = 1e-10
_EDGE = 320
# Of the pictures of the scene, as in its file [degC].
_SCALE = (12.0, 45.0)
# The coolest colour of the palette is black: what has none is bright.
_UNTOUCHED = (164, 168, 176)
_NOTHING = (232, 234, 238)


class _BallOnHead(NamedTuple):
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
        pairs = self.pairs
        size = len(self.head.fragment_area)
        of_ball = self.celsius(BALL, time)[pairs.fragment_b]
        area = np.bincount(pairs.fragment_a, pairs.area, minlength=size)
        heat = np.bincount(pairs.fragment_a, pairs.area * of_ball, minlength=size)
        # A texel without contact has none of it.
        safe_area = np.where(area > 0, area, 1)
        return np.where(area > 0, heat / safe_area, np.nan)

    def in_contact(self, body: int, time: int) -> float:
        """Mean temperature of a body's texels over the contact [degC]."""
        fragment = self.pairs.fragment_a if body == HEAD else self.pairs.fragment_b
        kelvin = self.celsius(body, time)[fragment]
        return float(np.average(kelvin, weights=self.pairs.area))

    def warmed_area(self, time: int) -> float:
        """Area of the head that is warmer than at first, by 1 K and more [m^2]."""
        rise = self.celsius(HEAD, time) - self.celsius(HEAD, 0)
        return float(self.head.fragment_area[rise >= _WARMED].sum())

    def conducted(self) -> tuple[float, float]:
        """Heat into the head and into the ball through their contact [J]."""
        # What each body stores, less what it radiates.
        heats = []
        for energy in self.solution.energy.bodies:
            radiated = sum(heat[-1] for heat in energy.mechanisms.values())
            heats.append(float(energy.stored_J[-1] - radiated))
        head, ball = heats
        return head, ball


@exhibit("figure-5.5", "5.3, figure 5.5")
def _ball_on_cool_head(quick: bool) -> Finding:
    """Let heat flow from the ball to the head, and show their textures."""
    planck()
    height = 60 if quick else 150
    run = ball_on_head(height)
    ball = [run.in_contact(BALL, time) for time in range(len(TIMES))]
    head = [run.in_contact(HEAD, time) for time in range(len(TIMES))]
    warmed = [1e4 * run.warmed_area(time) for time in range(len(TIMES))]
    gained, lost = run.conducted()
    swap = imbalance(gained, lost)
    is_flow = ball[0] > ball[2] > head[2] > head[1] > head[0]
    is_right = is_flow and swap <= _MAX_IMBALANCE and warmed[2] > warmed[1] > 0
    half = height // 2
    return Finding(
        judged(is_right),
        {
            "height_voxels": height,
            "half_height_voxels": half,
            "ball_contact_C": ball,
            "head_contact_C": head,
            "warmed_cm2": warmed,
            "conducted_J": [gained, lost],
            "conducted_kJ": gained / 1e3,
            "swap": swap,
            "contact_cm2": {
                "of half the voxels": 1e4 * _contact_area(half),
                "of these voxels": 1e4 * float(run.pairs.area.sum()),
            },
            "texels": int(np.count_nonzero(run.pairs.coverage_a)),
        },
        {"figure-5.5": _textures(run), "figure-5.5-scene": _frames(run)},
    )


def ball_on_head(height: int) -> _BallOnHead:
    """Simulate 2 s with a head of `height` voxels; the mesh must be there."""
    config = _config(height)
    scene = config.build()
    return _BallOnHead(
        config=config,
        head=scene.bodies[HEAD].structure.voxels,
        pairs=_contact_pairs(scene),
        solution=jt.simulate(scene, TIMES[-1], TIMES, solver=config.solver.build()),
    )


def _config(height: int) -> SceneConfig:
    # The ball's voxels are as large as the head's; sums of energy are to 1e-10.
    overrides = (
        f"bodies.{HEAD}.mesh.path={mesh_files()['Max Planck'].resolve()}",
        f"bodies.{HEAD}.voxels_high={height}",
        f"bodies.{BALL}.pitch={_TALL / height} mm",
        "dtype=float64",
        "camera.width=275",
        "camera.height=400",
    )
    return load_config(_CONFIG, overrides)


def _contact_pairs(scene: jt.Scene) -> ContactPairs:
    """Texels of head and ball that touch at the start."""
    head, ball = (
        PlacedGrid(body.structure.grid, body.pose.at(0.0)) for body in scene.bodies
    )
    return find_contacts(head, ball)


def _contact_area(height: int) -> float:
    """Area of contact with a head that is `height` voxels high [m^2]."""
    return float(_contact_pairs(_config(height).build()).area.sum())


def _textures(run: _BallOnHead) -> Image.Image:
    first, last = (f"{time:g} s" for time in TIMES[1:])
    voxelized = "voxelized texture of the head"
    conduction = "conduction texture T_Head"
    at_start = run.celsius(HEAD, 0)
    low = float(at_start.min())
    high = float(run.celsius(BALL, 0).max())
    tiles = [
        Tile(_texture(run.head, values, (low, high)), f"{letter} {name}", note)
        for letter, name, values, note in (
            ("(a)", voxelized, at_start, "0 s"),
            ("(b)", conduction, run.conduction_texture(0), "of the ball, 0 s"),
            ("(c)", voxelized, run.celsius(HEAD, 1), first),
            ("(d)", conduction, run.conduction_texture(2), f"of the ball, {last}"),
            ("(e)", voxelized, run.celsius(HEAD, 2), last),
        )
    ]
    bar = colour_bar(low, high, "temperature [°C]; grey: no contact")
    title = "Textures of the head along z, from above, with the nose downwards"
    return sheet(tiles, bar, title, columns=len(tiles))


def _texture(
    grid: jt.VoxelGrid, values: Float[np.ndarray, " s"], limits: tuple[float, float]
) -> np.ndarray:
    """The stored texels along z, the highest one of each pixel."""
    colours = apply_palette(values[:, None], *limits, "iron", invalid=_UNTOUCHED)[:, 0]
    stored = np.flatnonzero(grid.is_packed(2))
    cells = grid.lattice.to_cells(grid.fragment_position[stored])
    order = np.argsort(cells[:, 2], kind="stable")
    rows, columns = (cells[order, axis].astype(int) for axis in pixel_axes(2))
    height, width = (grid.lattice.shape[axis] for axis in pixel_axes(2))
    image = np.empty((height, width, 3), np.uint8)
    image[:] = _NOTHING
    # Those that are written later are higher.
    image[rows, columns] = colours[stored[order]]
    return enlarged(image[::-1, ::-1], _EDGE)


def _frames(run: _BallOnHead) -> Image.Image:
    camera = camera_on(run.config.camera, run.solution.surfaces)
    shots = []
    for time in (0, len(TIMES) - 1):
        image = jt.render(run.solution, camera, time)
        celsius = np.asarray(image.temperature) - ZERO_CELSIUS
        body = np.asarray(image.object_id) >= 0
        shots.append(Shot(celsius, body, name=f"{TIMES[time]:g} s"))
    return thermal_sheet(
        shots,
        limits=_SCALE,
        scale="temperature [°C]; the ball is above the scale",
        title="A hot ball on a cool head",
    )
