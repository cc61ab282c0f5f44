"""Charts as SVG and PNG, drawn without a browser; a page needs no script."""

import html
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import altair as alt
import vl_convert

from ..atomic import replacing, write_text
from ..image.colour.ticks import nice_ticks
from .templates import Html


Chart = alt.Chart | alt.LayerChart | alt.FacetChart | alt.VConcatChart

# Colours that differ for colour-blind readers too: Okabe and Ito (2008).
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
# Area of a point [px^2].
POINT_AREA = 90.0

# Length of an axis beyond its values, over the length between them: no point of data
# lies on the frame.
_AXIS_MARGIN = 0.08
_MIN_TICKS = 3
# Length of an axis up to which labels at 2 and 5 do not touch [decades].
_MAX_DECADES_WITH_STEPS = 3.2
# The renderer measures labels by its own font; a browser whose letters are wider
# would cut the last label off without the room on the right.
_PADDING = {"left": 14, "top": 14, "bottom": 14, "right": 60}


def legend(title: str | None = None) -> alt.Legend:
    """A legend with room for long labels."""
    return alt.Legend(
        title=title, labelLimit=260, symbolSize=POINT_AREA, symbolOpacity=1
    )


class LogAxis:
    """Logarithmic axis with ticks at 1, 2 and 5, powers of ten, or in even steps."""

    def __init__(self, values: Sequence[float | int], title: str):
        """Span the axis over `values`, all above 0."""
        low = math.log10(min(values))
        high = math.log10(max(values))
        margin = _AXIS_MARGIN * max(high - low, 0.5)
        self.low = low - margin
        self.high = high + margin
        self.title = title

    @property
    def ticks(self) -> list[float]:
        """Round numbers along the axis."""
        decades = self.high - self.low
        factors = (1, 2, 5) if decades < _MAX_DECADES_WITH_STEPS else (1,)
        exponents = range(math.floor(self.low) - 1, math.ceil(self.high) + 1)
        candidates = (float(f"{f}e{n}") for n in exponents for f in factors)
        ticks = [v for v in candidates if self.low <= math.log10(v) <= self.high]
        if len(ticks) >= _MIN_TICKS:
            return ticks
        # Within less than a factor of 5 there are too few powers and halves of ten.
        return [v for v in nice_ticks(10**self.low, 10**self.high, 6) if v > 0]

    def distance(self, a: float, b: float) -> float:
        """Distance between two values over the length of the axis [-]."""
        return abs(math.log10(a / b)) / (self.high - self.low)

    def channel(self, field: str) -> dict[str, Any]:
        """The arguments of `alt.X` or `alt.Y` that put a field on this axis."""
        ends = [10**self.low, 10**self.high]
        return {
            "shorthand": field,
            "type": "quantitative",
            "title": self.title,
            "scale": alt.Scale(type="log", domain=ends, nice=False),
            "axis": alt.Axis(values=self.ticks, format=".4~r"),
        }


def chart_svg(chart: Chart) -> Html:
    """The chart as SVG for a page, with tooltips."""
    return _with_tooltips(vl_convert.vegalite_to_svg(_styled(chart).to_json()))


def write_chart(chart: Chart, path: Path) -> Html:
    """Write `path`.svg and `path`.png; return the SVG, with tooltips."""
    svg = chart_svg(chart)
    png = vl_convert.vegalite_to_png(_styled(chart).to_json(), scale=2)
    write_text(path.with_suffix(".svg"), svg)
    with replacing(path.with_suffix(".png")) as temporary:
        temporary.write_bytes(png)
    return svg


def _styled(chart: Chart) -> Chart:
    # White also on a dark page: black labels would be invisible there.
    return (
        chart.configure(font="sans-serif", background="white", padding=_PADDING)
        .configure_title(fontSize=15, offset=12)
        .configure_axis(
            labelFontSize=12,
            titleFontSize=13,
            titleFontWeight="normal",
            # Without it, wider digits of another font would touch the title.
            titlePadding=12,
            gridColor="#e6e8ec",
        )
        .configure_legend(labelFontSize=12)
        .configure_view(stroke="#c8ccd4")
    )


_MARK = re.compile(r'<path ([^>]*?aria-label="([^"]*)"[^>]*?)(?:/>|></path>)')


def _with_tooltips(svg: str) -> Html:
    # Browsers show the title of a mark on hovering, and not its description.
    def titled(match: re.Match[str]) -> str:
        text = html.escape(html.unescape(match[2]))
        return f"<path {match[1]}><title>{text}</title></path>"

    return Html(_MARK.sub(titled, svg))
