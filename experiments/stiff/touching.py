"""Contact conductances from 0 to infinity (S11)."""

from collections.abc import Iterator

import numpy as np

import jaxthermo as jt

from ..harness.case import Bound, Case, Row
from .bodies import COLD, HOT, STEEL, beside, block, two_halves
from .methods import damping, too_long
from .solved import Method, judged, row_of, run_nodes, stable_step


CELLS, PITCH = 4, 0.01
CONDUCTANCES = (1.0, 1e3, 1e6, np.inf)


def pair(conductance: float) -> jt.Scene:
    """A hot and a cold block end to end.

    Args:
        conductance: h_c of the contact [W/(m^2 K)].
    """
    grid, half = block(CELLS, 3, 3, PITCH), CELLS * PITCH / 2
    bodies = beside(grid, -half, STEEL, HOT), beside(grid, half, STEEL, COLD)
    return jt.Scene(bodies, (jt.Contact(conductance),), dtype="float64")


def whole() -> jt.Scene:
    """The same as one body."""
    grid = block(2 * CELLS, 3, 3, PITCH)
    body = jt.Body(jt.FullVolume(grid), STEEL, temperature=two_halves)
    return jt.Scene((body,), (), dtype="float64")


def contacts() -> Iterator[Row]:
    """S11."""
    one = whole()
    for conductance in CONDUCTANCES:
        scene = pair(conductance)
        what, bonded = f"h_c = {conductance:g}", np.isinf(conductance)
        for method in damping(stable_step(scene), ratio=50.0):
            if bonded:
                yield _against(what, scene, one, method)
            else:
                yield judged(what, scene, method, (COLD, HOT))
        yield too_long(what, scene)
    apart = pair(0.0)
    for method in damping(stable_step(apart), ratio=50.0)[:3]:
        ran = run_nodes(apart, method.solver, method.end)
        moved = np.abs(np.concatenate(ran.nodes) - np.repeat([HOT, COLD], 36)).max()
        same = Bound("moved", float(moved), 0.0)
        yield row_of("h_c = 0", "float64", method, ran, (COLD, HOT), more=(same,))
    yield _limit()


def _against(what: str, scene: jt.Scene, one: jt.Scene, method: Method) -> Row:
    """A bonded pair beside one body of both, by the same solver."""
    ran = run_nodes(scene, method.solver, method.end)
    expected = run_nodes(one, method.solver, method.end)
    off = np.abs(np.concatenate(ran.nodes) - np.concatenate(expected.nodes)).max()
    check = Bound("off one body", float(off) / (HOT - COLD), 1e-10)
    # Their solves differ, and so do the steps that follow an error.
    adaptive = method.name == "TRBDF2, adaptive"
    more = () if adaptive else (check,)
    row = row_of(what, "float64", method, ran, (COLD, HOT), more=more)
    return row._replace(seen=f"off one body by {off:.2g} K")


def _limit() -> Row:
    """A conductance of 1e15 against none in the way."""
    solver, end = jt.ForwardEuler(), 100.0
    nodes = [
        np.concatenate(run_nodes(pair(h), solver, end).nodes) for h in (1e15, np.inf)
    ]
    off = float(np.abs(nodes[0] - nodes[1]).max()) / (HOT - COLD)
    check = Bound("off bonded", off, 1e-10)
    return Row("h_c = 1e15", "ForwardEuler", "float64", checks=(check,))


CASES = (
    Case(
        "S11",
        "contact conductances of 0, 1 to 1e6 and infinity",
        "resistances in series, 1 / (R1 + 1 / h_c A + R2)",
        "infinity is one body, to 1e-10 of the difference; 0 leaves both as they are, "
        "bit by bit; bounds and energy in between",
        "",
        contacts,
    ),
)
