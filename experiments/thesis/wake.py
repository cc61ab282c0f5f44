"""Claims on the wake (6.2, figures 6.4 to 6.7): C22, C23, C24.

The thesis' set-ups: a cylinder in channels of 800 x 300 and 800 x 600 cells, four
speeds in the ratios 1.0, 0.8, 0.4 and 0.2. It names no viscosity, no diameter and no
inlet. Here the cylinder is 2/15 of the narrow channel's height, both channels have
no-slip walls and the parabola of a long one at the inlet, and the fastest flow has Re
100 by the speed in the middle. By similarity a slower flow is one of higher viscosity.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import altair as alt
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from PIL import Image

import jaxthermo as jt
from jaxthermo.console.terminal import open_console
from jaxthermo.flow.measures import centreline, recirculation_length, strouhal
from jaxthermo.flow.run import FlowRun
from jaxthermo.flow.wake_fit import FAMILIES, Family, fit_family, tail_length
from jaxthermo.flow.wake_runs import disturbed_state
from jaxthermo.image.colour.annotate import write_png
from jaxthermo.image.colour.palette import apply_palette
from jaxthermo.native.call import native_kernels
from jaxthermo.report import page
from jaxthermo.report.chart import Chart, legend, write_chart
from jaxthermo.report.sheet import Tile, sheet
from jaxthermo.report.table import Table

from ..harness.present import Rows, colour_bar, publish, table_of
from .convection_numbers import HEIGHT, SHADES, WIDTH
from .wake_pair import measure_pair, pair_table


_LENGTH, _WIDE = 8 / 3, 2
"""Length, and height of the wide channel, over the height of the narrow one."""
_DIAMETER, _UPSTREAM = 2 / 15, 8 / 15

SPEEDS = 1.0, 0.8, 0.4, 0.2
_REYNOLDS = 100.0
# Speed in the middle [cells per step]: Mach number 0.14.
_LATTICE_SPEED = 0.08
_PASSES = 7.0
# Not read next to the outlet [diameters].
_OUTLET = 2.0


class Setup(NamedTuple):
    """One flow of the thesis."""

    channel: str
    """"narrow" or "wide"."""
    speed: float
    """One of the four speeds."""

    @property
    def reynolds(self) -> float:
        """Reynolds number by the undisturbed speed in the middle."""
        return _REYNOLDS * self.speed

    def flow(self, height: int) -> jt.Channel:
        """The channel, of a narrow one's height [cells]."""
        tall = _WIDE * height if self.channel == "wide" else height
        diameter = _DIAMETER * height
        return jt.Channel(
            (tall, round(_LENGTH * height)),
            speed=_LATTICE_SPEED / 1.5,
            viscosity=_LATTICE_SPEED * diameter / self.reynolds,
            body=jt.RoundBody((_UPSTREAM * height, tall / 2), diameter),
            inlet="poiseuille",
            walls="no_slip",
        )


SETUPS = (Setup("narrow", 1.0), *(Setup("wide", speed) for speed in SPEEDS))


class Tail(NamedTuple):
    """Mean speed behind the cylinder over the undisturbed one."""

    setup: Setup
    x: Float[np.ndarray, " n"]
    """From the rear [diameters]."""
    ratio: Float[np.ndarray, " n"]


def run(folder: Path, height: int = 150) -> dict[str, Any]:
    """The five flows with a narrow channel of `height` cells (the thesis': 300)."""
    console, rows, tails, tiles = open_console(), [], [], []
    for setup in SETUPS:
        name = f"{setup.channel}, speed {setup.speed:g}"
        with console.status(name) as status:
            flow = compute_flow(setup, height, lambda at: status.update(at.text))
        tail = tail_of(setup, flow)
        tails.append(tail)
        rows.append(measure_flow(tail, flow))
        tiles += speed_tiles(flow, f"{name}: one moment", f"{name}: mean")
    title = "Figures 6.4 and 6.6: speed at one moment, and mean"
    write_png(folder / "speeds.png", speed_sheet(tiles, title))
    collapse, pairs = measure_collapse(tails[1:]), measure_pair()
    publish(
        folder,
        "The wake: the thesis' claims",
        [*_flows(rows, tails, folder), *_claims(rows, collapse), *_use(pairs)],
    )
    return {
        "height_cells": height,
        "flows": rows,
        "C23": collapse,
        "two_cylinders": pairs,
        "files": sorted(p.name for p in folder.iterdir() if p.suffix != ".json"),
    }


