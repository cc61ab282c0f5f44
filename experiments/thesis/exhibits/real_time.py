"""6.3: frames a second of simulation and picture, as in the live view."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, TypedDict

import numpy as np

import jaxthermo as jt
from jaxthermo.live.live_camera import LiveCamera
from jaxthermo.live.session import STEPS_A_SECOND, LiveSession
from jaxthermo.material.table import thesis_material
from jaxthermo.provenance import processor
from jaxthermo.report.chart import Chart
from jaxthermo.report.numbers import significant

from ...harness.meshes import mesh_files
from ...harness.timing import interleaved
from ..bodies import CONFIGS, buddha
from ..exhibit import Finding, Verdict, exhibit
from ..line_chart import log_chart, point
from ..resolution import FULL, IRREGULAR, SHELL, TABLE_HEIGHT, TABLE_TIMES, TEN


# Voxels along up, and frames of each structure.
_HEIGHTS = (100, 250, 550)
_QUICK_HEIGHTS = (60, 120)
_FRAMES = 10
# Simulated seconds a second, as `jaxthermo view` begins.
_RATE = 20.0
STRUCTURES = {
    SHELL: "single_shell",
    IRREGULAR: "irregular_multi_level",
    TEN: "{kind: multi_level, levels: 10}",
    FULL: "full_volume",
}
"""Structures of table 6.1 as a config has them."""


@exhibit("section-6.3-real-time", "6.3")
def real_time(quick: bool) -> Finding:
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


class FrameTimes(TypedDict):
    """Times of the frames of a structure."""

    step_s: list[float]
    """Every repeat."""
    picture_s: list[float]
    """Every repeat."""
    frames_a_second: list[float]
    """Median, lowest and highest rate."""
    simulated_a_second: float
    """Simulated seconds a second."""


class FrameRow(TypedDict):
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
    rows: list[FrameRow] = []
    for name, view in views.items():
        receipt = view.session.plan.compiled.receipt
        camera = view.camera.camera
        rows.append(
            {
                "structure": name,
                "height": height,
                "nodes": receipt.nodes,
                "fragments": receipt.fragments,
                "pixels": f"{camera.width} x {camera.height}",
                "stable_step_s": stable_steps[name],
                "table_6_1_step_s": _table_steps(view.session, height),
                "one_step": one_step[name],
                "live": live[name],
            }
        )
    return rows


def _timed(
    views: Mapping[str, _View], frames: Mapping[str, float]
) -> dict[str, FrameTimes]:
    """Times of frames of so many simulated seconds, in which structures take turns."""
    calls: dict[str, Callable[[], Any]] = {}
    for name, view in views.items():
        calls[f"{name}: step"] = partial(view.step, frames[name])
        calls[f"{name}: picture"] = view.picture
    spans = interleaved(calls, _FRAMES)
    times: dict[str, FrameTimes] = {}
    for name in views:
        step = np.array(spans[f"{name}: step"])
        picture = np.array(spans[f"{name}: picture"])
        rate = 1 / (step + picture)
        times[name] = {
            "step_s": step.tolist(),
            "picture_s": picture.tolist(),
            "frames_a_second": [
                float(np.median(rate)),
                float(np.min(rate)),
                float(np.max(rate)),
            ],
            "simulated_a_second": frames[name] * float(np.median(rate)),
        }
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


_ComparedRow = TypedDict(
    "_ComparedRow",
    {
        "structure": str,
        "step, thesis_ms": float,
        "frames a second, thesis at most": float,
        "here, one step": float,
        "simulated s / s, thesis": float,
        "thesis, in copper": float,
        "here": float,
    },
)
"""A structure of table 6.1 and here, under the headings that the page shows."""

_FramesShown = TypedDict(
    "_FramesShown",
    {
        "height": int,
        "structure": str,
        "nodes": int,
        "one step_ms": float,
        "picture_ms": float,
        "frames a second": float,
        "simulated s / s": float,
        "live: steps_ms": float,
        "live: frames a second": float,
        "live: simulated s / s": float,
    },
)
"""Frames of a structure, under the headings that the page shows."""


class FrameNumbers(TypedDict):
    """Numbers of the text on frames, most of them at the highest resolution."""

    mesh: str
    rows: Sequence[FrameRow]
    highest: int
    """Voxels along up of the highest resolution."""
    pixels: str
    processor: str
    frames_a_second: dict[str, float]
    """With one explicit step a frame, by structure."""
    live_frames_a_second: dict[str, float]
    """At the live view's rate, by structure."""
    steps_a_second: float
    live_frame_s: float
    """Simulated time of a frame of the live view."""
    fluent: dict[str, int]
    """Structures that are fast enough for the live view, by resolution."""
    structures: int
    thesis_simulated: list[float]
    """Simulated seconds a second of the thesis' full volume: ours, and of copper."""
    live_simulated: float
    beside_table_6_1: list[_ComparedRow]
    frames: list[_FramesShown]


