"""5.1: fluxes of bodies and sources, shadows, and table 5.1."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import root_scalar

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.geometry.mesh import joined
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.material.table import material_rows, thesis_material
from jaxthermo.physics.radiation.patches import PatchedBody, group_patches
from jaxthermo.physics.radiation.source import AbstractSource
from jaxthermo.physics.radiation.view_factors import DEFAULT_DIRECTIONS, view_factors
from jaxthermo.reference.view_factor import element_to_rectangle, parallel_rectangles
from jaxthermo.report.chart import Chart

from ...harness.line_chart import DOT, LINE, curve, log_chart
from ..exhibit import Finding, Numbers, Verdict, exhibit, judged


# The thesis' 100 K of difference [K]; what it gets of it [W/m^2] at which distance [m].
_HOT = 400.0
_COLD = 300.0
_THESIS_FLUX = 31.15
_THESIS_DISTANCE = 10.0
# Irradiance of the sun, with which the thesis compares [W/m^2].
_SUN = 1000.0
# Gaps between two cubes, in sizes of one: to the thesis' 10 m between cubes of 1 m.
_GAPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
# Voxels along the edge of a cube, and its patches: 4 x 4 on each of its six sides.
_VOXELS = 20
_PATCHES = 96
# Difference of black emission at the two temperatures [W/m^2].
_EXCESS = STEFAN_BOLTZMANN * (_HOT**4 - _COLD**4)
# Radius of a ball, edge of a voxel [m], and the relative error of a shadow allowed.
_RADIUS = 0.2
_PITCH = 0.01
_MAX_ERROR = 0.01


@exhibit("section-5.1-flux", "5.1")
def _flux_of_a_warm_body(_: bool) -> Finding:
    """Compare 31.15 W/m² at 10 m with what a black square metre radiates there."""
    small = _EXCESS / (np.pi * _THESIS_DISTANCE**2)
    return Finding(
        Verdict.CONTRADICTED,
        {
            "thesis_W_m2": _THESIS_FLUX,
            "two_squares_of_1_m_W_m2": _exchanged(1.0),
            "small_emitter_E_over_pi_R2_W_m2": small,
            "E_pi_over_R2_W_m2": _EXCESS * np.pi / _THESIS_DISTANCE**2,
            "thesis_over_right": _THESIS_FLUX / small,
            "pi_squared": np.pi**2,
            "edge_of_squares_that_give_it_m": root_scalar(
                lambda edge: _exchanged(edge) - _THESIS_FLUX, bracket=(1e-3, 1e3)
            ).root,
        },
    )


def _exchanged(edge: float) -> float:
    """Flux between two squares at the thesis' distance [W/m^2]."""
    return _EXCESS * parallel_rectangles(edge, edge, _THESIS_DISTANCE)


@exhibit("section-5.1-neighbours", "5.1")
def _radiation_of_neighbours(_: bool) -> Finding:
    """Let two black cubes, 100 K apart, exchange heat over several gaps."""
    rows = measure_neighbours()
    gap = ten_percent_gap()
    return Finding(
        judged(gap <= 0.5),
        {"rows": rows, "ten_percent_up_to_sizes": gap},
        {"neighbours": neighbour_chart(rows)},
    )


def ten_percent_gap() -> float:
    """The gap, in sizes, up to which a tenth of the view is the second cube."""
    crossing = root_scalar(
        lambda gap: parallel_rectangles(1.0, 1.0, gap) - 0.1, bracket=(1e-2, 1e2)
    )
    return float(crossing.root)


def measure_neighbours(
    gaps: Sequence[float] = _GAPS, directions: int = DEFAULT_DIRECTIONS
) -> list[dict[str, float]]:
    """Flux onto the side of the cold one of two cubes that faces the hot one.

    By the closed form and by the view factors of the voxelized cubes.
    """
    cube = jt.voxelize(box((1.0, 1.0, 1.0)), 1.0 / _VOXELS)
    rows = []
    for gap in gaps:
        exact = parallel_rectangles(1.0, 1.0, gap)
        bodies = (_patched(cube, 0.0), _patched(cube, 1.0 + gap))
        count = bodies[0].patches.count
        views = view_factors(bodies, directions)
        of_voxels = float(views.between[:count, count:].sum())
        # An insulated wall is as warm as what it sees: hot neighbour and surroundings.
        wall = (exact * _HOT**4 + (1 - exact) * _COLD**4) ** 0.25
        rows.append(
            {
                "gap_sizes": gap,
                "view_factor": exact,
                "view_factor_of_voxels": of_voxels,
                "error_of_voxels": of_voxels / exact - 1,
                "flux_W_m2": _EXCESS * exact,
                "flux_of_voxels_W_m2": _EXCESS * of_voxels,
                "share_of_100_K_excess": exact,
                "share_of_sun": _EXCESS * exact / _SUN,
                "insulated_wall_missed_K": wall - _COLD,
            }
        )
    return rows


