"""Chart of measurements on frames over time."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import altair as alt

from ..image.colour.draw_measurements import limits_in_words
from ..image.colour.ticks import to_celsius
from ..image.measurements import AbstractMeasurement, Isotherm, Reading, Spot
from .chart import POINT_AREA, Chart, legend, write_chart


_WIDTH, _HEIGHT, _LOW_HEIGHT = 640, 300, 160
# Colours that are told apart without any kind of cone: Okabe and Ito (2008).
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
# More frames than this are a line without points.
_MAX_POINTS = 40


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
    """Write `path`.svg and `path`.png; arguments as of `measurement_chart`."""
    write_chart(
        measurement_chart(
            times, measurements=measurements, readings=readings, title=title
        ),
        path,
    )


def measurement_chart(
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
    warm, spread, part, labels = [], [], [], []
    for name, each in measurements.items():
        labels.append(_labelled(name, each, readings[name]))
        rows = [
            _row(labels[-1], time / size, reading)
            for time, reading in zip(times, readings[name], strict=True)
        ]
        (part if isinstance(each, Isotherm) else warm).extend(rows)
        spread += [] if isinstance(each, Isotherm | Spot) else rows
    channels = _channels(f"time [{unit}]", labels)
    mark: dict[str, Any] = {"strokeWidth": 2}
    if len(times) <= _MAX_POINTS:
        mark["point"] = alt.OverlayMarkDef(size=POINT_AREA / 3)
    parts = []
    if warm:
        name, scale = "temperature [\N{DEGREE SIGN}C]", alt.Scale(zero=False)
        mean = alt.Y("mean:Q", title=name, scale=scale)
        lines = alt.Chart(alt.Data(values=warm)).mark_line(**mark)
        lines = lines.encode(y=mean, **channels)
        if spread:
            ends = {"y": alt.Y("min:Q", title=name, scale=scale), "y2": alt.Y2("max:Q")}
            band = alt.Chart(alt.Data(values=spread)).mark_area(opacity=0.18)
            lines = alt.layer(band.encode(**ends, **channels), lines)
        parts.append(lines.properties(width=_WIDTH, height=_HEIGHT))
    if part:
        percent = alt.Y("percent:Q", title="fraction of the bodies [%]")
        lines = alt.Chart(alt.Data(values=part)).mark_line(**mark)
        edges = {"width": _WIDTH, "height": _LOW_HEIGHT if warm else _HEIGHT}
        parts.append(lines.encode(y=percent, **channels).properties(**edges))
    below = "lines: means; bands: from the lowest to the highest" if spread else ""
    head = alt.TitleParams(title or "measurements", subtitle=below, anchor="start")
    return alt.vconcat(*parts, title=head)


def _channels(time: str, labels: list[str]) -> dict[str, Any]:
    """The axis of time and the colours that all parts have in common."""
    colours = [_COLOURS[k % len(_COLOURS)] for k in range(len(labels))]
    scale = alt.Scale(domain=labels, range=colours)
    along = alt.Scale(nice=False, zero=False)
    return {
        "x": alt.X("time:Q", title=time, scale=along),
        "color": alt.Color("name:N", legend=legend("measurement"), scale=scale),
    }


def _labelled(
    name: str, measurement: AbstractMeasurement, readings: Sequence[Reading]
) -> str:
    if isinstance(measurement, Isotherm):
        return f"{name}, {limits_in_words(measurement)}"
    return name if any(each.pixels for each in readings) else f"{name}, background"


def _row(name: str, time: float, reading: Reading) -> dict[str, Any]:
    # Without a body there is no temperature, and the line has a gap.
    seen = bool(reading.pixels)
    kelvin = {"min": reading.min, "mean": reading.mean, "max": reading.max}
    shown = {key: to_celsius(value) if seen else None for key, value in kelvin.items()}
    return {"name": name, "time": time, "percent": 100 * reading.fraction, **shown}
