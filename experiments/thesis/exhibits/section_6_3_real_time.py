"""Section 6.3: frames a second of simulation and picture, as in the live view."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from jaxthermo.live.live_camera import LiveCamera
from jaxthermo.live.session import STEPS_A_SECOND, LiveSession
from jaxthermo.material.table import thesis_material
from jaxthermo.provenance import processor
from jaxthermo.report.numbers import significant, with_range

from ...harness.meshes import mesh_files
from ...harness.present import Rows, table_of
from ...harness.timing import interleaved
from ..bodies import CONFIGS, buddha
from ..counting import TIMES
from ..exhibit import Exhibit, Finding, Note, Plot, Row, Verdict
from ..line_chart import log_chart, point


# Voxels along up, and frames of each structure.
_HEIGHTS, _QUICK_HEIGHTS = (100, 250, 550), (60, 120)
_FRAMES = 10
# Simulated seconds a second, as `jaxthermo view` begins.
_RATE = 20.0

# Structures as a config has them, and their columns of table 6.1.
_STRUCTURES = {
    "single shell": ("single_shell", "shell"),
    "irregular levels": ("irregular_multi_level", "irregular"),
    "ten levels": ("{kind: multi_level, levels: 10}", "multi_level"),
    "full volume": ("full_volume", "full_volume"),
}
# Voxels along up of table 6.1, whose times are beside ours.
_TABLE_HEIGHT = 550


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


def _measured(height: int) -> Rows:
    """Frames of each structure at one resolution, first at the live view's rate.

    Then with one explicit step a frame, the largest stable one, as in the thesis.
    """
    views = {name: _view(kind, height) for name, (kind, _) in _STRUCTURES.items()}
    live = _timed(views, dict.fromkeys(views, _RATE / STEPS_A_SECOND))
    frames = {}
    for name, view in views.items():
        stable = view.session.plan.stable_step
        assert stable is not None
        frames[name] = stable
        view.session.set_rate(stable * STEPS_A_SECOND)
    alone = _timed(views, frames)
    rows = []
    for name, view in views.items():
        receipt, camera = view.session.plan.compiled.receipt, view.camera.camera
        rows.append(
            {
                "structure": name,
                "height": height,
                "nodes": receipt.nodes,
                "fragments": receipt.fragments,
                "pixels": f"{camera.width} x {camera.height}",
                "stable_step_s": frames[name],
                "table_6_1_step_s": _table_steps(view.session, height),
                "one_step": alone[name],
                "live": live[name],
            }
        )
    return rows


def _timed(views: dict[str, _View], frames: dict[str, float]) -> dict[str, dict]:
    """Times of frames of so many simulated seconds, in which structures take turns."""
    calls: dict[str, Callable[[], Any]] = {}
    for name, view in views.items():
        calls[f"{name}: step"] = partial(view.step, frames[name])
        calls[f"{name}: picture"] = view.picture
    spans = interleaved(calls, _FRAMES)
    found = {}
    for name in views:
        step, picture = (np.array(spans[f"{name}: {w}"]) for w in ("step", "picture"))
        rate = 1 / (step + picture)
        found[name] = {
            "step_s": step.tolist(),
            "picture_s": picture.tolist(),
            "frames_a_second": [float(f(rate)) for f in (np.median, np.min, np.max)],
            "simulated_a_second": frames[name] * float(np.median(rate)),
        }
    return found


def _table_steps(session: LiveSession, height: int) -> tuple[float, float]:
    """Largest explicit step h² / 6α of the voxels of table 6.1 [s].

    Of the scene's own body, and were it of copper.
    """
    body = session.scene.bodies[0]
    width = body.structure.grid.pitch * height / _TABLE_HEIGHT
    step = lambda m: width**2 * float(m.volumetric_heat_capacity / m.conductivity) / 6
    return step(body.material), step(thesis_material("copper"))


def _measure(quick: bool) -> Finding:
    heights = _QUICK_HEIGHTS if quick else _HEIGHTS
    rows = [row for height in heights for row in _measured(height)]
    last = [row for row in rows if row["height"] == heights[-1]]
    chosen = (
        *buddha().stands_in,
        ("scene", "sun from the side and still air; the thesis names no scene"),
        ("one step", "a frame has one explicit step, the largest stable one"),
        (
            "live view",
            f"a frame has {_RATE / STEPS_A_SECOND:g} s of heat, as `jaxthermo view` "
            "begins, in stages where explicit steps would be many",
        ),
        ("picture", f"{last[0]['pixels']} pixels; the thesis has no size"),
        ("real time", f"{STEPS_A_SECOND} frames a second; the thesis has no number"),
    )
    parts = (
        Plot("real_time", _chart(rows), _caption()),
        table_of(rows, _columns(), "A frame of simulation and picture", left=(1,)),
        Note(
            "Structures take turns frame by frame; in brackets the slowest and the "
            f"fastest frame. Processor: {processor()}."
        ),
    )
    verdict, numbers = Verdict.NOT_REPRODUCIBLE, {"rows": rows}
    return Finding(verdict, _reason(rows), _rows(last), {}, chosen, parts, numbers)


def _reason(rows: Rows) -> str:
    heights = list(dict.fromkeys(row["height"] for row in rows))
    of = lambda height: [row for row in rows if row["height"] == height]
    last = of(heights[-1])
    speed = lambda row, kind: row[kind]["frames_a_second"][0]
    said = lambda kind: ", ".join(
        f"{row['structure']} {significant(speed(row, kind))}" for row in last
    )
    fluent = ", ".join(
        f"{sum(speed(row, 'one_step') >= STEPS_A_SECOND for row in of(height))} of "
        f"{len(last)} at {height}"
        for height in heights
    )
    full = last[-1]
    steel, copper = (s / TIMES["full_volume"] for s in full["table_6_1_step_s"])
    return (
        "The NVIDIA 9800 GT is not at hand, and its 13 to 55 ms are steps of "
        "conduction without a picture and of no length in seconds: at most "
        f"{1 / TIMES['full_volume']:.0f} frames a second of the full volume. Here "
        f"{last[0]['height']} voxels high on {processor()}, with one step a frame and "
        f"its picture: {said('one_step')} frames a second; {STEPS_A_SECOND} are "
        f"reached by {fluent} voxels. Real time of the heat is another matter: with "
        "the largest stable step, h² / 6α, the thesis' full volume would simulate "
        f"{significant(steel)} s a second of this body, {significant(copper)} s of "
        "one of copper. The live view's longer steps simulate "
        f"{significant(full['live']['simulated_a_second'])} s a second of "
        f"the full volume here, with {said('live')} frames a second."
    )


def _rows(last: Rows) -> tuple[Row, ...]:
    """Frames a second beside those of table 6.1, and what its steps are in seconds."""
    frames, simulated = [], []
    for row in last:
        name = row["structure"]
        span = TIMES[_STRUCTURES[name][1]]
        most = f"at most {significant(1 / span)}"
        note = f"thesis: {1e3 * span:g} ms a step at {_TABLE_HEIGHT} voxels"
        speed = row["one_step"]["frames_a_second"][0]
        frames.append(Row(f"frames a second, one step, {name}", most, speed, note))
        steel, copper = (significant(s / span) for s in row["table_6_1_step_s"])
        simulated.append(
            Row(
                f"simulated seconds a second, one step, {name}",
                f"{steel}, in copper {copper}",
                row["one_step"]["simulated_a_second"],
                "thesis: if its step is h² / 6α, the largest stable one, in our steel",
            )
        )
    return (*frames, *simulated)


def _columns() -> list[tuple[str, Any]]:
    milliseconds = lambda kind, key: (
        lambda row: significant(1e3 * float(np.median(row[kind][key])))
    )
    speed = lambda kind: lambda row: with_range(*row[kind]["frames_a_second"])
    simulated = lambda kind: lambda row: significant(row[kind]["simulated_a_second"])
    return [
        ("high", "{height}"),
        ("structure", "{structure}"),
        ("nodes", "{nodes:,}"),
        ("one step [ms]", milliseconds("one_step", "step_s")),
        ("picture [ms]", milliseconds("one_step", "picture_s")),
        ("frames a second", speed("one_step")),
        ("simulated s / s", simulated("one_step")),
        ("live: steps [ms]", milliseconds("live", "step_s")),
        ("frames a second", speed("live")),
        ("simulated s / s", simulated("live")),
    ]


def _chart(rows: Rows) -> Any:
    points = []
    for name, (_, key) in _STRUCTURES.items():
        for row in (r for r in rows if r["structure"] == name):
            speed = row["one_step"]["frames_a_second"][0]
            text = f"{name}, {row['height']} high: {significant(speed)} a second"
            points.append(point(name, row["height"], speed, text))
        text = f"{name}, thesis: at most {significant(1 / TIMES[key])} a second"
        points.append(point(name, _TABLE_HEIGHT, 1 / TIMES[key], text, mark=True))
    title = "C27: one step and its picture"
    return log_chart(points, "voxels along up", "frames a second", title)


def _caption() -> str:
    return (
        "Diamonds: one over the times of table 6.1, without a picture, on an NVIDIA "
        f"9800 GT. Lines: here, with the picture, on {processor()}."
    )


EXHIBIT = Exhibit(
    name="section-6.3-real-time",
    title="frames a second of simulation and picture",
    place="6.3",
    claims=("C27",),
    measure=_measure,
)
