"""Claims on contact (5.3): C18, area by resolution; C19, pruning; a ball on a head."""

from itertools import combinations
from pathlib import Path
from typing import Any

import altair as alt
import jax.numpy as jnp
import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

import jaxthermo as jt
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.image.annotate import write_png
from jaxthermo.image.contact_texture import contact_images, where_covered
from jaxthermo.image.palette import palette_table
from jaxthermo.physics.contact.links import contact_conductance_of
from jaxthermo.physics.contact.rays import PlacedGrid, require_shallow
from jaxthermo.physics.contact.search import (
    ContactPairs,
    broad_phase,
    contact_flux,
    contacts_between,
    find_contacts,
)
from jaxthermo.report.chart import LogAxis, write_chart
from jaxthermo.report.layer_sheets import contact_tiles
from jaxthermo.report.numbers import seconds
from jaxthermo.report.sheet import ColourBar, Tile, enlarged, sheet
from jaxthermo.report.table import Table

from ..harness.meshes import thesis_meshes
from ..harness.present import Rows, colour_bar, show, table_of
from ..harness.timing import timed_call


# Voxels across the ball; figure 5.3 shows 16 and 256, the sheet one between as well.
_RESOLUTIONS = (8, 16, 32, 64, 128, 256)
_SHOWN = (16, 64, 256)
# Thresholds in radii of the ball. One voxel is the smallest that leaves no holes; its
# area shrinks with the voxels, so convergence shows only at a threshold that stays.
_FIXED = 1 / 16
_KINDS = {"one voxel": None, "1/16 radius": _FIXED}
# Edge of a picture, about [px].
_TILE = 320


def _cap_area(threshold: float) -> float:
    # The part of a plane that is nearer than the threshold to a touching unit ball.
    return float(np.pi * (1 - (1 - threshold) ** 2))


def _ball_on_plate(voxels: int) -> tuple[PlacedGrid, PlacedGrid]:
    pitch = 2.0 / voxels
    # The facets stay well under a voxel.
    mesh = sphere(1.0, min(int(np.log2(voxels)) + 1, 7))
    # As wide as the widest contact, and four voxels thick.
    width = 2.2 * float(np.sqrt(2 * max(pitch, _FIXED))) + 4 * pitch
    plate = jt.voxelize(box((width, width, 4 * pitch)), pitch)
    # Off the lattice's symmetry, where errors of opposite fragments would cancel.
    where = (0.013 * pitch, 0.21 * pitch, -float(mesh.bounds[0, 2]))
    return (
        PlacedGrid(jt.voxelize(mesh, pitch), jt.Pose(where), "ball"),
        PlacedGrid(plate, jt.Pose((0.0, 0.0, -2 * pitch)), "plate"),
    )


def _timed_contacts(a: PlacedGrid, b: PlacedGrid, threshold: float | None = None):
    # The first search compiles; the second one is timed.
    find_contacts(a, b, threshold)
    return timed_call(lambda: find_contacts(a, b, threshold))


def _measure_areas(resolutions: tuple[int, ...] = _RESOLUTIONS) -> Rows:
    """Contact area against the cap's, with either body as the first."""
    rows = []
    for voxels in resolutions:
        ball, plate = _ball_on_plate(voxels)
        for kind, threshold in _KINDS.items():
            pairs, time = _timed_contacts(ball, plate, threshold)
            swapped = float(find_contacts(plate, ball, threshold).area.sum())
            exact = _cap_area(threshold or ball.pitch)
            area = float(pairs.area.sum())
            rows.append(
                {
                    "voxels_across": voxels,
                    "threshold": kind,
                    "pairs": pairs.count,
                    "area": area,
                    "area_exact": exact,
                    "error_percent": 100 * (area / exact - 1),
                    "swapped_percent": 100 * (swapped / area - 1),
                    "time_s": time,
                }
            )
    return rows


def _area_table(found: Rows) -> Table:
    columns = [
        ("threshold", "{threshold}"),
        ("voxels", "{voxels_across}"),
        ("pairs", "{pairs}"),
        ("area", "{area:.5f}"),
        ("exact", "{area_exact:.5f}"),
        ("error", "{error_percent:+.2f} %"),
        ("swapped", "{swapped_percent:+.2f} %"),
        ("time", lambda row: seconds(row["time_s"])),
    ]
    title = "C18: contact of a ball of radius 1 on a plate"
    caption = "exact: area of the plate that is nearer than the threshold"
    return table_of(
        sorted(found, key=lambda r: r["threshold"]), columns, title, caption
    )


