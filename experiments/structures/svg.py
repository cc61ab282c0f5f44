"""Charts as files, SVG and PNG: no browser, and no script in the page."""

import html
import re
from pathlib import Path

import vl_convert

from jaxthermo.atomic import replacing

from .plots import Chart


PADDING = {"left": 14, "top": 14, "bottom": 14, "right": 60}
"""Room on the right for a viewer whose letters are wider than ours."""


def write_chart(chart: Chart, path: Path) -> str:
    """Writes `path`.svg and `path`.png; returns the SVG, with tooltips."""
    spec = _styled(chart).to_json()
    svg = with_tooltips(vl_convert.vegalite_to_svg(spec))
    png = vl_convert.vegalite_to_png(spec, scale=2)
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
