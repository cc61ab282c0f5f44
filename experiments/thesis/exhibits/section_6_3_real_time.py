"""Section 6.3: frames a second of simulation and picture, as in the live view."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
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
from ..bodies import buddha
from ..counting import TIMES
from ..exhibit import Exhibit, Finding, Note, Plot, Row, Verdict
from ..line_chart import log_chart, point


# Voxels along up, and frames of each structure.
_HEIGHTS, _QUICK_HEIGHTS = (100, 250, 550), (60, 120)
_FRAMES, _QUICK_FRAMES = 20, 10
# Simulated seconds a second, as `jaxthermo view` begins, and in a frame at full speed.
_RATE = 20.0
_FRAME = _RATE / STEPS_A_SECOND

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

    def step(self) -> None:
        """Simulate up to the next frame."""
        if self.session.finished:
            self.session.reset()
        self.session.advance_to(self.session.time + _FRAME)

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
    session = LiveSession(Path(f"configs/scenes/{name}.yaml"), overrides, _RATE)
    return _View(session, LiveCamera(session.config, session.surfaces))


def _measured(height: int, frames: int) -> Rows:
    """Times of a frame of each structure, which take turns, at one resolution."""
    views = {name: _view(kind, height) for name, (kind, _) in _STRUCTURES.items()}
    calls: dict[str, Callable[[], Any]] = {}
    for name, view in views.items():
        calls |= {f"{name}: step": view.step, f"{name}: picture": view.picture}
    spans = interleaved(calls, frames)
    rows = []
    for name, view in views.items():
        step, picture = (np.array(spans[f"{name}: {w}"]) for w in ("step", "picture"))
        rate = 1 / (step + picture)
        plan = view.session.plan
        rows.append(
            {
                "structure": name,
                "height": height,
                "nodes": plan.compiled.receipt.nodes,
                "fragments": plan.compiled.receipt.fragments,
                "pixels": f"{view.camera.camera.width} x {view.camera.camera.height}",
                "stable_step_s": plan.stable_step,
                "copper_step_s": _copper_step(view.session),
                "step_s": step.tolist(),
                "picture_s": picture.tolist(),
                "frames_a_second": [float(f(rate)) for f in (np.median, min, max)],
                "simulated_a_second": _FRAME * float(np.median(rate)),
            }
        )
    return rows


def _copper_step(session: LiveSession) -> float:
    """Largest stable step, were the body of the thesis' copper [s]."""
    diffusivity = lambda m: float(m.conductivity / m.volumetric_heat_capacity)
    own = diffusivity(session.scene.bodies[0].material)
    assert session.plan.stable_step is not None
    return session.plan.stable_step * own / diffusivity(thesis_material("copper"))


def _measure(quick: bool) -> Finding:
    heights = _QUICK_HEIGHTS if quick else _HEIGHTS
    each = partial(_measured, frames=_QUICK_FRAMES if quick else _FRAMES)
    rows = [row for height in heights for row in each(height)]
    last = [row for row in rows if row["height"] == heights[-1]]
    speeds = {row["structure"]: row["frames_a_second"][0] for row in last}
    fluent = [name for name, speed in speeds.items() if speed >= STEPS_A_SECOND]
    slowest = min(last, key=lambda row: row["frames_a_second"][0])
    theirs = 1 / TIMES["full_volume"]
    reason = (
        f"The NVIDIA 9800 GT is not at hand, and 13 to 55 ms are steps of "
        f"conduction without a picture and without a step in seconds: at most "
        f"{theirs:.0f} frames a second of the full volume. Here, simulated and drawn, "
        f"{heights[-1]} voxels high on {processor()}: "
        + ", ".join(f"{name} {speed:.3g}" for name, speed in speeds.items())
        + f" frames a second; {len(fluent)} of {len(last)} reach the live view's "
        f"{STEPS_A_SECOND}. Even the slowest, {slowest['structure']}, is "
        f"{slowest['simulated_a_second']:.3g} times faster than the heat itself, for "
        f"a frame is {_FRAME:g} s of it."
    )
    chosen = (
        *buddha().stands_in,
        ("scene", "sun from the side and still air; the thesis names no scene"),
        (
            "frame",
            f"{_FRAME:g} s of heat, as the live view has at {_RATE:g} simulated "
            f"seconds a second, and a picture of {last[0]['pixels']} pixels",
        ),
        ("real time", f"{STEPS_A_SECOND} frames a second; the thesis has no number"),
    )
    parts = (
        Plot("real_time", _chart(rows), _caption()),
        table_of(rows, _columns(), "A frame of simulation and picture"),
        Note(
            "Structures take turns frame by frame; in brackets the slowest and the "
            f"fastest frame. Processor: {processor()}."
        ),
    )
    return Finding(
        Verdict.NOT_REPRODUCIBLE, reason, _rows(last), {}, chosen, parts, {"rows": rows}
    )


def _rows(last: Rows) -> tuple[Row, ...]:
    """Frames a second beside those of table 6.1, and what its steps are in seconds."""
    times = {name: TIMES[key] for name, (_, key) in _STRUCTURES.items()}
    frames, simulated = [], []
    for row in last:
        name, span = row["structure"], times[row["structure"]]
        most = f"at most {significant(1 / span)}"
        note = f"thesis: {1e3 * span:g} ms a step at {_TABLE_HEIGHT} voxels"
        speed = row["frames_a_second"][0]
        frames.append(Row(f"frames a second, {name}", most, speed, note))
        # The stable step falls with the square of the voxels' width.
        smaller = (row["height"] / _TABLE_HEIGHT) ** 2 / span
        steel, copper = (row[k] * smaller for k in ("stable_step_s", "copper_step_s"))
        simulated.append(
            Row(
                f"simulated seconds a second, {name}",
                f"{significant(steel)}, in copper {significant(copper)}",
                row["simulated_a_second"],
                "thesis: if a step of its time is the largest stable one in our body",
            )
        )
    return (*frames, *simulated)


def _columns() -> list[tuple[str, Any]]:
    milliseconds = lambda key: (
        lambda row: with_range(
            *(1e3 * float(f(row[key])) for f in (np.median, min, max))
        )
    )
    return [
        ("high", "{height}"),
        ("structure", "{structure}"),
        ("nodes", "{nodes:,}"),
        ("surface cells", "{fragments:,}"),
        ("step [ms]", milliseconds("step_s")),
        ("picture [ms]", milliseconds("picture_s")),
        ("frames a second", lambda row: with_range(*row["frames_a_second"])),
        ("simulated s / s", lambda row: significant(row["simulated_a_second"])),
    ]


def _chart(rows: Rows) -> Any:
    points = []
    for name, (_, key) in _STRUCTURES.items():
        for row in (r for r in rows if r["structure"] == name):
            speed = row["frames_a_second"][0]
            text = f"{name}, {row['height']} high: {significant(speed)} a second"
            points.append(point(name, row["height"], speed, text))
        text = f"{name}, thesis: at most {significant(1 / TIMES[key])} a second"
        points.append(point(name, _TABLE_HEIGHT, 1 / TIMES[key], text, mark=True))
    title = "C27: simulated and drawn"
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
