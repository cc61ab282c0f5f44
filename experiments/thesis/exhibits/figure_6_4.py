"""Figure 6.4: flow behind a cylinder in a narrow and a wide pipe."""

from jaxthermo.report.sheet import enlarged

from ..exhibit import Exhibit, Finding, Picture, Row, Verdict
from ..wake import flow_table, speed_sheet, speed_tiles
from ..wake_flows import WakeFlow, chosen, narrow_and_wide


# Height of a picture of the narrow channel, about [px].
_EDGE = 600
_LEVELS = ("tail_0.8", "tail_0.9")


def _measure(quick: bool) -> Finding:
    narrow, wide = narrow_and_wide(quick)
    lengths = {level: (narrow.row[level], wide.row[level]) for level in _LEVELS}
    longer = {level: _is_longer(*both) for level, both in lengths.items()}
    if all(longer.values()):
        verdict = Verdict.REPRODUCED
    else:
        verdict = Verdict.DIFFERENT if longer["tail_0.9"] else Verdict.CONTRADICTED
    reason = (
        "Nine tenths of the undisturbed speed are reached "
        f"{_length(narrow, 'tail_0.9')} diameters behind the cylinder in the narrow "
        f"pipe and {_length(wide, 'tail_0.9')} in the wide one; eight tenths "
        f"{_length(narrow, 'tail_0.8')} and {_length(wide, 'tail_0.8')} behind it. The "
        "end of the tail depends on the pipe, as the thesis says: between walls the "
        "rest of a deficit decays over Re H² / (4 π² D). Its beginning depends on how "
        "vortices form, and pressure is not what shortens it."
    )
    fastest = max(flow.row["fastest"] for flow in (narrow, wide))
    slowest = min(flow.row["slowest"] for flow in (narrow, wide))
    rows = (
        Row("0.9 of the speed, narrow [D]", "shorter", _length(narrow, "tail_0.9")),
        Row("0.9 of the speed, wide [D]", "longer", _length(wide, "tail_0.9")),
        Row(
            "fastest mean speed beside the body",
            "decreases only",
            fastest,
            "over the undisturbed middle",
        ),
        Row("slowest mean speed along x", "not given", slowest, "backwards, if < 0"),
    )
    parts = (
        Picture("pipes", _picture(narrow, wide), "Left: at the end; right: the mean."),
        flow_table([narrow.row, wide.row]),
        "“The wind speed only decreases behind the object” holds for the middle; "
        "beside the body the mean is faster than undisturbed, and in the bubble behind "
        "it the flow runs backwards. “LBM cannot do incompressible flow” (chapter 1) "
        "is not so: these flows are incompressible to the square of the Mach number.",
    )
    names = ("x", "ratio", "fits")
    numbers = {
        flow.setup.channel: {k: v for k, v in flow.row.items() if k not in names}
        for flow in (narrow, wide)
    }
    return Finding(verdict, reason, rows, {}, chosen(quick), parts, numbers)


def _is_longer(narrow: float | None, wide: float | None) -> bool:
    # A tail that does not end within the channel is longer than one that does.
    return narrow is not None and (wide is None or wide > narrow)


def _length(flow: WakeFlow, level: str) -> str:
    found = flow.row[level]
    last = float(flow.tail.x[-1])
    return f"more than {last:.1f}" if found is None else f"{found:.2f}"


def _picture(narrow: WakeFlow, wide: WakeFlow):
    tiles = [
        *speed_tiles(narrow.run, "(a) 800 x 300, one moment", "(b) 800 x 300, mean"),
        *speed_tiles(wide.run, "(c) 800 x 600, one moment", "(d) 800 x 600, mean"),
    ]
    large = [tile.__class__(enlarged(tile.pixels, _EDGE), tile.label) for tile in tiles]
    return speed_sheet(large, "Figure 6.4: pipes of two widths")


EXHIBIT = Exhibit(
    name="figure-6.4",
    title="flow behind a cylinder in pipes of two widths",
    place="6.2, figure 6.4",
    claims=("C22",),
    measure=_measure,
)
