"""Figure 5.5: a hot ball on the Max Planck head, and what their textures hold."""

from typing import Any

import numpy as np
from jaxtyping import Float

import jaxthermo as jt
from jaxthermo.config.camera_framing import build_camera
from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.image.colour.palette import apply_palette
from jaxthermo.report.sheet import Tile, enlarged, sheet
from jaxthermo.voxels.lattice import pixel_axes

from ...harness.present import colour_bar, thermal_tile
from ..ball_on_head import BALL, HEAD, TIMES, BallOnHead, ball_on_head, contact_area
from ..bodies import NO_PLANCK, planck
from ..exhibit import Exhibit, Finding, Picture, Row, Verdict, skipped


_HEIGHT, _QUICK_HEIGHT = 150, 60
# Allowed difference of what one body loses and the other gains, over it [-].
_SWAP = 1e-10
_EDGE = 320
# Of the pictures of the scene, as in its file [degC].
_SCALE = 12.0, 45.0
# The coolest colour of the palette is black: what has none is bright.
_UNTOUCHED, _NOTHING = (164, 168, 176), (232, 234, 238)


def _texture(
    grid: jt.VoxelGrid, values: Float[np.ndarray, " s"], limits: tuple[float, float]
) -> np.ndarray:
    """The stored texels along z, the highest one of each pixel."""
    colours = apply_palette(values[:, None], *limits, "iron", invalid=_UNTOUCHED)[:, 0]
    stored = np.flatnonzero(grid.is_packed(2))
    cells = grid.lattice.to_cells(grid.fragment_position[stored])
    order = np.argsort(cells[:, 2], kind="stable")
    rows, columns = (cells[order, a].astype(int) for a in pixel_axes(2))
    image = np.empty((*(grid.lattice.shape[a] for a in pixel_axes(2)), 3), np.uint8)
    image[:] = _NOTHING
    # Those that are written later are higher.
    image[rows, columns] = colours[stored[order]]
    return enlarged(image[::-1, ::-1], _EDGE)


def _textures(run: BallOnHead) -> Picture:
    first, last = (f"{time:g} s" for time in TIMES[1:])
    voxelized = "voxelized texture of the head"
    conduction = "conduction texture T_Head"
    shown = (
        ("(a)", voxelized, run.celsius(HEAD, 0), "0 s"),
        ("(b)", conduction, run.conduction_texture(0), "temperature of the ball, 0 s"),
        ("(c)", voxelized, run.celsius(HEAD, 1), first),
        ("(d)", conduction, run.conduction_texture(2), f"of the ball, {last}"),
        ("(e)", voxelized, run.celsius(HEAD, 2), last),
    )
    limits = float(run.celsius(HEAD, 0).min()), float(run.celsius(BALL, 0).max())
    tiles = [
        Tile(_texture(run.head, values, limits), f"{letter} {name}", note)
        for letter, name, values, note in shown
    ]
    bar = colour_bar(*limits, "temperature [°C]; grey: no contact")
    title = "Textures of the head along z, from above, with the nose downwards"
    caption = (
        "As in the figure: (a) voxelized texture of the cool head, (b) the ball's "
        f"temperature in the conduction texture, (c) the head after {TIMES[1]:g} s, "
        f"(d) and (e) both textures after {TIMES[2]:g} s. Of the layers along z the "
        "highest texel of each pixel is shown."
    )
    return Picture("figure-5.5", sheet(tiles, bar, title, 5), caption)


def _frames(run: BallOnHead) -> Picture:
    triangles = np.concatenate([s.geometry.triangles for s in run.solution.surfaces])
    camera = build_camera(run.config.camera, triangles)
    tiles = []
    for k in (0, len(TIMES) - 1):
        seen = jt.render(run.solution, camera, k)
        celsius = np.asarray(seen.temperature) - ZERO_CELSIUS
        body = np.asarray(seen.object_id) >= 0
        tiles.append(thermal_tile(celsius, body, _SCALE, f"{TIMES[k]:g} s"))
    bar = colour_bar(*_SCALE, "temperature [°C]; the ball is above the scale")
    title = "A hot ball on a cool head"
    caption = "The scene at the start and at its end, as its camera sees it."
    return Picture("figure-5.5-scene", sheet(tiles, bar, title), caption)


