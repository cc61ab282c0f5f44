"""5.4: the cylinder's number in place of a flow, compared with that flow.

The thesis gives every surface the heat transfer of a cylinder at the angle of its
normal to the wind. Here the same rods, round and square, stand in a computed flow.
Nusselt numbers are of the round rod's diameter or the square one's width, in air.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import altair as alt
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from PIL import Image

from jaxthermo.flow.body import body_links
from jaxthermo.flow.lattice import VELOCITIES
from jaxthermo.flow.measures import mean_nusselt, nusselt_shape
from jaxthermo.flow.run import FlowRun, simulate_flow
from jaxthermo.flow.wake_runs import PRANDTL, wake_channel, wake_run, wake_setup
from jaxthermo.physics.convection.nusselt import churchill_bernstein
from jaxthermo.report.chart import Chart
from jaxthermo.report.sheet import enlarged

from ...harness.line_chart import DOT, LINE, SHADES, angle_axis, curve, curve_chart
from ...harness.present import Shot, thermal_sheet
from ..exhibit import Finding, Numbers, Verdict, exhibit, judged, rms
from ..nusselt import local_number, mean_number


DEGREES = np.arange(0.0, 180.5, 3.0)
"""Angles from the front."""
FACES = {"front": 0.0, "each side": 90.0, "rear": 180.0}
"""Faces of a square rod, and the angle of their normals from the wind [degrees]."""
# Diameter of the round rod as large as a square one, over its width: the thesis leaves
# the length of what is no cylinder open, and the package takes this one.
_AS_LARGE = 2 / np.sqrt(np.pi)
# Cosines of the flow's number: at these sizes of the lattice more are noise.
_COSINES = 4
# Error up to which the number stands for the flow [-].
_MAX_ERROR = 0.1
# Of a picture: half its width [diameters], and its edge [px].
_AROUND = 3
_EDGE = 480


class RoundRod(NamedTuple):
    """Numbers around a round rod by the flow and by the local number."""

    reynolds: float
    run: FlowRun
    flow: Float[np.ndarray, " a"]
    """Numbers of the flow at `DEGREES`, of four cosines."""
    closure: Float[np.ndarray, " a"]
    """Local numbers at `DEGREES`."""
    flow_mean: float
    closure_mean: float
    correlation_mean: float
    """Average of Churchill and Bernstein."""

    @property
    def rms(self) -> float:
        """RMS difference around the rod over the mean of the flow [-]."""
        return rms(self.closure - self.flow) / self.flow_mean


class SquareRod(NamedTuple):
    """Numbers of the faces of a square rod, which faces the wind."""

    reynolds: float
    run: FlowRun
    flow: dict[str, float]
    closure: dict[str, float]

    @property
    def means(self) -> tuple[float, float]:
        """Means over the four faces by flow and closure."""
        flow, closure = (
            (numbers["front"] + 2 * numbers["each side"] + numbers["rear"]) / 4
            for numbers in (self.flow, self.closure)
        )
        return flow, closure

    @property
    def mean_error(self) -> float:
        """Relative error of the mean over the four faces [-]."""
        flow, closure = self.means
        return closure / flow - 1

    @property
    def errors(self) -> dict[str, float]:
        """Relative error on each face [-]."""
        return {face: self.closure[face] / self.flow[face] - 1 for face in FACES}


@exhibit("section-5.4-closure", "5.4")
def _number_and_flow(quick: bool) -> Finding:
    """Compare the number with steady flows around a round and a square rod."""
    lattices = (8,) if quick else (10, 16)
    passes = 2.0 if quick else 3.0
    rounds: list[RoundRod] = []
    squares: list[SquareRod] = []
    rows = []
    for reynolds in (20.0,) if quick else (20.0, 40.0):
        for cells in lattices:
            rod = _round_rod(reynolds, cells, passes)
            box = _square_rod(reynolds, cells, passes)
            lattice = {"Re": reynolds, "cells": cells}
            rows += [
                {**lattice, "what": name, "flow": flow, "closure": closure}
                for name, flow, closure in (*_round_rows(rod), *_square_rows(box))
            ]
        # Of the finest lattice.
        rounds.append(rod)
        squares.append(box)
    verdict, numbers = judge(rounds, squares)
    return Finding(
        verdict,
        {**numbers, "cells": lattices[-1], "rows": rows},
        {
            "closure_around": _chart(rounds),
            "closure_air": _picture(rounds[-1].run, squares[-1].run),
        },
    )


def judge(
    rounds: Sequence[RoundRod], squares: Sequence[SquareRod]
) -> tuple[Verdict, Numbers]:
    """Verdict on the number in place of the flow, with the largest errors."""
    round_rms = max(rod.rms for rod in rounds)
    mean = max((rod.closure_mean / rod.flow_mean - 1 for rod in rounds), key=abs)
    worst, face, reynolds = max(
        (
            (error, face, box.reynolds)
            for box in squares
            for face, error in box.errors.items()
        ),
        key=lambda item: abs(item[0]),
    )
    total = max((box.mean_error for box in squares), key=abs)
    round_holds = max(round_rms, abs(mean)) < _MAX_ERROR
    square_holds = max(abs(worst), abs(total)) < _MAX_ERROR
    verdict = judged(round_holds and square_holds, different=round_holds)
    height, width = rounds[-1].run.channel.shape
    return verdict, {
        "round_rms": round_rms,
        "round_mean": mean,
        "square_worst": worst,
        "square_face": face,
        "square_reynolds": reynolds,
        "square_total": total,
        "updates": height * width * int(rounds[-1].run.step[-1]),
        "errors": [
            *({"rod": "round", "Re": r.reynolds, "rms": r.rms} for r in rounds),
            *(
                {
                    "rod": "square",
                    "Re": box.reynolds,
                    "whole": box.mean_error,
                    **box.errors,
                    "front by its width": _front_by_width(box),
                }
                for box in squares
            ),
        ],
    }


def _front_by_width(box: SquareRod) -> float:
    """Relative error on the front, with the width as the length [-]."""
    (number,) = local_number(np.zeros(1), box.reynolds, PRANDTL)
    return float(number / box.flow["front"] - 1)


def _round_rod(reynolds: float, cells: int, passes: float) -> RoundRod:
    """The flow around a round rod, `cells` wide, for some passes of the channel."""
    setup = wake_setup(reynolds, cells, heated=True)._replace(passes=passes)
    run = wake_run(reynolds, setup, heated=True)
    mean = mean_nusselt(run)
    cosines = np.ones_like(DEGREES)
    for order, factor in enumerate(nusselt_shape(run, _COSINES), start=1):
        cosines += factor * np.cos(order * np.radians(DEGREES))
    correlation = churchill_bernstein(jnp.asarray(reynolds), jnp.asarray(PRANDTL))
    return RoundRod(
        reynolds=reynolds,
        run=run,
        flow=mean * cosines,
        closure=local_number(DEGREES, reynolds, PRANDTL),
        flow_mean=mean,
        closure_mean=mean_number(reynolds, PRANDTL),
        correlation_mean=float(correlation),
    )


def _square_rod(reynolds: float, cells: int, passes: float) -> SquareRod:
    """The flow around a square rod, `cells` wide, for some passes of the channel."""
    setup = wake_setup(reynolds, cells, heated=True)
    channel = wake_channel(reynolds, setup, heated=True)
    middle = channel.body.centre
    row, column = np.indices(channel.shape) + 0.5
    off_column = np.abs(column - middle[0])
    off_row = np.abs(row - middle[1])
    off_centre = np.maximum(off_column, off_row)
    channel = replace(channel, body=off_centre < cells / 2)
    steps = round(passes * channel.shape[1] / float(channel.speed))
    run = simulate_flow(channel, steps, average_from=0.9)
    angles = np.array(list(FACES.values()))
    closure = local_number(angles, _AS_LARGE * reynolds, PRANDTL) / _AS_LARGE
    return SquareRod(
        reynolds=reynolds,
        run=run,
        flow=face_numbers(run),
        closure=dict(zip(FACES, closure.tolist(), strict=True)),
    )


def face_numbers(run: FlowRun) -> dict[str, float]:
    """Nusselt numbers of the faces of a square body of whole cells."""
    channel = run.channel
    assert run.link_heat is not None and channel.diffusivity is not None
    links = body_links(channel.body, channel.shape)
    along, across = _hit_places(np.asarray(links.solid))
    # What leaves over an edge belongs to both of its faces.
    is_edge = np.isclose(np.abs(along), np.abs(across))
    heat = run.link_heat.astype(float) * np.where(is_edge, 0.5, 1.0)
    on_ends = (np.abs(along) > np.abs(across)) | is_edge
    on_sides = (np.abs(across) > np.abs(along)) | is_edge
    sums = {
        "front": heat[on_ends & (along < 0)].sum(),
        "each side": heat[on_sides].sum() / 2,
        "rear": heat[on_ends & (along > 0)].sum(),
    }
    diffusivity = float(channel.diffusivity)
    return {face: float(total) / diffusivity for face, total in sums.items()}


def _hit_places(solid: Bool[np.ndarray, "y x"]) -> tuple[np.ndarray, np.ndarray]:
    """Places where links meet the surface, from the body's middle [cells]."""
    row, column = np.indices(solid.shape)
    height, width = solid.shape
    ways = np.array(VELOCITIES[1:])[:, :, None, None]
    return (
        column - (width - 1) / 2 + ways[:, 0] / 2,
        row - (height - 1) / 2 + ways[:, 1] / 2,
    )


