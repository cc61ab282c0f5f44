"""Section 6.3: what the time of a step is spent on, over the resolution."""

from collections.abc import Callable
from typing import Any

import altair as alt
import numpy as np

import jaxthermo as jt
from jaxthermo.image.surface.camera import frame_all
from jaxthermo.provenance import processor
from jaxthermo.report.chart import Chart, legend
from jaxthermo.report.numbers import significant

from ...benchmarks.mixed import Runner
from ...harness.meshes import START, STEEL
from ...harness.present import Rows, table_of
from ...harness.timing import interleaved, timed_call
from ..bodies import buddha
from ..exhibit import Exhibit, Finding, Plot, Row, Verdict
from ..line_chart import COLOURS
from ..resolution import timed_runner


# Of the picture [px].
_PIXELS = (480, 640)
# Voxels along up.
_HEIGHTS, _QUICK_HEIGHTS = (60, 120, 240), (40, 120)
_REPEATS = 30
_FULL, _NESTED = "full volume", "irregular levels"
_STRUCTURES = {_FULL: jt.FullVolume, _NESTED: jt.IrregularMultiLevel}
_STEP, _PICTURE = "step", "picture"
# Of the ball [m], and how deep it stands in the head [voxels].
_RADIUS, _DEPTH = 0.06, 0.3
_TERMS = (
    jt.Sun((-1.0, 0.4, -0.5), 1000.0),
    jt.Wind((0.0, 3.0, 0.0), START - 10.0),
    jt.Contact(5e3),
)
_MECHANISMS: dict[str, tuple[type, ...]] = {
    "radiation": (jt.Sun,),
    "convection": (jt.Wind,),
    "contact": (jt.Contact,),
}
_CONDUCTION, _SURFACE = "conduction", "surface"
_PARTS = (_CONDUCTION, *_MECHANISMS, _SURFACE)


def _scene(name: str, height: int) -> jt.Scene:
    """The statue with a warm ball on its head, all in one structure."""
    grid = buddha().grid(height)
    mesh = grid.mesh
    ball = jt.voxelize(jt.shapes.sphere(_RADIUS), grid.pitch)
    top = mesh.vertices[np.argmax(mesh.vertices[:, 2])]
    at = top + np.array([0.0, 0.0, _RADIUS - _DEPTH * grid.pitch])
    pose = jt.Pose(translation=tuple(at.tolist()))
    make = _STRUCTURES[name]
    statue = jt.Body(make(grid), STEEL, temperature=START)
    warm = jt.Body(make(ball), STEEL, temperature=START + 20.0, pose=pose)
    return jt.Scene((statue, warm), _TERMS)


def _measured(name: str, height: int, each: bool) -> dict[str, Any]:
    """Times of a step, of conduction in it, of a picture, and of voxelization.

    Also of `each` mechanism, for which the scene is compiled without it.
    """
    scene = _scene(name, height)
    runners = {_STEP: timed_runner(scene), _CONDUCTION: _without(scene, object)}
    if each:
        runners |= {m: _without(scene, *kinds) for m, kinds in _MECHANISMS.items()}
    calls: dict[str, Callable[[], Any]] = {n: r.call for n, r in runners.items()}
    if each:
        calls[_PICTURE] = _picture(scene)
    spans = interleaved(calls, _REPEATS, there_and_back=True)
    # The fastest of each: what else the machine does only makes a call slower.
    fastest = {name: min(found) for name, found in spans.items()}
    for call, runner in runners.items():
        fastest[call] /= runner.steps
    grids = [body.structure.grid for body in scene.bodies]
    voxelize = lambda: [jt.voxelize(grid.mesh, grid.pitch) for grid in grids]
    receipt = runners[_STEP].compiled.receipt
    return {
        "structure": name,
        "height": height,
        "nodes": receipt.nodes,
        "fragments": receipt.fragments,
        "voxelization_s": timed_call(voxelize)[1],
        "step_s": fastest[_STEP],
        "picture_s": fastest.get(_PICTURE),
        "of_step": _shares(fastest, each),
    }


def _without(scene: jt.Scene, *kinds: type) -> Runner:
    others = tuple(term for term in scene.terms if not isinstance(term, kinds))
    return timed_runner(jt.Scene(scene.bodies, others))


def _picture(scene: jt.Scene) -> Callable[[], Any]:
    """A call that draws the statue as it is at the start."""
    lit = jt.Scene(scene.bodies, scene.terms[:1])
    start = jt.simulate(lit, 1.0, [0.0], solver=jt.ForwardEuler())
    camera = frame_all(scene.bodies[0].structure.grid.mesh.triangles, *_PIXELS)
    return lambda: jt.render(start, camera).temperature


def _shares(spans: dict[str, float], each: bool) -> dict[str, float]:
    """Shares of a step [-]."""
    step = spans[_STEP]
    conduction = min(1.0, spans[_CONDUCTION] / step)
    surface = 1 - conduction
    if not each:
        return {_CONDUCTION: conduction, _SURFACE: surface}
    saved = {name: max(0.0, step - spans[name]) for name in _MECHANISMS}
    # Mechanisms have work in common, which is saved only without all of them.
    part = surface / max(sum(saved.values()), 1e-3 * step)
    return {_CONDUCTION: conduction, **{n: part * s for n, s in saved.items()}}