def _area_chart(rows: Rows, path: Path) -> None:
    # Both thresholds in one chart: the found area must keep to its own dashed line.
    across = LogAxis([row["voxels_across"] for row in rows], "voxels across the ball")
    up = LogAxis([row["area"] for row in rows], "area of contact / radius^2")
    text = "{voxels_across} voxels, within {threshold}: {area:.4f}, "
    text += "{error_percent:+.2f} % off"
    points = [
        {**row, "within": f"within {row['threshold']}", "text": text.format_map(row)}
        for row in rows
    ]
    base = alt.Chart(alt.Data(values=points)).encode(
        x=alt.X(**across.channel("voxels_across")),
        color=alt.Color(
            "within:N",
            legend=alt.Legend(title=None, orient="bottom-left", offset=12),
            scale=alt.Scale(range=["#2166ac", "#c1272d"]),
        ),
    )
    lines = base.mark_line(strokeDash=[5, 4]).encode(
        y=alt.Y(**up.channel("area_exact"))
    )
    dots = base.mark_point(filled=True, size=80, opacity=1).encode(
        y=alt.Y(**up.channel("area")), description="text:N"
    )
    title = "Ball on a plate: found (dots), exact (dashed)"
    write_chart(
        alt.layer(lines, dots).properties(width=560, height=380, title=title), path
    )


def _area_sheet(path: Path, resolutions: tuple[int, ...] = _SHOWN) -> None:
    # The plate's contact texture at several resolutions, after figure 5.3.
    tiles = []
    for voxels in resolutions:
        ball, plate = _ball_on_plate(voxels)
        pairs = find_contacts(ball, plate, _FIXED)
        values = where_covered(pairs.coverage_b, pairs.coverage_b)
        top = contact_images(plate.grid, values)["z_contact"][-1]
        error = 100 * (pairs.area.sum() / _cap_area(_FIXED) - 1)
        name = f"{voxels} voxels across the ball"
        note = f"{pairs.count} pairs, area {error:+.2f} %"
        tiles.append(Tile(enlarged(top, _TILE), name, note))
    bar = ColourBar(
        palette_table("iron"),
        ((0.0, "0"), (0.5, "1/2"), (1.0, "1")),
        "fraction of each fragment in contact; grey: none",
    )
    write_png(path, sheet(tiles, bar, "A ball on a plate, within 1/16 of its radius"))


# Bodies in a scene; their number squared is what the broad phase must not cost.
_COUNTS = (10, 20, 40, 80)
_PITCH = 0.02
# Edge of the scene's cube over the cube root of the number of bodies [m]: so dense that
# some touch at every count, and so that the share of neighbours stays the same.
_SPACING = 0.7
_SEED = 7


def _random_scene(count: int, random: np.random.Generator) -> tuple[PlacedGrid, ...]:
    """Bodies in a cube at random positions and turns, none deep in another."""
    # A turned rod fills little of its bounding box: boxes alone prune it badly.
    meshes = (box((0.5, 0.4, 0.3)), sphere(0.25, 3), box((0.1, 0.1, 1.0)))
    grids, edge = (
        [jt.voxelize(mesh, _PITCH) for mesh in meshes],
        _SPACING * count ** (1 / 3),
    )
    bodies: list[PlacedGrid] = []
    while len(bodies) < count:
        # Four normal numbers, made a unit quaternion, are an evenly distributed turn.
        turn = Rotation.from_quat(random.normal(size=4), scalar_first=True)
        rows = tuple(tuple(row) for row in turn.as_matrix().tolist())
        x, y, z = random.uniform(-edge / 2, edge / 2, 3).tolist()
        grid = grids[len(bodies) % len(grids)]
        body = PlacedGrid(grid, jt.Pose((x, y, z), rows), f"{len(bodies)}")
        try:
            for other in bodies:
                require_shallow(body, other, _PITCH)
        except jt.InputError:
            continue
        bodies.append(body)
    return tuple(bodies)


def _measure_pruning(counts: tuple[int, ...] = _COUNTS) -> Rows:
    """Pairs left after boxes, after views and after the search, by number of bodies."""
    random = np.random.default_rng(_SEED)
    return [_measure_scene(_random_scene(count, random)) for count in counts]


def _measure_scene(bodies: tuple[PlacedGrid, ...]) -> dict[str, Any]:
    # Once before the clock, for what is compiled.
    contacts_between(bodies)
    broad, broad_time = timed_call(lambda: broad_phase(bodies))
    found, search_time = timed_call(lambda: set(contacts_between(bodies)))
    pairs = [*combinations(range(len(bodies)), 2)]
    touch = lambda pair: find_contacts(bodies[pair[0]], bodies[pair[1]]).count
    # The slow reference: every pair is searched, so that none can be lost.
    expected, brute_time = timed_call(lambda: {pair for pair in pairs if touch(pair)})
    return {
        "bodies": len(bodies),
        "possible": broad.possible,
        "after_boxes": broad.overlapping_boxes,
        "after_views": len(broad.pairs),
        "touching": len(expected),
        "lost": len(expected - found),
        "bodies_left": len(broad.bodies),
        "broad_s": broad_time,
        "broad_and_search_s": search_time,
        "search_of_all_pairs_s": brute_time,
    }


def _pruning_table(found: Rows) -> Table:
    columns = [
        ("bodies", "{bodies}"),
        ("pairs", "{possible}"),
        ("boxes", "{after_boxes}"),
        ("views", "{after_views}"),
        ("touch", "{touching}"),
        ("lost", "{lost}"),
        ("broad", "{broad_s:.2f} s"),
        ("and search", "{broad_and_search_s:.2f} s"),
        ("search all", "{search_of_all_pairs_s:.2f} s"),
    ]
    return table_of(found, columns, "C19: pairs of bodies left to search", left=())


