"""Claims on radiation (5.1): C02, C03, C04, and occlusion on and off."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import altair as alt
import numpy as np

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.physics.radiation.patches import PatchedBody, group_patches
from jaxthermo.physics.radiation.source import AbstractSource
from jaxthermo.physics.radiation.view_factors import (
    DEFAULT_DIRECTIONS,
    view_factors,
)
from jaxthermo.reference.view_factor import element_to_rectangle, parallel_rectangles
from jaxthermo.report import page
from jaxthermo.report.chart import Chart, LogAxis, write_chart
from jaxthermo.report.table import Cell, Table

from ..harness.present import Rows, publish, table_of
from .radiation_occlusion import show_occlusion


# The thesis' 100 K of difference [K]; what it gets of it [W/m^2] at which distance [m].
_HOT, _COLD = 400.0, 300.0
_THESIS_FLUX, _THESIS_DISTANCE = 31.15, 10.0
# Irradiance of the sun, with which the thesis compares [W/m^2].
_SUN = 1000.0
# Gaps between two cubes, in sizes of one: to the thesis' 10 m between cubes of 1 m.
_GAPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
# Voxels along the edge of a cube, and its patches: 4 x 4 on each of its six sides.
_VOXELS, _PATCHES = 20, 96
# Difference of black emission at the two temperatures [W/m^2].
_EXCESS = STEFAN_BOLTZMANN * (_HOT**4 - _COLD**4)


def measure_thesis_flux() -> dict[str, Any]:
    """C02: 31.15 W/m^2 at 10 m, beside what a black square metre radiates there."""
    exchanged = lambda a: _EXCESS * parallel_rectangles(a, a, _THESIS_DISTANCE)
    is_small = lambda edge: exchanged(edge) < _THESIS_FLUX
    small = _EXCESS / (np.pi * _THESIS_DISTANCE**2)
    slip = _EXCESS * np.pi / _THESIS_DISTANCE**2
    return {
        "thesis_W_m2": _THESIS_FLUX,
        "two_squares_of_1_m_W_m2": exchanged(1.0),
        "small_emitter_E_over_pi_R2_W_m2": small,
        "E_pi_over_R2_W_m2": slip,
        "thesis_over_right": _THESIS_FLUX / small,
        "pi_squared": float(np.pi**2),
        "edge_of_squares_that_give_it_m": _bisected(is_small, 1e-3, 1e3),
    }


def _bisected(is_below: Callable[[float], bool], low: float, high: float) -> float:
    # By the geometric mean, since the unknown may lie decades away.
    for _ in range(100):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if is_below(middle) else (low, middle)
    return low


def ten_percent_gap() -> float:
    """The gap, in sizes, up to which a tenth of the view is the other cube."""
    return _bisected(lambda gap: parallel_rectangles(1.0, 1.0, gap) > 0.1, 1e-2, 1e2)


def measure_neighbours(
    gaps: tuple[float, ...] = _GAPS, directions: int = DEFAULT_DIRECTIONS
) -> Rows:
    """C03: two black cubes of 1 m, 100 K apart, face to face.

    The flux onto the side of the cold one that faces the hot one, by the closed form
    and by the view factors of the voxelized cubes.
    """
    cube = jt.voxelize(box((1.0, 1.0, 1.0)), 1.0 / _VOXELS)
    return [_neighbours(cube, gap, directions) for gap in gaps]


def _neighbours(cube: jt.VoxelGrid, gap: float, directions: int) -> dict[str, Any]:
    exact = parallel_rectangles(1.0, 1.0, gap)
    bodies = tuple(_body(cube, shift) for shift in (0.0, 1.0 + gap))
    count = bodies[0].patches.count
    views = view_factors(bodies, directions)
    found = float(views.between[:count, count:].sum())
    # An insulated wall is as warm as what it sees: hot neighbour and surroundings.
    wall = (exact * _HOT**4 + (1 - exact) * _COLD**4) ** 0.25
    return {
        "gap_sizes": gap,
        "view_factor": exact,
        "view_factor_of_voxels": found,
        "error_of_voxels": found / exact - 1,
        "flux_W_m2": _EXCESS * exact,
        "flux_of_voxels_W_m2": _EXCESS * found,
        "share_of_100_K_excess": exact,
        "share_of_sun": _EXCESS * exact / _SUN,
        "insulated_wall_missed_K": float(wall - _COLD),
    }


def _body(cube: jt.VoxelGrid, shift: float) -> PatchedBody:
    pose = jt.Pose(translation=(shift, 0.0, 0.0))
    surface = cube.fragment_position, cube.fragment_normal, cube.fragment_area
    patches = group_patches(*surface, cube.lattice, _PATCHES)
    return PatchedBody.of_mesh(cube.mesh, patches, pose)


def neighbour_chart(rows: Rows) -> Chart:
    """Flux over the gap by the closed form and by voxels, beside the thesis' two."""
    gaps = np.geomspace(rows[0]["gap_sizes"], rows[-1]["gap_sizes"], 60)
    line = [
        {"gap": g, "flux": _EXCESS * parallel_rectangles(1.0, 1.0, g)}
        for g in gaps.tolist()
    ]
    text = "{gap_sizes:g} sizes: {flux_of_voxels_W_m2:.4g} W/m^2"
    dots = [
        {
            "gap": row["gap_sizes"],
            "flux": row["flux_of_voxels_W_m2"],
            "text": text.format_map(row),
        }
        for row in rows
    ]
    # The two fluxes that the thesis compares with each other.
    levels = [
        {"flux": _SUN, "text": "sun on the ground, 1000"},
        {"flux": _THESIS_FLUX, "text": "thesis at 10 m, 31.15"},
    ]
    across = LogAxis([float(g) for g in gaps], "gap between two cubes [sizes of one]")
    up = LogAxis([_SUN, line[-1]["flux"]], "net flux onto the facing side [W/m²]")
    x, y = alt.X(**across.channel("gap")), alt.Y(**up.channel("flux"))
    data = lambda values: alt.Chart(alt.Data(values=values))
    rule = data(levels).mark_rule(strokeDash=[5, 4], color="#7a808c").encode(y=y)
    text = data(levels).mark_text(align="right", dx=-6, dy=-7, fontSize=12)
    marks = data(dots).mark_point(filled=True, size=70, opacity=1, color="#c1272d")
    chart = alt.layer(
        rule,
        text.encode(y=y, x=alt.value(640), text="text:N"),
        data(line).mark_line(color="#20242c", strokeWidth=2).encode(x=x, y=y),
        marks.encode(x=x, y=y, description="text:N"),
    )
    title = "A black cube 100 K hotter: line, closed form; points, voxels"
    return chart.properties(width=640, height=380, title=title)