def summary(rows: Sequence[FrameRow]) -> FrameNumbers:
    """Numbers of the text, from the rows of all resolutions."""
    heights = list(dict.fromkeys(row["height"] for row in rows))
    last = [row for row in rows if row["height"] == heights[-1]]
    full = last[-1]
    fluent = {
        f"{height} voxels": sum(
            _speed(row["one_step"]) >= STEPS_A_SECOND
            for row in rows
            if row["height"] == height
        )
        for height in heights
    }
    thesis_simulated = {
        row["structure"]: [
            step / TABLE_TIMES[row["structure"]] for step in row["table_6_1_step_s"]
        ]
        for row in last
    }
    return {
        "mesh": buddha().name,
        "rows": rows,
        "highest": heights[-1],
        "pixels": full["pixels"],
        "processor": processor(),
        "frames_a_second": {row["structure"]: _speed(row["one_step"]) for row in last},
        "live_frames_a_second": {row["structure"]: _speed(row["live"]) for row in last},
        "steps_a_second": STEPS_A_SECOND,
        "live_frame_s": _RATE / STEPS_A_SECOND,
        "fluent": fluent,
        "structures": len(last),
        "thesis_simulated": thesis_simulated[FULL],
        "live_simulated": full["live"]["simulated_a_second"],
        "beside_table_6_1": [
            {
                "structure": row["structure"],
                "step, thesis_ms": 1e3 * TABLE_TIMES[row["structure"]],
                "frames a second, thesis at most": 1 / TABLE_TIMES[row["structure"]],
                "here, one step": _speed(row["one_step"]),
                "simulated s / s, thesis": thesis_simulated[row["structure"]][0],
                "thesis, in copper": thesis_simulated[row["structure"]][1],
                "here": row["one_step"]["simulated_a_second"],
            }
            for row in last
        ],
        "frames": [
            {
                "height": row["height"],
                "structure": row["structure"],
                "nodes": row["nodes"],
                "one step_ms": _milliseconds(row["one_step"]["step_s"]),
                "picture_ms": _milliseconds(row["one_step"]["picture_s"]),
                "frames a second": _speed(row["one_step"]),
                "simulated s / s": row["one_step"]["simulated_a_second"],
                "live: steps_ms": _milliseconds(row["live"]["step_s"]),
                "live: frames a second": _speed(row["live"]),
                "live: simulated s / s": row["live"]["simulated_a_second"],
            }
            for row in rows
        ],
    }


def _speed(times: FrameTimes) -> float:
    """Median of the frames a second."""
    return float(times["frames_a_second"][0])


def _milliseconds(spans: Sequence[float]) -> float:
    return 1e3 * float(np.median(spans))


def _chart(rows: Sequence[FrameRow]) -> Chart:
    points = []
    for name, seconds in TABLE_TIMES.items():
        for row in (row for row in rows if row["structure"] == name):
            speed = _speed(row["one_step"])
            text = f"{name}, {row['height']} high: {significant(speed)} a second"
            points.append(point(name, row["height"], speed, text))
        text = f"{name}, thesis: at most {significant(1 / seconds)} a second"
        points.append(point(name, TABLE_HEIGHT, 1 / seconds, text, mark=True))
    title = "C27: one step and its picture"
    return log_chart(points, "voxels along up", "frames a second", title)
