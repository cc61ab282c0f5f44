"""Section 6.3: what the time of a frame is spent on, over the resolution."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import altair as alt
import numpy as np

import jaxthermo as jt
from jaxthermo.live.live_camera import LiveCamera
from jaxthermo.live.session import LiveSession
from jaxthermo.provenance import processor
from jaxthermo.report.chart import Chart, legend
from jaxthermo.report.numbers import significant

from ...harness.meshes import mesh_files
from ...harness.present import Rows, table_of
from ...harness.timing import interleaved
from ..bodies import NO_PLANCK, buddha, planck
from ..exhibit import Exhibit, Finding, Plot, Row, Verdict, skipped
from ..line_chart import COLOURS
from ..resolution import timed_runner


# Both statues and a ball in contact, in sun, wind and surroundings.
_SCENE = Path("configs/scenes/mixed.yaml")
_BODIES = 3
# Voxels along up.
_HEIGHTS, _QUICK_HEIGHTS = (60, 120, 240), (24, 48)
_REPEATS, _QUICK_REPEATS = 5, 3
_STRUCTURES = {
    "full volume": "full_volume",
    "irregular levels": "irregular_multi_level",
}
_MECHANISMS: dict[str, tuple[type, ...]] = {
    "radiation": (jt.Sun, jt.Surroundings),
    "convection": (jt.Wind,),
    "contact": (jt.Contact,),
}
_PARTS = ("conduction", *_MECHANISMS, "rest of the step", "picture")


def _session(structure: str, height: int) -> LiveSession:
    files = mesh_files()
    changes = [
        f"bodies.{n}.{change}"
        for n in range(_BODIES)
        for change in (f"voxels_high={height}", f"structure={structure}")
    ]
    for n, body in enumerate((buddha(), planck())):
        assert body is not None
        changes.append(f"bodies.{n}.mesh.path={files[body.name].resolve()}")
    return LiveSession(_SCENE, tuple(changes))


def _measured(name: str, height: int, repeats: int) -> dict[str, Any]:
    """Times of a step and of its mechanisms, of a picture, and of voxelization."""
    session = _session(_STRUCTURES[name], height)
    scene, camera = session.scene, LiveCamera(session.config, session.surfaces)
    with_terms = lambda terms: timed_runner(
        jt.Scene(scene.bodies, tuple(terms), scene.dtype)
    )
    runners = {"step": with_terms(scene.terms), "conduction": with_terms(())}
    for mechanism, kinds in _MECHANISMS.items():
        others = (term for term in scene.terms if not isinstance(term, kinds))
        runners[mechanism] = with_terms(others)
    calls: dict[str, Callable[[], Any]] = {n: r.call for n, r in runners.items()}
    calls["picture"] = lambda: camera.frame(session)
    grids = [body.structure.grid for body in scene.bodies]
    calls["voxelization"] = lambda: [jt.voxelize(g.mesh, g.pitch) for g in grids]
    spans = {n: np.array(s) for n, s in interleaved(calls, repeats).items()}
    for n, runner in runners.items():
        spans[n] = spans[n] / runner.steps
    receipt = runners["step"].compiled.receipt
    return {
        "structure": name,
        "height": height,
        "nodes": receipt.nodes,
        "fragments": receipt.fragments,
        **_shares(spans),
    }


def _shares(spans: dict[str, np.ndarray]) -> dict[str, Any]:
    """Shares of a frame of one step and one picture, by times measured in turn."""
    step, frame = spans["step"], spans["step"] + spans["picture"]
    parts = {"conduction": spans["conduction"]}
    # What a scene is faster without a mechanism is the mechanism's time.
    parts |= {name: step - spans[name] for name in _MECHANISMS}
    parts["rest of the step"] = step - sum(parts.values())
    parts["picture"] = spans["picture"]
    middle = lambda values: float(np.median(values))
    return {
        "step_s": middle(step),
        "picture_s": middle(spans["picture"]),
        "voxelization_s": middle(spans["voxelization"]),
        "voxelization_frames": middle(spans["voxelization"] / frame),
        "of_frame": {name: middle(parts[name] / frame) for name in _PARTS},
        "of_step": {n: middle(parts[n] / step) for n in _PARTS if n != "picture"},
    }


def _measure(quick: bool) -> Finding:
    if planck() is None or not buddha().is_thesis:
        return skipped(NO_PLANCK)
    heights = _QUICK_HEIGHTS if quick else _HEIGHTS
    repeats = _QUICK_REPEATS if quick else _REPEATS
    # In the reduced size irregular levels only at the higher of the two.
    some = {"full volume": heights, "irregular levels": heights[quick:]}
    rows = [_measured(name, h, repeats) for name, each in some.items() for h in each]
    chosen = (
        ("scene", "Happy Buddha, Max Planck and a ball that touch, 3 m/s of wind"),
        ("frame", "one explicit step and one picture of the live view"),
        (
            "share",
            "what a step is faster without a mechanism; of conduction what bodies "
            "alone take, without any; the rest has ledger and reading of the surface",
        ),
    )
    parts = (
        Plot("time_shares", _chart(rows), f"Structures in turn, on {processor()}."),
        table_of(rows, _columns(), "Time of a frame", left=(1,)),
    )
    verdict, reason = _judged(rows)
    numbers = {"rows": rows}
    return Finding(verdict, reason, _rows(rows), {}, chosen, parts, numbers)


def _judged(rows: Rows) -> tuple[Verdict, str]:
    full = [row for row in rows if row["structure"] == "full volume"]
    first, last, nested = full[0], full[-1], rows[-1]
    own = last["of_step"]
    grows = own["conduction"] > first["of_step"]["conduction"]
    leads = own["conduction"] > max(own[name] for name in _MECHANISMS)
    mostly = own["conduction"] > 0.5
    if grows and mostly:
        verdict = Verdict.REPRODUCED
    else:
        verdict = Verdict.DIFFERENT if grows or leads else Verdict.CONTRADICTED
    percent = lambda row, key: f"{row['of_step'][key]:.0%}"
    listed = lambda row: ", ".join(f"{n} {percent(row, n)}" for n in row["of_step"])
    return verdict, (
        "The thesis has no number, only that conduction involves all voxels and the "
        "rest the surface alone. Conduction takes "
        f"{percent(first, 'conduction')} of a step of the full volume at "
        f"{first['height']} voxels high and {percent(last, 'conduction')} at "
        f"{last['height']} ({listed(last)}). In irregular levels, whose nodes are "
        f"about as many as the surface's, it is {percent(nested, 'conduction')} "
        f"({listed(nested)}): there the surface is what costs. A picture takes "
        f"{last['of_frame']['picture']:.0%} and {nested['of_frame']['picture']:.0%} of "
        "a frame with one step, and voxelization, once, as long as "
        f"{significant(last['voxelization_frames'])} and "
        f"{significant(nested['voxelization_frames'])} frames."
    )


def _rows(rows: Rows) -> tuple[Row, ...]:
    said = {
        "conduction": "entire voxels; mainly depends on it",
        "radiation": "rapid: surface only",
        "convection": "rapid: surface only",
    }
    return tuple(
        Row(
            f"{part}, {row['structure']}, {row['height']} high",
            said.get(part),
            f"{row['of_step'][part]:.0%}",
            "of a step",
        )
        for row in rows
        if row["height"] == rows[-1]["height"]
        for part in row["of_step"]
    )


def _columns() -> list[tuple[str, Any]]:
    share = lambda part: lambda row: f"{row['of_frame'][part]:.0%}"
    return [
        ("high", "{height}"),
        ("structure", "{structure}"),
        ("nodes", "{nodes:,}"),
        ("surface cells", "{fragments:,}"),
        ("step [ms]", lambda row: significant(1e3 * row["step_s"])),
        *((part, share(part)) for part in _PARTS),
        ("voxelization [ms]", lambda row: significant(1e3 * row["voxelization_s"])),
        ("in frames", lambda row: significant(row["voxelization_frames"])),
    ]


def _chart(rows: Rows) -> Chart:
    name = lambda row: f"{row['structure']}, {row['height']} high"
    values = [
        {
            "scene": name(row),
            "part": part,
            "order": order,
            # Differences of times that hardly differ may be negative.
            "share": max(0.0, 100 * row["of_frame"][part]),
            "text": f"{name(row)}: {part} {row['of_frame'][part]:.0%}",
        }
        for row in rows
        for order, part in enumerate(_PARTS)
    ]
    scale = alt.Scale(domain=list(_PARTS), range=[*COLOURS][: len(_PARTS)])
    return (
        alt.Chart(alt.Data(values=values))
        .mark_bar()
        .encode(
            x=alt.X("share:Q", title="share of a frame [%]", stack="zero"),
            y=alt.Y("scene:N", title=None, sort=None, axis=alt.Axis(labelLimit=220)),
            color=alt.Color("part:N", scale=scale, sort=None, legend=legend()),
            order=alt.Order("order:Q"),
            description="text:N",
        )
        .properties(width=520, height=46 * len(rows), title="Time of a frame")
    )


EXHIBIT = Exhibit(
    name="section-6.3-shares",
    title="what the time of a frame is spent on",
    place="6.3",
    claims=(),
    measure=_measure,
)