def _patched(cube: jt.VoxelGrid, shift: float) -> PatchedBody:
    pose = jt.Pose(translation=(shift, 0.0, 0.0))
    patches = group_patches(cube, area=cube.fragment_area, max_patches=_PATCHES)
    return PatchedBody.of_grid(cube, patches, pose)


def neighbour_chart(rows: Sequence[dict[str, float]]) -> Chart:
    """Flux over the gap by the closed form and by voxels, with the thesis' two."""
    gaps = np.geomspace(rows[0]["gap_sizes"], rows[-1]["gap_sizes"], 60)
    exact = [_EXCESS * parallel_rectangles(1.0, 1.0, gap) for gap in gaps.tolist()]
    points = curve("closed form", gaps, exact, marks=LINE)
    sizes = [row["gap_sizes"] for row in rows]
    fluxes = [row["flux_of_voxels_W_m2"] for row in rows]
    points += curve("voxels", sizes, fluxes, marks=DOT)
    # The two fluxes that the thesis compares with each other.
    ends = gaps[[0, -1]]
    points += curve("sun on the ground, 1000", ends, [_SUN] * 2, marks=LINE)
    points += curve("thesis at 10 m, 31.15", ends, [_THESIS_FLUX] * 2, marks=LINE)
    return log_chart(
        points=points,
        x_title="gap between two cubes [sizes of one]",
        y_title="net flux onto the facing side [W/m²]",
        title="A black cube 100 K hotter",
    )


@exhibit("equation-3", "5.1, equation 3")
def _light_and_shadow(_: bool) -> Finding:
    """Compare what a ball, a plate and hollows catch with closed forms."""
    ball = jt.voxelize(sphere(_RADIUS, subdivisions=4), _PITCH)
    rays = (-1.0, 0.4, -0.7)
    upstream = -np.array(rays) / np.linalg.norm(rays)
    sun = jt.Sun(rays, 1.0)
    lamp = jt.PointSource(tuple((0.5 * upstream).tolist()), 1.0)
    disc = np.pi * _RADIUS**2
    cone = 2 * np.pi * (1 - np.sqrt(1 - (_RADIUS / 0.5) ** 2))
    checks = [
        _check("ball in the sun: its disc [m²]", _caught(ball, sun), disc),
        _check("ball by a lamp: its solid angle [sr]", _caught(ball, lamp), cone),
        *_hollow(),
        _panel(),
        *(_shadow(angle) for angle in (0.0, 30.0, 60.0)),
    ]
    is_met = all(check["passes"] for check in checks)
    return Finding(
        judged(False, different=is_met),
        {
            "checks": checks,
            "worst": max(checks, key=lambda check: abs(check["error"])),
            "count": len(checks),
            "terminator": _terminator(ball, sun, upstream),
        },
    )


def _check(quantity: str, computed: float, exact: float) -> Numbers:
    error = computed / exact - 1
    return {
        "what": quantity,
        "found": computed,
        "exact": exact,
        "error": error,
        "passes": bool(abs(error) <= _MAX_ERROR),
    }


def _exposure(
    grid: jt.VoxelGrid, source: AbstractSource, cover: jt.Mesh | None = None
) -> Float[np.ndarray, " s"]:
    triangles = grid.mesh.triangles
    if cover is not None:
        triangles = np.concatenate([triangles, cover.triangles])
    return source.exposure(
        triangles, grid.fragment_position, grid.fragment_normal, grid.pitch
    )


def _caught(grid: jt.VoxelGrid, source: AbstractSource) -> float:
    return float(_exposure(grid, source) @ grid.fragment_area)


def _terminator(
    ball: jt.VoxelGrid, sun: jt.Sun, upstream: np.ndarray
) -> dict[str, float]:
    # Angles from the sun; a fragment that is partly lit lies between the two.
    exposure = _exposure(ball, sun)
    cosine = np.clip(ball.fragment_normal @ upstream, -1, 1)
    angle = np.rad2deg(np.arccos(cosine))
    # A fragment that is lit in full has the whole of its cosine.
    lit = exposure / np.maximum(np.cos(np.deg2rad(angle)), 1e-9)
    return {
        "last_lit_degrees": float(angle[exposure > 0].max()),
        "first_shaded_degrees": float(angle[lit < 1 - 1e-9].min()),
        "exact_degrees": 90.0,
    }


