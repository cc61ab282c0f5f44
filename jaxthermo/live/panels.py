"""HTML of the live view: the temperature bar, and the lines about the run."""

import html
from typing import NamedTuple

from ..choices import Palette
from ..image.colour.palette import palette_table
from ..image.colour.ticks import scale_ticks, time_label, to_celsius
from ..progress import duration


# Colours of a bar: a browser interpolates between them.
_STOPS = 33


def temperature_bar(low: float, high: float, palette: Palette, title: str) -> str:
    """A horizontal bar of a palette between two temperatures [K], with its scale."""
    table = palette_table(palette)
    rows = [table[round(k * 255 / (_STOPS - 1))] for k in range(_STOPS)]
    stops = ",".join(f"rgb({r},{g},{b})" for r, g, b in rows)
    ticks = scale_ticks(to_celsius(low), to_celsius(high), 7)
    marks = "".join(
        f'<div style="position:absolute;left:{100 * position:.2f}%;'
        'transform:translateX(-50%);text-align:center;line-height:1.1">'
        '<div style="width:1px;height:5px;margin:0 auto;background:currentColor">'
        f"</div>{text}</div>"
        for position, text in ticks
    )
    return (
        '<div style="padding:0.4em 1.2em 0.2em;font-size:0.8em">'
        f'<div style="margin-bottom:0.3em">{html.escape(title)} [°C]</div>'
        f'<div style="height:1.1em;background:linear-gradient(to right,{stops});'
        'border:1px solid rgba(128,128,128,0.6)"></div>'
        f'<div style="position:relative;height:1.9em">{marks}</div></div>'
    )


class RunStatus(NamedTuple):
    """Time, state and speeds of the run."""

    time: float
    """[s]"""
    end: float
    """[s]"""
    state: str
    """Such as running or paused."""
    simulated: float | None
    """Simulated seconds per second; None while it does not run."""
    frames: float | None
    """Frames per second; None while it does not run."""
    note: str = ""
    """Further line: a mistake, or what takes long."""


def status_lines(status: RunStatus) -> str:
    """Lines about the run: its time, what it does, and how fast."""
    end = duration(status.end)
    speed = "–" if status.simulated is None else f"{status.simulated:.3g}"
    frames = "–" if status.frames is None else f"{status.frames:.3g}"
    note = (
        f'<div style="color:#f59f00;margin-top:0.3em">{html.escape(status.note)}</div>'
        if status.note
        else ""
    )
    return (
        '<div style="padding:0.2em 1.2em;font-size:0.85em;line-height:1.5">'
        f"<b>{time_label(status.time)}</b> of {end}, {status.state}<br>"
        f"{speed} simulated s/s, {frames} frames/s{note}</div>"
    )