# Figure 5.5, a hot ball on a cool head, of which the thesis gives no numbers: both of
# stainless steel [W/(m K)] with h_c [W/(m^2 K)] and a start 100 K apart.
_BALL = 0.18  # radius of the ball over the height of the body
_CONDUCTIVITY, _CONDUCTANCE, _DIFFERENCE = 16.0, 1000.0, 100.0


def _ball_on_head(mesh: jt.Mesh, height: int) -> tuple[PlacedGrid, PlacedGrid]:
    tall = float(np.ptp(mesh.bounds[:, 2]))
    pitch = tall / height
    ball = sphere(_BALL * tall, 5)
    # The ball touches the highest vertex of a face: loose vertices have no surface.
    top = mesh.vertices[mesh.faces].reshape(-1, 3)
    x, y, z = top[top[:, 2].argmax()].tolist()
    rest = jt.Pose((x, y, z - float(ball.bounds[0, 2])))
    return (
        PlacedGrid(jt.voxelize(mesh, pitch), jt.Pose(), "head"),
        PlacedGrid(jt.voxelize(ball, pitch), rest, "ball"),
    )


def _balls_on_heads(meshes: dict[str, jt.Mesh], height: int, folder: Path) -> Rows:
    """Contacts of a ball with each body, and the time to find them."""
    rows = []
    for name, mesh in meshes.items():
        head, ball = _ball_on_head(mesh, height)
        pairs, time = _timed_contacts(head, ball)
        file = f"contact_{name.lower().replace(' ', '_')}.png"
        flux = _first_flux(pairs, head, ball)
        write_png(folder / file, _texture_sheet(name, head, ball, pairs, flux))
        rows.append(
            {
                "mesh": name,
                "height_voxels": height,
                "fragments": [len(b.grid.fragment_area) for b in (head, ball)],
                "pairs": pairs.count,
                "area_m2": float(pairs.area.sum()),
                "first_heat_rate_W": float(flux[0] @ head.grid.fragment_area),
                "time_s": time,
                "picture": file,
            }
        )
    return rows


def _first_flux(pairs: ContactPairs, head: PlacedGrid, ball: PlacedGrid):
    # Heat flux into every fragment of head and ball at first [W/m^2]: two half cells
    # and the contact in series.
    half = [2 * _CONDUCTIVITY / b.pitch * pairs.area for b in (head, ball)]
    through = contact_conductance_of(
        jnp.asarray(pairs.area), half[0], half[1], _CONDUCTANCE
    )
    rate = np.asarray(through, float) * _DIFFERENCE
    return (
        contact_flux(pairs.fragment_a, rate, head.grid.fragment_area),
        contact_flux(pairs.fragment_b, -rate, ball.grid.fragment_area),
    )


def _texture_sheet(
    name: str, head: PlacedGrid, ball: PlacedGrid, pairs: ContactPairs, flux
) -> Image.Image:
    # Only layers that hold any contact; both bodies on one scale [kW/m^2].
    max_flux = max(float(np.abs(each).max()) for each in flux) / 1e3
    tiles: list[Tile] = []
    coverages = pairs.coverage_a, pairs.coverage_b
    for body, each, coverage in zip((head, ball), flux, coverages, strict=True):
        values = where_covered(np.abs(each) / 1e3, coverage)
        tiles += contact_tiles(body.name, body.grid, values, 0.0, max_flux)
    words = f"heat flux through the contact at first [kW/m^2], ball {_DIFFERENCE:g} K "
    bar = colour_bar(0.0, max_flux, words + "hotter; grey: no contact")
    title = f"{name} and a ball: {pairs.count} pairs, {pairs.area.sum() * 1e4:.2f} cm^2"
    return sheet(tiles, bar, title)


def _head_table(found: Rows) -> Table:
    columns = [
        ("mesh", "{mesh}"),
        ("high", "{height_voxels}"),
        ("fragments", "{fragments[0]} + {fragments[1]}"),
        ("pairs", "{pairs}"),
        ("area", lambda row: f"{row['area_m2'] * 1e4:.2f} cm^2"),
        ("time", lambda row: seconds(row["time_s"])),
    ]
    return table_of(found, columns, "A ball on a head, thesis figure 5.5")


def run(folder: Path, height: int = 60) -> dict[str, Any]:
    """C18, C19, and figure 5.5 with heads of `height` voxels; charts and pictures."""
    areas = _measure_areas()
    show(_area_table(areas))
    _area_chart(areas, folder / "contact_area")
    _area_sheet(folder / "contact_area_layers.png")
    pruning = _measure_pruning()
    show(_pruning_table(pruning))
    heads = _balls_on_heads(thesis_meshes(), height, folder)
    show(_head_table(heads))
    return {"C18": areas, "C19": pruning, "heads": heads}
