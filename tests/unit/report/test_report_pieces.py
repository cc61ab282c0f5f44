"""Pieces of reports: axes, scales of differences, tooltips, text in a page."""

import io

import numpy as np
import pytest
from rich.console import Console

from jaxthermo.report import page
from jaxthermo.report.chart import LogAxis, _with_tooltips
from jaxthermo.report.difference_scale import (
    DifferenceScale,
    difference_bar,
    nice_limit,
)
from jaxthermo.report.numbers import (
    count,
    padded,
    seconds,
    seconds_with_range,
    with_range,
)
from jaxthermo.report.table import Cell, Table


def test_the_scale_is_symmetric_monotone_and_ends_at_its_limit():
    scale = DifferenceScale(20.0)
    kelvin = np.linspace(-30, 30, 601)
    position = scale.position(kelvin)
    np.testing.assert_allclose(position, -position[::-1], atol=1e-12)
    inside = np.abs(kelvin) < 20
    assert (np.diff(position[inside]) > 0).all()
    assert position[0] == -1 and position[-1] == 1 and position[300] == 0
    assert scale.ticks() == pytest.approx([-20, -2, -0.2, 0, 0.2, 2, 20])
    # A hundredth of the limit is still told from none.
    assert scale.position(np.array([0.2]))[0] > 0.1


def test_no_difference_is_light_and_the_background_dark():
    scale = DifferenceScale(1.0)
    kelvin = np.array([[0.0, -1.0, 1.0, 0.0]])
    body = np.array([[True, True, True, False]])
    none, cold, hot, outside = scale.picture(kelvin, body)[0].astype(int)
    assert none.min() > 230 and outside.max() < 80
    assert cold[2] > cold[0] and hot[0] > hot[2]


@pytest.mark.parametrize(
    ("largest", "limit"), [(0.7, 1), (1.0, 1), (1.1, 2), (23.0, 50), (60.0, 100)]
)
def test_nice_limits(largest, limit):
    assert nice_limit(largest) == pytest.approx(limit)


def test_a_scale_of_one_decade_has_no_ticks_that_meet_zero():
    scale = DifferenceScale(2.0, decades=1.0)
    assert scale.ticks() == pytest.approx([-2, -0.2, 0, 0.2, 2])
    bar = difference_bar(scale, "K")
    assert [text for _, text in bar.ticks] == ["-2", "-0.2", "0", "+0.2", "+2"]
    places = [position for position, _ in bar.ticks]
    np.testing.assert_allclose(places, 1 - np.array(places[::-1]), atol=1e-12)
    assert places[0] == 0 and places[-1] == 1


def test_an_axis_holds_its_values():
    axis = LogAxis([0.02, 3.0], "s")
    assert axis.ticks == pytest.approx([0.02, 0.05, 0.1, 0.2, 0.5, 1, 2])
    low, high = axis.channel("x")["scale"].domain
    assert low < 0.02 and high > 3.0


@pytest.mark.parametrize("ends", [(0.71, 1.37), (1.437, 2.505), (3.0, 3.0)])
def test_a_short_axis_has_ticks_all_the_same(ends):
    axis = LogAxis(ends, "")
    ticks = np.array(axis.ticks)
    assert len(ticks) >= 3
    assert (axis.low <= np.log10(ticks)).all() and (np.log10(ticks) <= axis.high).all()


def test_descriptions_become_tooltips():
    svg = '<g><path aria-label="a &lt; 1 %, &quot;b&quot;" d="M0,0"/><path d="M1"/></g>'
    with_titles = _with_tooltips(svg)
    assert "<title>a &lt; 1 %, &quot;b&quot;</title></path>" in with_titles
    assert with_titles.count("<title>") == 1


def test_what_users_write_is_text_in_the_page():
    table = Table(["<script>"], [["<script>", "x"], ["y", Cell("<script>", True)]])
    text = page._document("<script>", ["<script>", table, page.pre("<script>")])
    assert "<script>" not in text and text.count("&lt;script&gt;") == 7
    assert Table(["a"], [[Cell("yes", True)]]).html().count("<td") == 1


def test_a_table_says_the_same_on_a_terminal_and_on_a_page():
    rows = [["[red]a", "1.5"], ["b", Cell("missed [by 2]", False)]]
    table = Table(["name [-]", "value"], rows, title="T")
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(table.rich())
    text = console.export_text()
    html = table.html()
    for words in ("name [-]", "[red]a", "1.5", "missed [by 2]"):
        assert words in text and words in html
    assert '<td class="left missed">missed [by 2]</td>' in html


def test_a_coloured_number_stays_below_the_others():
    rows = [["a", "1.50"], ["b", Cell("2.80", True, is_number=True)]]
    html = Table(["name", "value"], rows).html()
    assert "<td>1.50</td>" in html and '<td class="met">2.80</td>' in html
    assert "<td>3</td>" in Table(["n"], [[Cell("3", is_number=True)]]).html()


def test_numbers_have_three_digits_and_a_unit():
    assert seconds(0.0134) == "13.4 ms" and seconds(1084.6) == "1,085 s"
    assert seconds_with_range(0.013, 0.012, 0.015) == "13 (12-15) ms"
    assert with_range(8.1, 7.5, 9.0) == "8.1 (7.5-9)"
    # Their median would say nothing.
    assert with_range(3.3, 1.2, 312.0) == "1.2 to 312"
    assert with_range(0.0, 0.0, 5.0) == "0 (0-5)"
    texts = [padded(v) for v in (2.8, 0.5, 12.0, 123.4)]
    assert texts == ["2.80", "0.500", "12.0", "123"]
    assert padded(0.0) == "0.00" and padded(999.6) == "1,000"
    assert count(1, "node") == "1 node" and count(12000, "node") == "12,000 nodes"


def test_text_between_backticks_is_code_and_all_text_is_escaped():
    paragraph = page.paragraph("run `calibrate plan <scene>` & look")
    assert (
        paragraph == "<p>run <code>calibrate plan &lt;scene&gt;</code> &amp; look</p>"
    )
    table = Table(["what"], [["`a` < b"], ["one `"]], "", "")
    assert "<code>a</code> &lt; b" in table.html() and "one `" in table.html()
