"""Charts as files, SVG and PNG: no browser, and no script in the page."""

import html
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import altair as alt
import vl_convert

from ..atomic import replacing
from ..image.ticks import nice_ticks


Chart = alt.Chart | alt.LayerChart | alt.FacetChart

DOT = 90.0
"""Area of a point [px^2]."""

MARGIN = 0.08
"""Of an axis, beyond what is shown."""

FEW = 3
"""Ticks at least, or an axis tells nothing."""

PADDING = {"left": 14, "top": 14, "bottom": 14, "right": 60}
"""Room on the right for a viewer whose letters are wider than ours."""


def legend(title: str | None = None) -> alt.Legend:
    """With room for the longest label."""
    return alt.Legend(title=title, labelLimit=260, symbolSize=DOT, symbolOpacity=1)


class LogAxis:
    """Holds all values, with ticks at 1, 2 and 5, powers of ten, or in even steps."""

    def __init__(self, values: Sequence[float | int], title: str):
        """Values above 0."""
        low, high = math.log10(min(values)), math.log10(max(values))
        margin = MARGIN * max(high - low, 0.5)
        self.low, self.high = low - margin, high + margin
        self.title = title

    @property
    def ticks(self) -> list[float]:
        """Round numbers on the axis."""
        factors = (1, 2, 5) if self.high - self.low < 3.2 else (1,)
        exponents = range(math.floor(self.low) - 1, math.ceil(self.high) + 1)
        every = (float(f"{f}e{n}") for n in exponents for f in factors)
        found = [v for v in every if self.low <= math.log10(v) <= self.high]
        if len(found) >= FEW:
            return found
        return [v for v in nice_ticks(10**self.low, 10**self.high, 6) if v > 0]

    def of(self, field: str) -> dict[str, Any]:
        """Arguments of `alt.X` or `alt.Y` for a field of the data."""
        ends = [10**self.low, 10**self.high]
        return {
            "shorthand": field,
            "type": "quantitative",
            "title": self.title,
            "scale": alt.Scale(type="log", domain=ends, nice=False),
            "axis": alt.Axis(values=self.ticks, format=".4~r"),
        }


def chart_svg(chart: Chart) -> str:
    """SVG for a page, with tooltips."""
    return with_tooltips(vl_convert.vegalite_to_svg(_styled(chart).to_json()))


def write_chart(chart: Chart, path: Path) -> str:
    """Writes `path`.svg and `path`.png; returns the SVG, with tooltips."""
    svg = chart_svg(chart)
    png = vl_convert.vegalite_to_png(_styled(chart).to_json(), scale=2)
    with replacing(path.with_suffix(".svg")) as temporary:
        temporary.write_text(svg, encoding="utf-8")
    with replacing(path.with_suffix(".png")) as temporary:
        temporary.write_bytes(png)
    return svg


def _styled(chart: Chart) -> Chart:
    return (
        chart.configure(font="sans-serif", background="white", padding=PADDING)
        .configure_title(fontSize=15, offset=12)
        .configure_axis(
            labelFontSize=12,
            titleFontSize=13,
            titleFontWeight="normal",
            gridColor="#e6e8ec",
        )
        .configure_legend(labelFontSize=12)
        .configure_view(stroke="#c8ccd4")
    )


_MARK = re.compile(r'<path ([^>]*?aria-label="([^"]*)"[^>]*?)(?:/>|></path>)')


def with_tooltips(svg: str) -> str:
    """The descriptions of the marks as titles, which browsers show on hovering."""

    def titled(found: re.Match[str]) -> str:
        text = html.escape(html.unescape(found[2]))
        return f"<path {found[1]}><title>{text}</title></path>"

    return _MARK.sub(titled, svg)