def _hollow() -> list[Numbers]:
    """A lamp and a panel in a hollow ball: all they send out is caught."""
    hole = sphere(_RADIUS, 3)
    hull = sphere(1.2 * _RADIUS, 3)
    inward = hole.vertices, hole.faces[:, ::-1]
    vertices, faces = joined([(hull.vertices, hull.faces), inward])
    hollow = jt.voxelize(jt.Mesh(vertices, faces, "hollow"), 2 * _PITCH)
    lamp = jt.PointSource((0.1, -0.05, 0.08), 1.0)
    panel = jt.AreaSource((0.02, 0.0, 0.05), (1.0, 0.5, 0.2), (0.1, 0.06), radiance=1.0)
    of_panel = np.pi * 0.1 * 0.06
    return [
        _check("lamp in a hollow ball: 4 pi [sr]", _caught(hollow, lamp), 4 * np.pi),
        _check(
            "panel in a hollow ball: pi A [m² sr]", _caught(hollow, panel), of_panel
        ),
    ]


def _panel() -> Numbers:
    """A14: a black plate, 2 x 2 m at 1000 degC, 1 m above an element."""
    plate = jt.AreaSource((0, 0, 1.0), (0, 0, -1.0), (2.0, 2.0), temperature=1273.15)
    up = np.array([[0.0, 0.0, 1.0]])
    element = np.zeros((1, 3))
    no_obstacles = np.zeros((0, 3, 3))
    exposure = plate.exposure(no_obstacles, element, up, _PITCH)
    exact = STEFAN_BOLTZMANN * 1273.15**4 * 4 * element_to_rectangle(1.0, 1.0, 1.0)
    irradiance = float(plate.strength * exposure[0])
    return _check("hot plate over an element, A14 [W/m²]", irradiance, exact)


def _shadow(degrees: float) -> Numbers:
    """Light on a plate of 40 x 40 voxels, 3 cm below a box 2 cm thick."""
    plate = jt.voxelize(box((0.4, 0.4, 0.02)), _PITCH)
    cover = box((0.12, 0.16, 0.02)).moved((0.03, 0.01, 0.05))
    slope = float(np.tan(np.deg2rad(degrees)))
    sun = jt.Sun((-slope, 0.0, -1.0), 1.0)
    top = plate.fragment_normal[:, 2] > 0.9
    light = float(_exposure(plate, sun, cover)[top] @ plate.fragment_area[top])
    shadow = (0.12 + 0.02 * slope) * 0.16
    exact = (0.4 * 0.4 - shadow) / np.hypot(1.0, slope)
    return _check(f"plate below a box, sun at {degrees:g}° [m²]", light, exact)


# Rates of table 5.1 as printed [K/s].
_RATES = {
    "platinum": 1.08e-5,
    "gold": 1.28e-5,
    "mercury": 1.64e-5,
    "lead": 2.15e-5,
    "silver": 1.27e-5,
    "copper": 9.01e-6,
    "iron": 8.91e-6,
    "diamond": 1.75e-5,
    "aluminium": 1.29e-5,
    "water": 7.44e-6,
    "ethanol": 1.62e-5,
    "gasoline": 1.92e-5,
}


@exhibit("table-5.1", "5.1, table 5.1")
def _heating_rates(quick: bool) -> Finding:
    """Heat a cube of twelve materials by the thesis' flux, in steps of one second."""
    seconds = 10 if quick else 1000
    cube = jt.FullVolume(jt.voxelize(box((1.0, 1.0, 1.0)), 1.0))
    flux = jt.HeatFlux(_THESIS_FLUX, on=jt.Side((0.0, 0.0, 1.0)))
    rates = {}
    for row in material_rows():
        if row.name not in _RATES:
            continue
        material = thesis_material(row.name)
        body = jt.Body(cube, material, temperature=300.0)
        scene = jt.Scene((body,), (flux,), dtype="float64")
        run = jt.simulate(scene, float(seconds), solver=jt.ForwardEuler(dt=1.0))
        # In heat: a rise of 1e-5 K is rounded off a temperature of 300 K.
        capacity = float(material.volumetric_heat_capacity)
        rate = float(run.energy.stored_J[0]) / capacity / seconds
        reference = _THESIS_FLUX / (row.density * row.specific_heat)
        rates[row.name] = {
            "thesis_K_s": _RATES[row.name],
            "ours_K_s": rate,
            "reference_K_s": reference,
            "reference_over_ours": reference / rate - 1,
        }
    equal = [f"{r['ours_K_s']:.2e}" == f"{r['thesis_K_s']:.2e}" for r in rates.values()]
    farthest = max(rates, key=lambda name: abs(rates[name]["reference_over_ours"]))
    return Finding(
        judged(all(equal)),
        {
            "rates": rates,
            "equal": sum(equal),
            "count": len(equal),
            "farthest": farthest,
            "largest_difference": rates[farthest]["reference_over_ours"],
        },
    )