def neighbour_table(found: Rows) -> Table:
    """View factors and fluxes by gap."""
    columns = [
        ("gap / size", "{gap_sizes:g}"),
        ("F", "{view_factor:.5f}"),
        ("F, voxels", "{view_factor_of_voxels:.5f}"),
        ("error", "{error_of_voxels:+.2%}"),
        ("W/m^2", "{flux_W_m2:.4g}"),
        ("of the sun's 1000 W/m^2", "{share_of_sun:.1%}"),
        ("insulated wall misses", "{insulated_wall_missed_K:.3g} K"),
    ]
    title = "C03: two black cubes, 400 K and 300 K, face to face"
    return table_of(found, columns, title)


# C04: radius of the ball, edge of a voxel [m], and the error that passes.
_RADIUS, _PITCH = 0.2, 0.01
_WITHIN = 0.01


def _exposure(
    grid: jt.VoxelGrid, source: AbstractSource, *others: jt.Mesh
) -> np.ndarray:
    triangles = np.concatenate([grid.mesh.triangles, *(m.triangles for m in others)])
    return source.exposure(
        triangles, grid.fragment_position, grid.fragment_normal, grid.pitch
    )


def _check(what: str, found: float, exact: float) -> dict[str, Any]:
    error = found / exact - 1
    return {
        "what": what,
        "found": float(found),
        "exact": float(exact),
        "error": float(error),
        "passes": bool(abs(error) <= _WITHIN),
    }


def measure_light() -> dict[str, Any]:
    """C04: what a ball, a plate and hollows catch, and where a ball's night begins."""
    ball = jt.voxelize(sphere(_RADIUS, subdivisions=4), _PITCH)
    rays = (-1.0, 0.4, -0.7)
    away = -np.array(rays) / np.linalg.norm(rays)
    sun, lamp = jt.Sun(rays, 1.0), jt.PointSource(tuple((0.5 * away).tolist()), 1.0)
    disc = np.pi * _RADIUS**2
    cone = 2 * np.pi * (1 - np.sqrt(1 - (_RADIUS / 0.5) ** 2))
    caught = lambda source: float(_exposure(ball, source) @ ball.fragment_area)
    checks = [
        _check("ball in the sun: its disc [m²]", caught(sun), disc),
        _check("ball by a lamp: its solid angle [sr]", caught(lamp), cone),
        *_hollow(),
        _panel(),
        *(_shadow(angle) for angle in (0.0, 30.0, 60.0)),
    ]
    return {"checks": checks, "terminator": _terminator(ball, sun, away)}