def _numbers(run: BallOnHead, height: int) -> dict[str, Any]:
    gained, lost = run.conducted()
    half = height // 2
    areas = {half: contact_area(half), height: float(run.pairs.area.sum())}
    return {
        "height_voxels": height,
        "ball_contact_C": [run.in_contact(BALL, k) for k in range(len(TIMES))],
        "head_contact_C": [run.in_contact(HEAD, k) for k in range(len(TIMES))],
        "warmed_cm2": [1e4 * run.warmed_area(k) for k in range(len(TIMES))],
        "conducted_J": [gained, lost],
        # No closer than rounding.
        "swap": max(abs(gained + lost) / abs(gained), float(np.finfo(float).eps)),
        "contact_cm2": {str(voxels): 1e4 * area for voxels, area in areas.items()},
        "texels": int(np.count_nonzero(run.pairs.coverage_a)),
    }


def _reason(found: dict[str, Any]) -> str:
    ball, head = found["ball_contact_C"], found["head_contact_C"]
    (half, coarse), (height, area) = found["contact_cm2"].items()
    return (
        f"In {TIMES[2]:g} s {found['conducted_J'][0] / 1e3:.2f} kJ go from the ball to "
        f"the head over {found['texels']} texels of it, and what one loses the other "
        f"gains to {found['swap']:.0e}. Where they touch, the ball cools from "
        f"{ball[0]:.0f} to {ball[2]:.0f} °C and the head warms from {head[0]:.0f} to "
        f"{head[2]:.0f} °C; {found['warmed_cm2'][2]:.0f} cm² of it are warmer by 1 K, "
        f"of which {area:.0f} cm² touch. The heat is that of an area which the voxel "
        f"chooses: within one voxel, heads {half} and {height} voxels high have "
        f"{coarse:.1f} and {area:.1f} cm² of contact."
    )


def _rows(found: dict[str, Any]) -> tuple[Row, ...]:
    ball, head = found["ball_contact_C"], found["head_contact_C"]
    first, last = (f"{time:g} s" for time in TIMES[1:])
    _, early, late = found["warmed_cm2"]
    return (
        Row("ball in the texture T_Head, 0 s [°C]", "hot", ball[0], "(b)"),
        Row(f"ball in the texture T_Head, {last} [°C]", None, ball[2], "(d)"),
        Row("head where it is in contact, 0 s [°C]", "cool", head[0], "(a)"),
        Row(
            f"head where it is in contact, {first} [°C]",
            "heated immediately",
            head[1],
            "(c)",
        ),
        Row(f"head where it is in contact, {last} [°C]", None, head[2], "(e)"),
        Row(f"area warmed by 1 K, {first} [cm²]", None, early),
        Row(f"area warmed by 1 K, {last} [cm²]", "spread", late),
        Row(f"heat from ball to head in {last} [J]", None, found["conducted_J"][0]),
        Row("heat lost and gained, relative difference", None, f"{found['swap']:.0e}"),
    )


def _measure(quick: bool) -> Finding:
    if planck() is None:
        return skipped(NO_PLANCK)
    height = _QUICK_HEIGHT if quick else _HEIGHT
    run = ball_on_head(height)
    found = _numbers(run, height)
    ball, head, warmed = (
        found[key] for key in ("ball_contact_C", "head_contact_C", "warmed_cm2")
    )
    flows = ball[0] > ball[2] > head[2] > head[1] > head[0]
    right = flows and found["swap"] <= _SWAP and warmed[2] > warmed[1] > 0
    chosen = (
        ("scene", "configs/scenes/hat-ball-on-planck.yaml, in double precision"),
        ("size", f"a head {height} voxels high, a ball of the same voxels"),
        ("material", "copper, both, so that heat is seen to move in seconds"),
        ("contact", "20 kW/(m² K); the thesis has none, as if bonded"),
        ("threshold", "one voxel"),
        ("(c)", f"{TIMES[1]:g} s, about a frame of the thesis"),
    )
    verdict = Verdict.REPRODUCED if right else Verdict.CONTRADICTED
    parts = (_textures(run), _frames(run))
    return Finding(verdict, _reason(found), _rows(found), {}, chosen, parts, found)


EXHIBIT = Exhibit(
    name="figure-5.5",
    title="a hot ball on a cool head",
    place="5.3, figure 5.5",
    claims=("C17",),
    measure=_measure,
)