def _measure(quick: bool) -> Finding:
    heights = _QUICK_HEIGHTS if quick else _HEIGHTS
    cases = [(name, height) for name in _STRUCTURES for height in heights]
    if quick:
        cases.remove((_NESTED, heights[0]))
    # In the reduced size only one of them mechanism by mechanism.
    each = lambda case: not quick or case == (_FULL, heights[-1])
    rows = [_measured(*case, each(case)) for case in cases]
    chosen = (
        *buddha().stands_in,
        ("scene", "a warm ball on the statue's head, in sun and wind of 3 m/s"),
        ("picture", f"of the statue, {_PIXELS[0]} x {_PIXELS[1]} pixels"),
        (
            "share",
            "conduction: a step of the bodies alone; the rest is divided in proportion "
            "to what a step is faster without each mechanism",
        ),
    )
    parts = (
        Plot(
            "time_shares",
            _chart(rows),
            f"The fastest of {_REPEATS} calls of each, in turn, on {processor()}.",
        ),
        table_of(rows, _columns(rows), "Shares of a step; times [ms]", left=(1,)),
    )
    verdict, reason = _judged(rows)
    numbers = {"rows": rows}
    return Finding(verdict, reason, _rows(rows), {}, chosen, parts, numbers)


def _judged(rows: Rows) -> tuple[Verdict, str]:
    full = [row for row in rows if row["structure"] == _FULL]
    first, last, nested = full[0], full[-1], rows[-1]
    own = last["of_step"]
    leads = max(own, key=own.__getitem__) == _CONDUCTION
    if own[_CONDUCTION] > 0.5:
        verdict = Verdict.REPRODUCED
    else:
        verdict = Verdict.DIFFERENT if leads else Verdict.CONTRADICTED
    percent = lambda row: f"{row['of_step'][_CONDUCTION]:.0%}"
    listed = ", ".join(f"{n} {share:.0%}" for n, share in last["of_step"].items())
    return verdict, (
        "The thesis has no number, only that conduction involves all voxels and the "
        f"rest the surface. Conduction takes {percent(first)} of a step of the full "
        f"volume at {first['height']} voxels high and {percent(last)} at "
        f"{last['height']} ({listed}); of irregular levels, whose nodes are about as "
        f"many as surface cells, {percent(nested)}. A picture takes as long as "
        f"{significant(last['picture_s'] / last['step_s'])} steps, and voxelization, "
        f"once, as {significant(last['voxelization_s'] / last['step_s'])}."
    )


def _rows(rows: Rows) -> tuple[Row, ...]:
    rapid = "rapid: surface only"
    said = {_CONDUCTION: "entire voxels", "radiation": rapid, "convection": rapid}
    return tuple(
        Row(
            f"{part}, {row['structure']}, {row['height']} high",
            said[part],
            f"{share:.0%}",
            "of a step",
        )
        for row in rows
        if row["height"] == rows[-1]["height"]
        for part, share in row["of_step"].items()
        if part in said
    )


def _used(rows: Rows) -> list[str]:
    """Parts that any of the rows has."""
    return [part for part in _PARTS if any(part in row["of_step"] for row in rows)]


def _columns(rows: Rows) -> list[tuple[str, Any]]:
    def share(part: str) -> Callable[[dict[str, Any]], str]:
        return lambda row: (
            f"{row['of_step'][part]:.0%}" if part in row["of_step"] else ""
        )

    def milliseconds(key: str) -> Callable[[dict[str, Any]], str]:
        return lambda row: "" if row[key] is None else significant(1e3 * row[key])

    return [
        ("high", "{height}"),
        ("structure", "{structure}"),
        ("nodes", "{nodes:,}"),
        ("surface cells", "{fragments:,}"),
        *((part, share(part)) for part in _used(rows)),
        ("step", milliseconds("step_s")),
        ("picture", milliseconds("picture_s")),
        ("voxelize", milliseconds("voxelization_s")),
    ]


def _chart(rows: Rows) -> Chart:
    name = lambda row: f"{row['structure']}, {row['height']} high"
    values = [
        {
            "scene": name(row),
            "part": part,
            "order": _PARTS.index(part),
            "share": 100 * share,
            "text": f"{name(row)}: {part} {share:.0%}",
        }
        for row in rows
        for part, share in row["of_step"].items()
    ]
    used = _used(rows)
    colours = [COLOURS[_PARTS.index(part)] for part in used]
    axis = alt.Axis(labelLimit=220)
    return (
        alt.Chart(alt.Data(values=values))
        .mark_bar()
        .encode(
            x=alt.X(
                "share:Q",
                title="share of a step [%]",
                stack="zero",
                scale=alt.Scale(domain=[0, 100]),
            ),
            y=alt.Y("scene:N", title=None, sort=None, axis=axis),
            color=alt.Color(
                "part:N",
                scale=alt.Scale(domain=used, range=colours),
                sort=None,
                legend=legend(),
            ),
            order=alt.Order("order:Q"),
            description="text:N",
        )
        .properties(width=480, height=46 * len(rows), title="Time of a step")
    )


EXHIBIT = Exhibit(
    name="section-6.3-shares",
    title="what the time of a step is spent on",
    place="6.3",
    claims=(),
    measure=_measure,
)
