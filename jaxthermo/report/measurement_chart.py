"""Chart of measurements on frames over time."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypedDict

import altair as alt

from ..image.colour.draw_measurements import limits_in_words
from ..image.colour.ticks import to_celsius
from ..image.measurements import AbstractMeasurement, Isotherm, Reading, Spot
from .chart import COLOURS, POINT_AREA, Chart, legend, write_chart


_WIDTH = 640
_HEIGHT = 300
_LOW_HEIGHT = 160
# More frames than this are a line without points.
_MAX_POINTS = 40


class _Row(TypedDict):
    """A reading as the chart has it."""

    name: str
    time: float
    percent: float
    """Fraction of the bodies [%]."""
    min: float | None
    mean: float | None
    max: float | None
    """Temperatures [deg C]; None where there is no body."""


def _time_unit(times: Sequence[float]) -> tuple[float, str]:
    # Seconds and the name of the unit in which the axis has the fewest digits.
    last = max(times)
    for size, name in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if last >= 3 * size:
            return size, name
    return 1.0, "s"


def write_measurement_chart(
    path: Path,
    times: Sequence[float],
    measurements: Mapping[str, AbstractMeasurement],
    readings: Mapping[str, Sequence[Reading]],
    title: str = "",
) -> None:
    """Write `path`.svg and `path`.png; arguments as of `_measurement_chart`."""
    write_chart(
        _measurement_chart(
            times, measurements=measurements, readings=readings, title=title
        ),
        path,
    )


def _measurement_chart(
    times: Sequence[float],
    measurements: Mapping[str, AbstractMeasurement],
    readings: Mapping[str, Sequence[Reading]],
    title: str = "",
) -> Chart:
    """Chart temperatures, and below them the fractions of isotherms, over time.

    Args:
        times: of the frames [s].
        measurements: by name, at least one.
        readings: of each, one for every time.
        title: above the chart.
    """
    size, unit = _time_unit(times)
    means: list[_Row] = []
    spread: list[_Row] = []
    fractions: list[_Row] = []
    labels: list[str] = []
    for name, measurement in measurements.items():
        labels.append(_labelled(name, measurement, readings[name]))
        rows = [
            _row(labels[-1], time / size, reading)
            for time, reading in zip(times, readings[name], strict=True)
        ]
        if isinstance(measurement, Isotherm):
            fractions += rows
            continue
        means += rows
        if not isinstance(measurement, Spot):
            spread += rows
    channels = _channels(f"time [{unit}]", labels)
    point = len(times) <= _MAX_POINTS and alt.OverlayMarkDef(size=POINT_AREA / 3)

    def lines(rows: list[_Row], y: alt.Y) -> alt.Chart:
        chart = alt.Chart(alt.Data(values=rows))
        chart = chart.mark_line(strokeWidth=2, point=point)
        return chart.encode(y=y, x=channels.time, color=channels.colour)

    panels = []
    if means:
        name = "temperature [\N{DEGREE SIGN}C]"
        scale = alt.Scale(zero=False)
        panel = lines(means, alt.Y("mean:Q", title=name, scale=scale))
        if spread:
            band = alt.Chart(alt.Data(values=spread)).mark_area(opacity=0.18)
            band = band.encode(
                x=channels.time,
                color=channels.colour,
                y=alt.Y("min:Q", title=name, scale=scale),
                y2=alt.Y2("max:Q"),
            )
            panel = alt.layer(band, panel)
        panels.append(panel.properties(width=_WIDTH, height=_HEIGHT))
    if fractions:
        percent = alt.Y("percent:Q", title="fraction of the bodies [%]")
        height = _LOW_HEIGHT if means else _HEIGHT
        panels.append(lines(fractions, percent).properties(width=_WIDTH, height=height))
    below = "lines: means; bands: from the lowest to the highest" if spread else ""
    head = alt.TitleParams(title or "measurements", subtitle=below, anchor="start")
    return alt.VConcatChart(vconcat=panels, title=head)


class _Channels(NamedTuple):
    """The axis of time and the colours that all panels have in common."""

    time: alt.X
    colour: alt.Color


def _channels(time: str, labels: list[str]) -> _Channels:
    colours = [COLOURS[k % len(COLOURS)] for k in range(len(labels))]
    scale = alt.Scale(domain=labels, range=colours)
    along = alt.Scale(nice=False, zero=False)
    return _Channels(
        time=alt.X("time:Q", title=time, scale=along),
        colour=alt.Color("name:N", legend=legend("measurement"), scale=scale),
    )


def _labelled(
    name: str, measurement: AbstractMeasurement, readings: Sequence[Reading]
) -> str:
    if isinstance(measurement, Isotherm):
        return f"{name}, {limits_in_words(measurement)}"
    return (
        name if any(reading.pixels for reading in readings) else f"{name}, background"
    )


def _row(name: str, time: float, reading: Reading) -> _Row:
    # Without a body there is no temperature, and the line has a gap.
    seen = reading.pixels > 0
    return _Row(
        name=name,
        time=time,
        percent=100 * reading.fraction,
        min=to_celsius(reading.min) if seen else None,
        mean=to_celsius(reading.mean) if seen else None,
        max=to_celsius(reading.max) if seen else None,
    )
