"""Figure 5.3: the intersection of two bodies on 16 x 16 and 256 x 256 rays."""

from collections.abc import Sequence

import numpy as np

from ..exhibit import Exhibit, Finding, Plot, Row, Verdict
from ..intersection import Balls, Bounds, bounds_along, two_balls
from ..intersection_pictures import pictures
from ..line_chart import log_chart, point


# Radii and offset of the second ball [m], along none of the axes.
_RADII, _OFFSET = (0.1, 0.08), (0.075, 0.07, 0.06)
_COARSE, _FINE = 16, 256
_RAYS = (8, _COARSE, 32, 64, 128, _FINE)
# Largest error at the fine resolution [%].
_WITHIN = 1.0


def _errors(balls: Balls, bounds: Sequence[Bounds]) -> dict[str, float]:
    """Relative errors of volume, worst of three axes, and of both areas [%]."""
    area = lambda body: sum(each.area_of(body) for each in bounds)
    off = [each.volume / balls.volume - 1 for each in bounds]
    return {
        "volume": 100 * max(off, key=abs),
        "area of A inside of B": 100 * (area(0) / balls.areas[0] - 1),
        "area of B inside of A": 100 * (area(1) / balls.areas[1] - 1),
    }


def _chart(wrong: dict[int, dict[str, float]]) -> Plot:
    points = [
        point(name, rays, abs(error), f"{name}, {rays} rays: {error:+.2g} %")
        for rays, errors in wrong.items()
        for name, error in errors.items()
    ]
    y = "error against the closed form [%]"
    chart = log_chart(points, "rays along an edge of the box", y, "Two balls")
    return Plot(
        "figure-5.3-error",
        chart,
        "Magnitude of the error; that of the volume is the worst of the three axes. "
        "Its sign changes from one resolution to another.",
    )


def _measure(_: bool) -> Finding:
    balls = two_balls(_RADII, _OFFSET)
    cast = {
        rays: [bounds_along(balls, axis, rays) for axis in range(3)] for rays in _RAYS
    }
    wrong = {rays: _errors(balls, each) for rays, each in cast.items()}
    worst = {rays: max(map(abs, each.values())) for rays, each in wrong.items()}
    order = -np.polyfit(np.log(_RAYS), np.log([*worst.values()]), 1)[0]
    right = worst[_FINE] < min(_WITHIN, worst[_COARSE])
    reason = (
        f"On {_COARSE} x {_COARSE} rays volume and areas of the intersection are up to "
        f"{worst[_COARSE]:.2g} % off the closed form, on {_FINE} x {_FINE} "
        f"{worst[_FINE]:.2g} %: from {_RAYS[0]} rays on the error falls with the pixel "
        f"to the power of {order:.1f}. Rays find the surfaces of contact without any "
        "voxel inside; but bodies that overlap so much are refused as bodies in "
        "contact, since their common volume has the heat capacity of both."
    )
    rows = tuple(
        Row(
            f"{name} on {rays} x {rays} rays, error [%]",
            "shown at both resolutions" if name == "volume" else None,
            error,
            "worst of three axes" if name == "volume" else "",
        )
        for rays in (_COARSE, _FINE)
        for name, error in wrong[rays].items()
    )
    big, small = (100 * radius for radius in _RADII)
    chosen = (
        (
            "bodies",
            f"balls of {big:g} and {small:g} cm, {100 * balls.distance:.3g} cm apart "
            "along none of the axes: their caps have closed forms",
        ),
        ("rays", "parallel to x, y and z through the overlap of both bounding boxes"),
        ("area", "a pixel over the normal's largest component, as of voxels"),
    )
    numbers = {
        "exact_volume_m3": balls.volume,
        "exact_areas_m2": list(balls.areas),
        "error_percent": wrong,
        "order": float(order),
    }
    parts = (
        *pictures(balls, {rays: cast[rays] for rays in (_COARSE, _FINE)}),
        _chart(wrong),
    )
    verdict = Verdict.REPRODUCED if right else Verdict.CONTRADICTED
    return Finding(verdict, reason, rows, {}, chosen, parts, numbers)


EXHIBIT = Exhibit(
    name="figure-5.3",
    title="intersection of two bodies on 16 x 16 and 256 x 256 rays",
    place="5.3, figure 5.3",
    claims=("C18",),
    measure=_measure,
)