_Row = tuple[str, float, float]
"""Name of a Nusselt number, that of the flow, and the one in its place."""


def _round_rows(rod: RoundRod) -> list[_Row]:
    rows = [
        ("round rod, mean", rod.flow_mean, rod.closure_mean),
        ("round rod, Churchill-Bernstein", rod.flow_mean, rod.correlation_mean),
    ]
    for degrees in FACES.values():
        index = int(np.flatnonzero(degrees == DEGREES)[0])
        name = f"round rod, {degrees:g}°"
        rows.append((name, rod.flow[index], rod.closure[index]))
    return rows


def _square_rows(box: SquareRod) -> list[_Row]:
    rows = [
        (f"square rod, {face}", box.flow[face], box.closure[face]) for face in FACES
    ]
    return [("square rod, mean", *box.means), *rows]


def _chart(rounds: Sequence[RoundRod]) -> Chart:
    points = []
    for rod in rounds:
        name = f"Re {rod.reynolds:g}"
        points += curve(name, DEGREES, rod.closure, marks=LINE)
        # Dots every 15 degrees, which one can tell from the line.
        points += curve(name, DEGREES, rod.flow, every=5, marks=DOT)
    return curve_chart(
        points=points,
        x=angle_axis(),
        y=alt.Y("y:Q", title="local Nusselt number"),
        title="Round rod in air: number and flow",
        colours=SHADES[1:5:2],
    )


def _picture(round_run: FlowRun, square_run: FlowRun) -> Image.Image:
    return thermal_sheet(
        [_air(round_run, "round rod"), _air(square_run, "square rod")],
        limits=(0.0, 1.0),
        scale="excess over the wind's temperature, 1 at the rod",
        title="Temperature of the air",
    )


def _air(run: FlowRun, name: str) -> Shot:
    solid = run.channel.body.mask(run.channel.shape)
    assert run.mean.temperature is not None
    rows, columns = np.nonzero(solid)
    half = _AROUND * (np.ptp(columns) + 1)
    row = round(float(rows.mean()))
    column = round(float(columns.mean()))
    window = (slice(row - half, row + half), slice(column - half, column + half))
    temperature, body = (
        # The lattice counts rows upwards.
        enlarged(values[window][::-1, :, None], _EDGE)[..., 0]
        for values in (np.asarray(run.mean.temperature, float), solid)
    )
    return Shot(temperature, body=~body, name=name)