def compute_flow(setup: Setup, height: int, progress: Any) -> FlowRun:
    """The flow of a set-up, with a narrow channel of `height` cells."""
    channel = setup.flow(height)
    steps = round(_PASSES * channel.shape[1] / _LATTICE_SPEED)
    return jt.simulate_flow(
        channel,
        steps,
        start=disturbed_state,
        progress=progress,
        kernels=native_kernels(),
    )


def tail_of(setup: Setup, flow: FlowRun) -> Tail:
    """The middle of the wake, without what lies next to the outlet."""
    line = centreline(flow)
    kept = line.at < line.at[-1] - _OUTLET
    # The undisturbed speed in the middle is 1.5 of the mean.
    return Tail(setup, line.at[kept], line.ratio[kept] / 1.5)


def measure_flow(tail: Tail, flow: FlowRun) -> dict[str, Any]:
    """Numbers of a flow, and the families of curves fitted to its wake."""
    behind = tail.x > recirculation_length(flow)
    fits = {}
    for family in FAMILIES:
        fit = fit_family(family, tail.x[behind], tail.ratio[behind])
        fits[family.name] = {
            "parameters": dict(
                zip(family.parameters, fit.values.tolist(), strict=True)
            ),
            "errors": {
                key: _finite(error)
                for key, error in zip(family.parameters, fit.errors, strict=True)
            },
            "rms": fit.rms,
            "largest": fit.largest,
        }
    frequency, mean = strouhal(flow), flow.mean.x / (1.5 * flow.channel.speed)
    return {
        "channel": tail.setup.channel,
        "speed": tail.setup.speed,
        "Re": tail.setup.reynolds,
        "strouhal": None if np.isnan(frequency) else frequency / 1.5,
        "bubble": recirculation_length(flow),
        "tail_0.9": _finite(tail_length(tail.x, tail.ratio)),
        "tail_0.8": _finite(tail_length(tail.x, tail.ratio, 0.8)),
        "last": float(tail.ratio[-1]),
        "fastest": float(mean.max()),
        "slowest": float(tail.ratio.min()),
        "fits": fits,
        "x": tail.x[::4].tolist(),
        "ratio": tail.ratio[::4].tolist(),
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def measure_collapse(tails: Iterable[Tail]) -> Rows:
    """C23: how far each two of the normalized curves lie apart."""
    tails = list(tails)
    return [
        {
            "speeds": [a.setup.speed, b.setup.speed],
            "rms": float(np.sqrt(np.mean((a.ratio - b.ratio) ** 2))),
            "largest": float(np.abs(a.ratio - b.ratio).max()),
        }
        for n, a in enumerate(tails)
        for b in tails[n + 1 :]
    ]


def speed_tiles(flow: FlowRun, *names: str) -> list[Tile]:
    """Pictures of the speed at one moment, and of its mean, under these names."""
    body = flow.channel.body.mask(flow.channel.shape)
    top = 1.5 * float(flow.channel.speed)
    found = []
    for name, values in zip(names, (flow.last.speed, flow.mean.speed), strict=True):
        colours = apply_palette(np.asarray(values, float) / top, 0.0, 1.3, "white-hot")
        colours[body] = (170, 60, 50)
        # The lattice counts rows upwards.
        found.append(Tile(np.ascontiguousarray(colours[::-1]), name))
    return found


def speed_sheet(tiles: list[Tile], title: str) -> Image.Image:
    """Pictures of speeds in rows of one moment and the mean, on one scale."""
    bar = colour_bar(0.0, 1.3, "speed over that of the undisturbed middle", "white-hot")
    return sheet(tiles, bar, title, 2)


def tail_chart(rows: Rows, tails: list[Tail]) -> Chart:
    """Figure 6.7: normalized mean speeds by the distance."""
    found = []
    for row, tail in zip(rows, tails, strict=True):
        name = f"{row['channel']}, {row['speed']:g} (Re {row['Re']:g})"
        found += _points(name, tail.x[::3], tail.ratio[::3])
    return _chart(found, SHADES, "Figure 6.7: normalized speeds")


def fit_chart(row: dict[str, Any], tail: Tail) -> Chart:
    """Figure 6.5: one curve and the families fitted to it."""
    found = _points("computed", tail.x[::3], tail.ratio[::3])
    behind = tail.x[tail.x > row["bubble"]][::3]
    for family in FAMILIES:
        curve = _fitted_curve(family, row["fits"][family.name]["parameters"], behind)
        found += _points(family.name, behind, curve)
    return _chart(found, ("#111111", *SHADES[1:]), "Figure 6.5: f(x) = v, fitted")


def _points(name: str, x: Any, u: Any) -> Rows:
    return [
        {"curve": name, "x": float(at), "u": float(value)}
        for at, value in zip(x, u, strict=True)
    ]


def _chart(points: Rows, colours: tuple[str, ...], title: str) -> Chart:
    """Speeds behind the cylinder by distance, a line for each curve."""
    names = list(dict.fromkeys(point["curve"] for point in points))
    colour = alt.Scale(domain=names, range=list(colours[: len(names)]))
    # Curves that lie on each other are both seen.
    dashes = [[7, 5] if n % 2 else [1, 0] for n in range(len(names))]
    return (
        alt.Chart(alt.Data(values=points))
        .mark_line()
        .encode(
            x=alt.X("x:Q", title="distance behind the cylinder [diameters]"),
            y=alt.Y("u:Q", title="mean speed over the undisturbed one"),
            color=alt.Color("curve:N", scale=colour, sort=names, legend=legend()),
            strokeDash=alt.StrokeDash(
                "curve:N", scale=alt.Scale(domain=names, range=dashes), sort=names
            ),
        )
        .properties(width=WIDTH, height=HEIGHT, title=title)
    )


def _fitted_curve(
    family: Family, parameters: dict[str, float], x: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    q = jnp.asarray([parameters[name] for name in family.parameters])
    with jax.ensure_compile_time_eval():
        return np.asarray(family.curve(q, jnp.asarray(x, q.dtype)))


def flow_table(rows: Rows) -> Table:
    """Frequency, bubble, speeds and length of the tail of each flow."""
    shown = lambda key: (
        lambda row: "not reached" if row[key] is None else f"{row[key]:.2f}"
    )
    columns = [
        ("channel", "{channel}"),
        ("speed", "{speed:g}"),
        ("Re", "{Re:g}"),
        ("Strouhal", lambda r: f"{r['strouhal']:.3f}" if r["strouhal"] else "steady"),
        ("bubble [D]", "{bubble:.2f}"),
        ("slowest", "{slowest:.3f}"),
        ("fastest", "{fastest:.3f}"),
        ("0.8 from [D]", shown("tail_0.8")),
        ("0.9 from [D]", shown("tail_0.9")),
        ("at the end", "{last:.3f}"),
    ]
    return table_of(rows, columns, "Flows", names=3)


def fit_table(rows: Rows) -> Table:
    """Parameters and deviations of each family on each flow."""
    lines = []
    for row in rows:
        for name, fit in row["fits"].items():
            text = ", ".join(
                _parameter(key, value, fit["errors"][key])
                for key, value in fit["parameters"].items()
            )
            head = {"flow": f"{row['channel']}, {row['speed']:g}", "family": name}
            lines.append({**fit, **head, "parameters": text})
    columns = [
        ("flow", "{flow}"),
        ("family", "{family}"),
        ("parameters, lengths in D", "{parameters}"),
        ("rms", "{rms:.4f}"),
        ("largest", "{largest:.4f}"),
    ]
    return table_of(lines, columns, "Fits behind the bubble", left=(0, 1, 2))


def _parameter(name: str, value: float, error: float | None) -> str:
    """A parameter with its standard error, unless that is as large as itself."""
    if error is None or error > value:
        return f"{name} not determined"
    return f"{name} {value:.3g} ± {error:.1g}"


def _flows(rows: Rows, tails: list[Tail], folder: Path) -> list[page.Section]:
    numbers = ", ".join(f"{row['Re']:g}" for row in rows[1:])
    return [
        page.heading("The thesis' flows"),
        "It gives no viscosity, diameter or inlet: the speeds are those of Re "
        f"{numbers} in the middle of the wide channel, and Re 100 in the narrow one.",
        page.picture(folder / "speeds.png", "speeds at one moment and mean speeds"),
        flow_table(rows),
        write_chart(tail_chart(rows, tails), folder / "normalized"),
        write_chart(fit_chart(rows[1], tails[1]), folder / "fits"),
        fit_table(rows),
    ]


def _claims(rows: Rows, collapse: Rows) -> list[page.Section]:
    pairs = [
        ("speeds", lambda r: f"{r['speeds'][0]:g} and {r['speeds'][1]:g}"),
        ("rms apart", "{rms:.3f}"),
        ("largest", "{largest:.3f}"),
    ]
    worst = {
        family.name: max(row["fits"][family.name]["rms"] for row in rows)
        for family in FAMILIES
    }
    best = max(min(fit["rms"] for fit in row["fits"].values()) for row in rows)
    listed = ", ".join(f"{name} {rms:.3f}" for name, rms in worst.items())
    fastest = max(row["fastest"] for row in rows)
    slowest = min(row["slowest"] for row in rows)
    return [
        page.heading("C22: a wider pipe has a longer tail"),
        "0.9 of the undisturbed speed is reached "
        f"{_length(rows[0])} diameters behind the cylinder in the narrow channel, "
        f"{_length(rows[1])} in the wide one. No strong pressure is needed for it: "
        "between walls what is left of a deficit decays over Re H² / (4 π² D), and "
        "the flow beside the body is faster.",
        page.heading("C23: normalized curves of four speeds coincide"),
        "They do not: they are those of four Reynolds numbers, on which alone a flow "
        "depends.",
        table_of(collapse, pairs, "Distance of normalized curves"),
        page.heading("C24: a convergent function f(x) = v"),
        f"Largest rms of the five flows by family, of the undisturbed speed: {listed}; "
        f"with the best family of each {best:.3f}.",
        page.heading("What the text has wrong"),
        "“The wind speed only decreases behind the object”: beside it the mean rises "
        f"to {fastest:.2f} of the fastest undisturbed speed, and in the bubble behind "
        f"it the flow runs backwards, down to {slowest:.3f}.",
        "“LBM cannot do incompressible flow”: these flows are incompressible to the "
        "square of the Mach number, 2 %; what the method does badly is fast, "
        "compressible flow.",
    ]


def _length(row: dict[str, Any]) -> str:
    return (
        f"beyond {row['x'][-1]:.1f}"
        if row["tail_0.9"] is None
        else f"{row['tail_0.9']:.2f}"
    )


def _use(pairs: Rows) -> list[page.Section]:
    return [
        page.heading("What it means for a second body"),
        "Two equal cylinders in line, Re 100: mean heat transfer of the second with "
        "the fitted wake, over that without.",
        pair_table(pairs),
    ]