def _terminator(ball: jt.VoxelGrid, sun: jt.Sun, away: np.ndarray) -> dict[str, float]:
    # Angles from the sun; a fragment that is partly lit lies between the two.
    exposure = _exposure(ball, sun)
    angle = np.rad2deg(np.arccos(np.clip(ball.fragment_normal @ away, -1, 1)))
    # A fragment that is lit in full has the whole of its cosine.
    lit = exposure / np.maximum(np.cos(np.deg2rad(angle)), 1e-9)
    return {
        "last_lit_degrees": float(angle[exposure > 0].max()),
        "first_shaded_degrees": float(angle[lit < 1 - 1e-9].min()),
        "exact_degrees": 90.0,
    }


def _hollow() -> Rows:
    """A lamp and a panel in a hollow ball: all they send out is caught."""
    hole, hull = sphere(_RADIUS, 3), sphere(1.2 * _RADIUS, 3)
    faces = [hull.faces, hole.faces[:, ::-1] + len(hull.vertices)]
    vertices = np.concatenate([hull.vertices, hole.vertices])
    hollow = jt.voxelize(jt.Mesh(vertices, np.concatenate(faces), "hollow"), 2 * _PITCH)
    lamp = jt.PointSource((0.1, -0.05, 0.08), 1.0)
    panel = jt.AreaSource((0.02, 0.0, 0.05), (1.0, 0.5, 0.2), (0.1, 0.06), radiance=1.0)
    sums = [float(_exposure(hollow, s) @ hollow.fragment_area) for s in (lamp, panel)]
    return [
        _check("lamp in a hollow ball: 4 pi [sr]", sums[0], 4 * np.pi),
        _check("panel in a hollow ball: pi A [m² sr]", sums[1], np.pi * 0.1 * 0.06),
    ]


def _panel() -> dict[str, Any]:
    """A14: a black plate, 2 x 2 m at 1000 degC, 1 m above an element."""
    plate = jt.AreaSource((0, 0, 1.0), (0, 0, -1.0), (2.0, 2.0), temperature=1273.15)
    here, up = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    exposure = plate.exposure(np.zeros((0, 3, 3)), here, up, _PITCH)
    exact = STEFAN_BOLTZMANN * 1273.15**4 * 4 * element_to_rectangle(1.0, 1.0, 1.0)
    found = float(plate.strength * exposure[0])
    return _check("hot plate over an element, A14 [W/m²]", found, exact)


def _shadow(degrees: float) -> dict[str, Any]:
    """Light on a plate of 40 x 40 voxels, 3 cm below a box 2 cm thick."""
    plate = jt.voxelize(box((0.4, 0.4, 0.02)), _PITCH)
    cover = box((0.12, 0.16, 0.02)).moved((0.03, 0.01, 0.05))
    slope = float(np.tan(np.deg2rad(degrees)))
    sun = jt.Sun((-slope, 0.0, -1.0), 1.0)
    top = plate.fragment_normal[:, 2] > 0.9
    cosine = 1 / np.hypot(1.0, slope)
    found = float(_exposure(plate, sun, cover)[top] @ plate.fragment_area[top])
    shadow = (0.12 + 0.02 * slope) * 0.16
    exact = (0.4 * 0.4 - shadow) * cosine
    return _check(f"plate below a box, sun at {degrees:g}° [m²]", found, exact)


def light_table(result: dict[str, Any]) -> Table:
    """Checks of shadow maps and the cosine."""
    columns = [
        ("", "{what}"),
        ("found", "{found:.6g}"),
        ("exact", "{exact:.6g}"),
        ("error", "{error:+.2%}"),
        ("within", lambda row: Cell("1 %" if row["passes"] else "over", row["passes"])),
    ]
    return table_of(result["checks"], columns, "C04: shadow maps and Lambert's cosine")


