"""6.3: what the time of a step is spent on, over the resolution."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import altair as alt
import numpy as np

import jaxthermo as jt
from jaxthermo.image.surface.camera import frame_all
from jaxthermo.provenance import processor
from jaxthermo.report.chart import COLOURS, Chart, legend
from jaxthermo.timing import interleaved, timed_call

from ...benchmarks.mixed import Runner
from ...harness.meshes import START, STEEL
from ..bodies import buddha
from ..exhibit import Finding, Numbers, Verdict, exhibit, judged
from ..resolution import BUILDS, timed_runner
from ..table_6_1 import FULL, IRREGULAR


# Voxels along up.
_HEIGHTS = (60, 120, 240)
_QUICK_HEIGHTS = (40, 120)
_REPEATS = 30
# Of the ball [m], and how deep it stands in the head [voxels].
_RADIUS = 0.06
_DEPTH = 0.3
_TERMS = (
    jt.Sun((-1.0, 0.4, -0.5), 1000.0),
    jt.Wind((0.0, 3.0, 0.0), START - 10.0),
    jt.Contact(5e3),
)
_MECHANISMS = {"radiation": jt.Sun, "convection": jt.Wind, "contact": jt.Contact}
_CONDUCTION = "conduction"
_SURFACE = "surface"
_PARTS = (_CONDUCTION, *_MECHANISMS, _SURFACE)


@exhibit("section-6.3-shares", "6.3")
def _shares_of_a_step(quick: bool) -> Finding:
    """Time a step with and without each mechanism."""
    heights = _QUICK_HEIGHTS if quick else _HEIGHTS
    cases = [(name, height) for name in (FULL, IRREGULAR) for height in heights]
    if quick:
        cases.remove((IRREGULAR, heights[0]))
    rows = []
    for name, height in cases:
        # In the reduced size only one of them mechanism by mechanism.
        by_mechanism = not quick or (name, height) == (FULL, heights[-1])
        rows.append(_times(name, height, by_mechanism=by_mechanism))
    verdict, numbers = judge(rows)
    return Finding(
        verdict,
        {
            **numbers,
            "mesh": buddha().name,
            "rows": rows,
            "processor": processor(),
        },
        {"time_shares": _chart(rows)},
    )


class StepShares(NamedTuple):
    """Times of one structure at one resolution."""

    structure: str
    height: int
    """Voxels along up."""
    nodes: int
    fragments: int
    voxelization_s: float
    step_s: float
    picture_s: float | None
    """None where no mechanism is told apart."""
    of_step: dict[str, float]
    """Shares of a step by mechanism [-]."""


def judge(rows: Sequence[StepShares]) -> tuple[Verdict, Numbers]:
    """Verdict on conduction as what takes most of a step, and its numbers."""
    full = [row for row in rows if row.structure == FULL]
    last = full[-1]
    shares = last.of_step
    picture = last.picture_s
    assert picture is not None
    leads = max(shares, key=shares.__getitem__) == _CONDUCTION
    return judged(shares[_CONDUCTION] > 0.5, different=leads), {
        "heights": [full[0].height, last.height],
        "conduction": [row.of_step[_CONDUCTION] for row in (full[0], last)],
        "conduction_irregular": rows[-1].of_step[_CONDUCTION],
        "shares": shares,
        "picture_steps": picture / last.step_s,
        "voxelization_steps": last.voxelization_s / last.step_s,
    }


def _scene(name: str, height: int) -> jt.Scene:
    """The statue with a warm ball on its head, both in one structure."""
    grid = buddha().grid(height)
    vertices = grid.mesh.vertices
    ball = jt.voxelize(jt.shapes.sphere(_RADIUS), grid.pitch)
    top = vertices[np.argmax(vertices[:, 2])]
    position = top + np.array([0.0, 0.0, _RADIUS - _DEPTH * grid.pitch])
    pose = jt.Pose(translation=tuple(position.tolist()))
    build = BUILDS[name]
    statue = jt.Body(build(grid), STEEL, temperature=START)
    warm = jt.Body(build(ball), STEEL, temperature=START + 20.0, pose=pose)
    return jt.Scene((statue, warm), _TERMS)


def _times(name: str, height: int, *, by_mechanism: bool) -> StepShares:
    """Times of a step, of conduction in it, of a picture, and of voxelization.

    With `by_mechanism` also of a step of the scene compiled without each mechanism.
    """
    scene = _scene(name, height)
    runners = {"step": timed_runner(scene), _CONDUCTION: _without(scene, object)}
    if by_mechanism:
        for mechanism, term in _MECHANISMS.items():
            runners[mechanism] = _without(scene, term)
    calls: dict[str, Callable[[], Any]] = {}
    calls |= {name: runner.call for name, runner in runners.items()}
    if by_mechanism:
        calls["picture"] = _picture_call(scene)
    spans = interleaved(calls, _REPEATS, there_and_back=True)
    # The fastest of each: what else the machine does only makes a call slower.
    fastest = {call: min(times) for call, times in spans.items()}
    for call, runner in runners.items():
        fastest[call] /= runner.steps
    grids = [body.structure.grid for body in scene.bodies]
    _, voxelization = timed_call(
        lambda: [jt.voxelize(grid.mesh, grid.pitch) for grid in grids]
    )
    receipt = runners["step"].compiled.receipt
    return StepShares(
        structure=name,
        height=height,
        nodes=receipt.nodes,
        fragments=receipt.fragments,
        voxelization_s=voxelization,
        step_s=fastest["step"],
        picture_s=fastest.get("picture"),
        of_step=shares_of(fastest, by_mechanism=by_mechanism),
    )


def _without(scene: jt.Scene, term_type: type) -> Runner:
    terms = tuple(term for term in scene.terms if not isinstance(term, term_type))
    return timed_runner(jt.Scene(scene.bodies, terms))


def _picture_call(scene: jt.Scene) -> Callable[[], Any]:
    """A call that draws the statue as it is at the start."""
    lit = jt.Scene(scene.bodies, scene.terms[:1])
    start = jt.simulate(lit, 1.0, [0.0], solver=jt.ForwardEuler())
    triangles = scene.bodies[0].structure.grid.mesh.triangles
    camera = frame_all(triangles, 480, 640)
    return lambda: jt.render(start, camera).temperature


def shares_of(spans: Mapping[str, float], *, by_mechanism: bool) -> dict[str, float]:
    """Shares of a step [-]."""
    step = spans["step"]
    conduction = min(1.0, spans[_CONDUCTION] / step)
    surface = 1 - conduction
    if not by_mechanism:
        return {_CONDUCTION: conduction, _SURFACE: surface}
    saved = {name: max(0.0, step - spans[name]) for name in _MECHANISMS}
    # Mechanisms have work in common, which is saved only without all of them.
    scale = surface / max(sum(saved.values()), 1e-3 * step)
    shares = {name: scale * seconds for name, seconds in saved.items()}
    return {_CONDUCTION: conduction, **shares}


def _chart(rows: Sequence[StepShares]) -> Chart:
    values = []
    for row in rows:
        scene = f"{row.structure}, {row.height} high"
        for name, share in row.of_step.items():
            values.append(
                {
                    "scene": scene,
                    "part": name,
                    "order": _PARTS.index(name),
                    "share": 100 * share,
                    "text": f"{scene}: {name} {share:.0%}",
                }
            )
    used = [name for name in _PARTS if any(name in row.of_step for row in rows)]
    colours = [COLOURS[_PARTS.index(name)] for name in used]
    colour = alt.Scale(domain=used, range=colours)
    percent = alt.Scale(domain=[0, 100])
    chart = alt.Chart(alt.Data(values=values)).mark_bar()
    return chart.encode(
        x=alt.X("share:Q", title="share of a step [%]", stack="zero", scale=percent),
        y=alt.Y("scene:N", title=None, sort=None, axis=alt.Axis(labelLimit=220)),
        color=alt.Color("part:N", scale=colour, sort=None, legend=legend()),
        order=alt.Order("order:Q"),
        description="text:N",
    ).properties(width=480, height=46 * len(rows), title="Time of a step")
