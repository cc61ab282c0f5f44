"""Count what a reader walks through: calls to a temperature, and files entered.

    python tests/tools/count_hops.py

It prints three counts of a scene of eight nodes with sun, convection and surroundings:

- the *hops* from `simulate()` to the update of a temperature: the functions of
  jaxthermo on Python's stack when the network of conduction is first asked for an
  explicit step, while the loop is traced. A hop is a call of one of our functions by
  another one, whatever libraries lie between; a comprehension or generator counts with
  the function that it is written in, an attribute access of a module does not count;
- the files of jaxthermo that `compile_scene` enters, by `sys.setprofile`: those of
  which any function runs, the file of `compile_scene` included. What earlier calls
  have stored is forgotten, and nothing is read from the user's cache;
- the files that a frame of the solution enters in the same way, by `render`.
"""

import inspect
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any


os.environ["JAXTHERMO_CACHE"] = "off"

import numpy as np  # noqa: E402

import jaxthermo as jt  # noqa: E402
from jaxthermo.network.network import AbstractNetwork  # noqa: E402


PACKAGE = Path(inspect.getfile(jt)).parent
_INNER = ("<genexpr>", "<listcomp>", "<setcomp>", "<dictcomp>")


class _Reached(Exception):  # noqa: N818
    """A temperature is updated."""


def eight_nodes() -> jt.Scene:
    """A cube of eight voxels with sun, convection and surroundings."""
    grid = jt.grid_from_voxels(np.ones((2, 2, 2), bool), pitch=0.01)
    body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=300.0)
    terms = (
        jt.Sun((0.0, 0.0, -1.0), 900.0),
        jt.Convection(10.0, 290.0),
        jt.Surroundings(280.0),
    )
    return jt.Scene((body,), terms)


def own_file(frame: FrameType) -> str:
    """Path of a frame's file within jaxthermo; empty for any other file."""
    path = Path(frame.f_code.co_filename)
    return str(path.relative_to(PACKAGE)) if path.is_relative_to(PACKAGE) else ""


def entered_files(call: Callable[[], Any]) -> list[str]:
    """Files of jaxthermo whose functions run during a call."""
    files: set[str] = set()

    def profile(frame: FrameType, event: str, argument: object) -> None:
        if event == "call":
            files.add(own_file(frame))

    sys.setprofile(profile)
    try:
        call()
    finally:
        sys.setprofile(None)
    return sorted(files - {""})


def hops_to_update(solver: Any = None) -> list[str]:
    """Functions from `simulate()` to the network's step, each with its file."""
    stack: list[str] = []

    def profile(frame: FrameType, event: str, argument: object) -> None:
        is_update = frame.f_code.co_name == "euler_step"
        if event != "call" or not is_update or not own_file(frame) or stack:
            return
        owner = frame.f_locals.get("self")
        if not isinstance(owner, AbstractNetwork):
            return
        step: FrameType | None = frame
        while step is not None:
            name = step.f_code.co_name
            if own_file(step) and name not in _INNER:
                stack.append(f"{name} ({own_file(step)})")
            step = step.f_back
        raise _Reached

    sys.setprofile(profile)
    try:
        jt.simulate(eight_nodes(), 1.0, solver=solver)
    except _Reached:
        pass
    finally:
        sys.setprofile(None)
    return stack[::-1]


def main() -> None:
    """Print the counts."""
    for solver in (jt.ForwardEuler(), None):
        hops = hops_to_update(solver)
        files = {hop.partition(" (")[2] for hop in hops}
        name = "the default solver" if solver is None else type(solver).__name__
        print(f"{len(hops) - 1} hops in {len(files)} files, {name}:")
        print("  " + "\n  ".join(hops))
    scene = eight_nodes()
    jt.forget_findings()
    compiling = entered_files(lambda: jt.compile_scene(scene))
    print(f"compile_scene: {len(compiling)} files")
    print("  " + "\n  ".join(compiling))
    solution = jt.simulate(scene, 1.0)
    camera = jt.Camera((0.1, 0.02, 0.03), (0.0, 0.0, 0.0), width=16, height=12)
    drawing = entered_files(lambda: jt.render(solution, camera))
    print(f"a frame: {len(drawing)} files")
    print("  " + "\n  ".join(drawing))


if __name__ == "__main__":
    main()
