"""6.3: frames a second of simulation and picture, as in the live view."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import jaxthermo as jt
from jaxthermo.live.live_camera import LiveCamera
from jaxthermo.live.session import STEPS_A_SECOND, LiveSession
from jaxthermo.material.table import thesis_material
from jaxthermo.provenance import processor
from jaxthermo.report.chart import Chart
from jaxthermo.timing import Spread, interleaved

from ...harness.line_chart import ALONE, curve, log_chart
from ...harness.meshes import mesh_files
from ..bodies import CONFIGS, buddha
from ..exhibit import Finding, Numbers, Verdict, exhibit
from ..table_6_1 import FULL, KINDS, TABLE_HEIGHT, TABLE_TIMES, TEN


# Voxels along up, and frames of each structure.
_HEIGHTS = (100, 250, 550)
_QUICK_HEIGHTS = (60, 120)
_FRAMES = 10
# Simulated seconds a second, as `jaxthermo view` begins.
_RATE = 20.0
STRUCTURES = {**KINDS, TEN: "{kind: multi_level, levels: 10}"}
"""Structures of table 6.1 as a config has them."""


@exhibit("section-6.3-real-time", "6.3")
def _real_time(quick: bool) -> Finding:
    """Time frames of the live view, and frames of one explicit step."""
    heights = _QUICK_HEIGHTS if quick else _HEIGHTS
    rows = [row for height in heights for row in _rows_at(height)]
    return Finding(Verdict.NOT_REPRODUCIBLE, summary(rows), {"real_time": _chart(rows)})


class _View(NamedTuple):
    """The simulation of a config and its camera, which go on frame by frame."""

    session: LiveSession
    camera: LiveCamera

    def step(self, frame: float) -> None:
        """Simulate up to the next frame, so much later [s]."""
        if self.session.finished:
            self.session.reset()
        self.session.advance_to(self.session.time + frame)

    def picture(self) -> Any:
        """Read the surface and draw the frame of the camera."""
        return self.camera.frame(self.session)


def _view(structure: str, height: int) -> _View:
    body = buddha()
    name = "happy-buddha" if body.is_thesis else "figurine"
    changes = [f"voxels_high={height}", f"structure={structure}"]
    if body.is_thesis:
        changes.append(f"mesh.path={mesh_files()[body.name].resolve()}")
    overrides = tuple(f"bodies.0.{change}" for change in changes)
    session = LiveSession(CONFIGS / "scenes" / f"{name}.yaml", overrides, _RATE)
    return _View(session, LiveCamera(session.config, session.surfaces))


class FrameTimes(NamedTuple):
    """Times of the frames of a structure."""

    step_s: list[float]
    """Every repeat."""
    picture_s: list[float]
    """Every repeat."""
    frames_a_second: list[float]
    """Median, lowest and highest rate."""
    simulated_a_second: float
    """Simulated seconds a second."""

    @property
    def speed(self) -> float:
        """Median of the frames a second."""
        return self.frames_a_second[0]

    @property
    def step_ms(self) -> float:
        """Median time of the steps of a frame [ms]."""
        return 1e3 * float(np.median(self.step_s))


class FrameRow(NamedTuple):
    """Frames of a structure at one resolution."""

    structure: str
    height: int
    """Voxels along up."""
    nodes: int
    fragments: int
    pixels: str
    stable_step_s: float
    table_6_1_step_s: list[float]
    """Largest stable steps at the voxels of table 6.1."""
    one_step: FrameTimes
    """Frames a second at one explicit step for each."""
    live: FrameTimes
    """At the rate of the live view."""


def _rows_at(height: int) -> list[FrameRow]:
    """Frames of each structure at one resolution, first at the live view's rate.

    Then with one explicit step a frame, the largest stable one, as in the thesis.
    """
    views = {name: _view(structure, height) for name, structure in STRUCTURES.items()}
    live = _timed(views, dict.fromkeys(views, _RATE / STEPS_A_SECOND))
    stable_steps = {}
    for name, view in views.items():
        stable = view.session.plan.stable_step
        assert stable is not None
        stable_steps[name] = stable
        view.session.set_rate(stable * STEPS_A_SECOND)
    one_step = _timed(views, stable_steps)
    rows = []
    for name, view in views.items():
        receipt = view.session.plan.compiled.receipt
        camera = view.camera.camera
        rows.append(
            FrameRow(
                structure=name,
                height=height,
                nodes=receipt.nodes,
                fragments=receipt.fragments,
                pixels=f"{camera.width} x {camera.height}",
                stable_step_s=stable_steps[name],
                table_6_1_step_s=_table_steps(view.session, height),
                one_step=one_step[name],
                live=live[name],
            )
        )
    return rows


def _timed(
    views: Mapping[str, _View], frames: Mapping[str, float]
) -> dict[str, FrameTimes]:
    """Times of frames of these simulated seconds; the structures take turns."""
    calls: dict[str, Callable[[], Any]] = {}
    for name, view in views.items():
        calls[f"{name}: step"] = partial(view.step, frames[name])
        calls[f"{name}: picture"] = view.picture
    spans = interleaved(calls, _FRAMES)
    times = {}
    for name in views:
        step = np.array(spans[f"{name}: step"])
        picture = np.array(spans[f"{name}: picture"])
        rate = Spread.of(1 / (step + picture))
        times[name] = FrameTimes(
            step_s=step.tolist(),
            picture_s=picture.tolist(),
            frames_a_second=[*rate],
            simulated_a_second=frames[name] * rate.median,
        )
    return times


def _table_steps(session: LiveSession, height: int) -> list[float]:
    """Largest explicit step h² / 6α of the voxels of table 6.1 [s].

    Of the scene's own body, and were it of copper.
    """
    body = session.scene.bodies[0]
    assert isinstance(body.material, jt.Material)
    width = body.structure.grid.pitch * height / TABLE_HEIGHT
    return [
        width**2 / float(material.diffusivity) / 6
        for material in (body.material, thesis_material("copper"))
    ]


def summary(rows: Sequence[FrameRow]) -> Numbers:
    """Numbers of the text, most of them at the highest resolution.

    `fluent` counts the structures that are fast enough for the live view.
    """
    heights = list(dict.fromkeys(row.height for row in rows))
    last = [row for row in rows if row.height == heights[-1]]
    full = last[-1]
    thesis_step = TABLE_TIMES[FULL]
    fluent = {
        f"{height} voxels": sum(
            row.one_step.speed >= STEPS_A_SECOND for row in rows if row.height == height
        )
        for height in heights
    }
    beside_table_6_1 = []
    for row in last:
        seconds = TABLE_TIMES[row.structure]
        simulated, of_copper = (step / seconds for step in row.table_6_1_step_s)
        beside_table_6_1.append(
            {
                "structure": row.structure,
                "step, thesis_ms": 1e3 * seconds,
                "frames a second, thesis at most": 1 / seconds,
                "here, one step": row.one_step.speed,
                "simulated s / s, thesis": simulated,
                "thesis, in copper": of_copper,
                "here": row.one_step.simulated_a_second,
            }
        )
    return {
        "mesh": buddha().name,
        "rows": rows,
        "highest": heights[-1],
        "pixels": full.pixels,
        "processor": processor(),
        "frames_a_second": {row.structure: row.one_step.speed for row in last},
        "live_frames_a_second": {row.structure: row.live.speed for row in last},
        "steps_a_second": STEPS_A_SECOND,
        "live_frame_s": _RATE / STEPS_A_SECOND,
        "fluent": fluent,
        "structures": len(last),
        "thesis_simulated": [step / thesis_step for step in full.table_6_1_step_s],
        "live_simulated": full.live.simulated_a_second,
        "beside_table_6_1": beside_table_6_1,
        "frames": [
            {
                "height": row.height,
                "structure": row.structure,
                "nodes": row.nodes,
                "one step_ms": row.one_step.step_ms,
                "picture_ms": 1e3 * float(np.median(row.one_step.picture_s)),
                "frames a second": row.one_step.speed,
                "simulated s / s": row.one_step.simulated_a_second,
                "live: steps_ms": row.live.step_ms,
                "live: frames a second": row.live.speed,
                "live: simulated s / s": row.live.simulated_a_second,
            }
            for row in rows
        ],
    }


def _chart(rows: Sequence[FrameRow]) -> Chart:
    points = []
    for name, seconds in TABLE_TIMES.items():
        of_structure = [row for row in rows if row.structure == name]
        heights = [row.height for row in of_structure]
        speeds = [row.one_step.speed for row in of_structure]
        points += curve(name, heights, speeds)
        points += curve(name, [TABLE_HEIGHT], [1 / seconds], marks=ALONE)
    return log_chart(
        points=points,
        x_title="voxels along up",
        y_title="frames a second",
        title="C27: one step and its picture",
    )
