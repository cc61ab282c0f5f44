"""Figure 5.8: bodies that cool in wind, by the direction of their normals."""

from ..bodies import buddha
from ..convection_cooling import (
    ACROSS,
    AIR,
    CERAMIC,
    HOT,
    SPEED,
    InWind,
    choice_table,
    compare_choices,
    cooled_order,
    cooling_chart,
    cooling_sheet,
    cylinder_in_wind,
    wind,
)
from ..exhibit import Exhibit, Finding, Picture, Plot, Row, Verdict


# Voxels across the cylinder and along the height of the statue.
_HEIGHT = 160
_QUICK_ACROSS, _QUICK_HEIGHT = 24, 60
# Correlation of ranks from which temperatures are in the order of the local number.
_ORDERED = -0.9


def _measure(quick: bool) -> Finding:
    across = _QUICK_ACROSS if quick else ACROSS
    height = _QUICK_HEIGHT if quick else _HEIGHT
    statue = InWind(buddha().name, buddha().grid(height))
    cases = (cylinder_in_wind(across), statue)
    runs = {case.name: case.run(wind()) for case in cases}
    found = {case.name: cooled_order(case, runs[case.name]) for case in cases}
    drum = cases[0].name
    choices = compare_choices(cases[0], {wind().average: runs[drum]})
    by_wind, by_fixed = (row["side_range_K"] for row in choices)
    order = {name: each["order"] for name, each in found.items()}
    weakest = {
        name: max(row["rank_correlation"] for row in rows)
        for name, rows in order.items()
    }
    peak = {name: max(order[name], key=lambda r: r["range_K"]) for name in order}
    first = order[drum][0]
    follows = weakest[drum] <= _ORDERED and by_fixed < 0.1 * by_wind
    reason = (
        f"The side of the cylinder is coldest {first['coldest_deg']:g}° and warmest "
        f"{first['warmest_deg']:g}° from where the wind meets it; the local Nusselt "
        f"number is largest at {found[drum]['largest_number_deg']:g}° and smallest at "
        f"{found[drum]['smallest_number_deg']:g}°. Ranks of temperature and number "
        f"correlate by {weakest[drum]:.2f} or closer to -1 at every time. A fixed h of "
        f"the same heat leaves {by_fixed:.2f} K between the sectors, the wind "
        f"{by_wind:.1f} K. On {statue.name}, whose thin parts cool sooner whichever "
        f"way they face, it is {weakest[statue.name]:.2f}. Differences on the cylinder "
        f"grow to {peak[drum]['range_K']:.1f} K after {peak[drum]['time_s']:g} s and "
        "fade as the body comes to the air's temperature."
    )
    if follows:
        verdict = Verdict.REPRODUCED
    else:
        verdict = Verdict.CONTRADICTED if weakest[drum] > 0 else Verdict.DIFFERENT
    rows = tuple(
        Row(
            f"{name}, {row['time_s']:g} s: warmest less coldest sector of the side [K]",
            "varies with the normal",
            row["range_K"],
            f"mean {row['mean_K']:.1f} K; coldest at {row['coldest_deg']:g}°, warmest "
            f"at {row['warmest_deg']:g}°; ranks correlate by "
            f"{row['rank_correlation']:.3f}",
        )
        for name in order
        for row in order[name]
    )
    chosen = (
        *buddha().stands_in,
        ("bodies", "neither caption nor text names one: a cylinder and the statue"),
        (
            "wind",
            f"{SPEED:g} m/s, air of {AIR:g} K, bodies of {HOT:g} K; the thesis has no "
            "numbers",
        ),
        (
            "material",
            f"ceramic of {CERAMIC.conductivity:g} W/(m K): in metal the sides even out",
        ),
        ("size", f"{across} voxels across the cylinder, the statue {height} high"),
    )
    caption = (
        "The wind goes from left to right, as in the text, and so does time; below "
        "each picture the mean that is taken off. Seen from half in front of the wind."
    )
    angles = (
        "Mean of sectors of 10° by the angle of the normal from where the wind comes."
    )
    parts = []
    for word, case in zip(("cylinder", "statue"), cases, strict=True):
        name = f"figure-5.8-{word}"
        sheet = cooling_sheet(case, runs[case.name])
        chart = cooling_chart(found[case.name], f"{case.name} by angle")
        parts += [Picture(name, sheet, caption), Plot(f"{name}-angle", chart, angles)]
    parts.append(choice_table({"choices": choices, **found[drum]}))
    numbers = {**found, "choices": choices}
    return Finding(verdict, reason, rows, {}, chosen, tuple(parts), numbers)


EXHIBIT = Exhibit(
    name="figure-5.8",
    title="bodies that cool in wind by their normals",
    place="5.4, figure 5.8",
    claims=("C21",),
    measure=_measure,
)
