"""Figure 5.4: two cylinders in contact, found texel by texel, and a ball on a plate."""

from typing import NamedTuple

from jaxthermo.report.table import Table

from ...harness.present import Rows, table_of
from ..contact_area import (
    BALL,
    BALL_VOXEL,
    COARSE,
    CYLINDERS,
    FIXED,
    METHODS,
    OFFSET,
    SHOWN,
    ball_on_plate,
    by_resolution,
    by_threshold,
    cap_area,
    found_areas,
    two_cylinders,
)
from ..contact_pictures import cylinder_textures, plate_textures
from ..exhibit import Exhibit, Finding, Plot, Row, Verdict
from ..line_chart import log_chart, point


_QUICK, _FULL = (8, COARSE, 32, SHOWN), (8, COARSE, 32, SHOWN, 128, 256)
# Largest error of an area at the finest resolution [%].
_WITHIN = 2.0


def _error_chart(rows: Rows) -> Plot:
    points = [
        point(
            f"{row['case']}, {method}",
            row["voxels_across"],
            abs(row["error_percent"][key]),
            f"{row['voxels_across']} voxels: {row['error_percent'][key]:+.2g} %",
        )
        for row in rows
        for key, method in METHODS.items()
    ]
    x, y = "voxels across", "error of the area [%]"
    chart = log_chart(points, x, y, "Area of contact against the closed form")
    caption = "Magnitude of the error. Ball on a plate within 1/16 of its radius."
    return Plot("figure-5.4-error", chart, caption)


def _threshold_chart(rows: Rows) -> Plot:
    points, found = [], []
    for row in rows:
        x, text = row["threshold"], f"{row['case']}: {row['rays']:.4f}"
        points.append(point(f"{row['case']}, closed form", x, row["exact"]))
        found.append(point("found by rays", x, row["rays"], text, mark=True))
    chart = log_chart(
        points + found,
        "threshold of depth / radius",
        "area of contact / radius²",
        "Area of contact over the threshold",
    )
    caption = (
        f"{SHOWN} voxels across, each 1/{SHOWN // 2} of the radius. Flat faces have "
        "one area at every threshold; the area of a ball on a plate is the threshold's."
    )
    return Plot("figure-5.4-threshold", chart, caption)


def _table(rows: Rows) -> Table:
    off = lambda key: lambda row: f"{row['error_percent'][key]:+.2f} %"
    columns = [
        ("bodies", "{case}"),
        ("voxels", "{voxels_across}"),
        ("threshold", "{threshold:.4g}"),
        ("exact", "{exact:.4f}"),
        ("texels T_A", off("texels_a")),
        ("texels T_B", off("texels_b")),
        ("by rays", off("rays")),
    ]
    caption = (
        "Lengths in radii. T_A of the cylinders is that of the lower one, of the ball "
        "the ball's; T_B is the other body's, after A and B are exchanged."
    )
    ordered = sorted(rows, key=lambda row: row["case"], reverse=True)
    return table_of(ordered, columns, "Areas of contact", caption)


class _Found(NamedTuple):
    """Rows of the cases by resolution, and three ratios."""

    lens: Rows
    disc: Rows
    within_voxel: Rows
    compared: float
    """Texels of a cylinder over its voxels."""
    two_sided: float
    """Area in T_B over that in T_A, of the ball at the coarse resolution."""
    back: float
    """Area of a plate thinner than the threshold by texels over the exact one."""


def _found(rows: Rows) -> _Found:
    of = lambda case: [row for row in rows if row["case"] == case]
    disc = of(BALL)
    grid = two_cylinders(SHOWN).a.grid
    coarse = next(row for row in disc if row["voxels_across"] == COARSE)
    thin = found_areas(ball_on_plate(SHOWN, FIXED, FIXED / 2), FIXED)
    return _Found(
        of(CYLINDERS),
        disc,
        of(BALL_VOXEL),
        len(grid.fragment_area) / grid.solid_count,
        coarse["texels_b"] / coarse["texels_a"],
        thin.texels_b / cap_area(FIXED),
    )


def _reason(found: _Found) -> str:
    lens, disc = found.lens[-1], found.disc[-1]
    off = lambda row, key: f"{row['error_percent'][key]:+.2g}"
    first, last = found.within_voxel[0], found.within_voxel[-1]
    return (
        f"At {lens['voxels_across']} voxels across, the texels in contact are "
        f"{off(lens, 'texels_a')} % off the lens of two cylinders and "
        f"{off(disc, 'texels_a')} % off the disc of a ball on a plate, the library's "
        f"rays {off(lens, 'rays')} and {off(disc, 'rays')} %; only "
        f"{found.compared:.0%} as many texels as voxels are compared. But the "
        "threshold, of which the thesis gives no number, decides the area of a curved "
        f"contact: within one voxel it falls from {first['rays']:.2f} to "
        f"{last['rays']:.2g} square radii as the voxels get finer. The textures of "
        f"both bodies have two areas, {abs(found.two_sided - 1):.0%} apart at {COARSE} "
        "voxels: heat that each moves by its own would not be conserved. And depths "
        "alone do not tell a front from a back: of a plate half as thick as the "
        f"threshold they find {found.back:.2f} times the area. The library keeps one "
        "area for a pair of texels, and asks that surfaces face each other."
    )


def _rows(found: _Found) -> tuple[Row, ...]:
    quantities = {
        "lens of two cylinders": found.lens,
        "disc of a ball on a plate": found.disc,
    }
    finest = found.lens[-1]["voxels_across"]
    errors = tuple(
        Row(
            f"{name} {method}, {row['voxels_across']} voxels, error [%]",
            None,
            row["error_percent"][key],
        )
        for name, rows in quantities.items()
        for row in rows
        if row["voxels_across"] in (COARSE, finest)
        for key, method in METHODS.items()
    )
    return (
        *errors,
        Row("texels compared over voxels", "surface only", found.compared),
        Row("area of a thin plate by texels over the exact one", None, found.back),
        Row(
            f"area in T_B over that in T_A, ball on a plate, {COARSE} voxels",
            None,
            found.two_sided,
            "the library has one area for both",
        ),
    )


_CHOSEN = (
    ("cylinders", f"of one radius, {OFFSET:g} radii apart, end face on end face"),
    ("threshold", "one voxel, or 1/16 of the ball's radius; the thesis has none"),
    ("area of a texel", "the square of a voxel's edge, as in the thesis"),
)


def _measure(quick: bool) -> Finding:
    resolutions = _QUICK if quick else _FULL
    rows, thresholds = by_resolution(resolutions), by_threshold()
    found = _found(rows)
    last = (found.lens[-1], found.disc[-1])
    worst = max(abs(row["error_percent"][key]) for row in last for key in METHODS)
    shown = sorted({COARSE, SHOWN, resolutions[-1]})
    parts = (
        cylinder_textures(),
        plate_textures(shown),
        _error_chart(found.lens + found.disc),
        _threshold_chart(thresholds),
        _table(rows),
    )
    numbers = {
        "by_resolution": rows,
        "by_threshold": thresholds,
        "compared": found.compared,
        "two_sided": found.two_sided,
        "thin_plate_over_exact": found.back,
    }
    # Areas are found, but hang on a threshold.
    verdict = Verdict.DIFFERENT if worst < _WITHIN else Verdict.CONTRADICTED
    return Finding(verdict, _reason(found), _rows(found), {}, _CHOSEN, parts, numbers)


EXHIBIT = Exhibit(
    name="figure-5.4",
    title="two cylinders and a ball on a plate in contact",
    place="5.3, figure 5.4",
    claims=("C18",),
    measure=_measure,
)