def run(folder: Path, height: int = 110) -> dict[str, Any]:
    """C02, C03, C04 and occlusion on a figurine of `height` voxels: `report.html`."""
    flux, rows, gap = measure_thesis_flux(), measure_neighbours(), ten_percent_gap()
    lit, shown = measure_light(), show_occlusion(folder, height)
    sections = [
        *_thesis_flux(flux),
        *_neighbour_sections(rows, gap, folder),
        *_light(lit),
        *_occlusion(shown, folder),
    ]
    publish(folder, "Radiation: the thesis' claims", sections)
    return {
        "C02": flux,
        "C03": {"rows": rows, "ten_percent_up_to_sizes": gap},
        "C04": lit,
        "occlusion": shown,
        "files": ["report.html", "neighbours.svg", "neighbours.png"],
    }


def _thesis_flux(flux: dict[str, Any]) -> list[page.Section]:
    rows = [
        ["thesis", f"{flux['thesis_W_m2']:.2f}"],
        ["E pi / R²", f"{flux['E_pi_over_R2_W_m2']:.2f}"],
        ["E A / (pi R²), 1 m²", f"{flux['small_emitter_E_over_pi_R2_W_m2']:.3f}"],
        ["two squares of 1 m, exact", f"{flux['two_squares_of_1_m_W_m2']:.4f}"],
    ]
    return [
        page.heading("C02: 31.15 W/m² at 10 m"),
        "The thesis lets a body 100 K hotter send 31.15 W/m² over 10 m and fills Table "
        "5.1 with it. Two black squares of 1 m, 400 K and 300 K, exchange "
        f"{flux['two_squares_of_1_m_W_m2']:.3g} W/m² there: "
        f"{flux['thesis_over_right']:.2f} times less. That is pi squared, 9.87: "
        "E pi / R² stands where Lambert's law has E / (pi R²).",
        Table(["at 10 m", "W/m²"], rows, "C02: flux of a body 100 K hotter"),
        page.paragraph(
            "Squares that exchange as much would have edges of "
            f"{flux['edge_of_squares_that_give_it_m']:.2f} m. All rates of Table 5.1 "
            "are too high by the same factor.",
            note=True,
        ),
    ]


def _neighbour_sections(rows: Rows, gap: float, folder: Path) -> list[page.Section]:
    return [
        page.heading("C03: other bodies do not matter"),
        "At 10 m, less so than the thesis says; near by they do. Two black cubes of 1 "
        "m stand face to face, 400 K and 300 K, in surroundings at 300 K. Up to a gap "
        f"of {gap:.2f} sizes more than a tenth of the view is the other cube. The "
        "last column is what an insulated black wall on the cold side would miss of "
        "its temperature, were the neighbour left out.",
        neighbour_table(rows),
        write_chart(neighbour_chart(rows), folder / "neighbours"),
    ]


def _light(lit: dict[str, Any]) -> list[page.Section]:
    night = lit["terminator"]
    return [
        page.heading("C04: shadow map and Lambert's cosine"),
        light_table(lit),
        "The ball's night begins at 90°: the last fragment with any light stands at "
        f"{night['last_lit_degrees']:.2f}°, the first that is not lit in full at "
        f"{night['first_shaded_degrees']:.2f}°. The edge of a shadow is right to half "
        "a voxel as the source sees it.",
    ]


def _occlusion(shown: dict[str, Any], folder: Path) -> list[page.Section]:
    ball = shown["ball_on_plane"]
    return [
        page.heading("Ambient occlusion, on and off"),
        f"The figurine, {shown['height_voxels']} voxels high: {shown['fragments']} "
        f"fragments in {shown['directions']} directions in {shown['time_s']:.1f} s. "
        "The mean view factor to the surroundings is "
        f"{shown['view_factor_mean']:.3f}. After half an hour the surface is "
        f"{shown['warmer_mean_K']:.2f} K warmer on average with occlusion, "
        f"{shown['warmer_most_K']:.1f} K at most: the robe is cast hollow, and "
        "without occlusion its inside, too, emits to the sky. What hides the "
        "surroundings counts as being as warm as the surface that sees it.",
        *(page.picture(folder / name, name) for name in shown["pictures"]),
        "On a plane below a ball, against the closed form: rays are off by "
        f"{ball['rays_rms']:.3f} RMS, the screen-space variant by "
        f"{ball['screen_rms']:.3f}, the two from each other over the whole image by "
        f"{ball['screen_less_rays_rms']:.3f}; on the figurine by "
        f"{shown['screen_less_rays_rms']:.3f}, since the image shows no backs and "
        "looks no farther than the radius it is given.",
    ]
