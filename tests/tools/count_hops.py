"""Count what a reader walks through: calls to a temperature, and files entered.

    python tests/tools/count_hops.py

It prints counts of a scene of eight nodes with sun, convection and surroundings:

- the *hops* from `simulate()` to the update of a temperature: the functions of
  jaxthermo on Python's stack when the network of conduction is first asked for an
  explicit step, while the loop is traced. A hop is a call of one of our functions by
  another one, whatever libraries lie between; a comprehension or generator counts with
  the function that it is written in, an attribute access of a module does not count;
- the files of jaxthermo that `compile_scene` enters, by `sys.setprofile`: those of
  which any function runs, the file of `compile_scene` included. What earlier calls
  have stored is forgotten, and nothing is read from the user's cache;
- the files that a frame of the solution enters in the same way, by `render`: in a new
  view, and in the same view again. Modules are imported before;

and of a fit of one weight of blocks:

- the hops from `fit_config` to each goal of that weight: to the parameter that it
  becomes when the config is read, to the operator of conduction that takes it while the
  residuals are traced, and to the first use of that operator.
"""

import inspect
import os
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any


os.environ["JAXTHERMO_CACHE"] = "off"

import jax  # noqa: E402
import numpy as np  # noqa: E402

import calibrate  # noqa: E402
import jaxthermo as jt  # noqa: E402
from calibrate.run import fit_config  # noqa: E402
from jaxthermo.network.link_operator import RowNetwork  # noqa: E402
from jaxthermo.network.network import AbstractNetwork  # noqa: E402


PACKAGE = Path(inspect.getfile(jt)).parent
CALIBRATE = Path(inspect.getfile(calibrate)).parent
SCENE = """
bodies:
  - shape: {kind: sphere, radius: 0.1 m}
    voxels_high: 8
    surface_cells: dominant_axis
    structure: {kind: aggregate, factor: 2}
    material: {conductivity: 16, density: 8000, specific_heat: 500, absorptivity: 1}
    temperature: 293.15
terms:
  - {kind: sun, direction: [-1, 0, 0], irradiance: 5000}
time: {end: 60, save_at: [30, 60]}
"""
FIT = """
scene: scene.yaml
train: [{name: "+x"}]
parameters: [{name: weights.within}]
"""
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
    """Path of a frame's file within jaxthermo or calibrate; empty for other files."""
    path = Path(frame.f_code.co_filename)
    if path.is_relative_to(PACKAGE):
        return str(path.relative_to(PACKAGE))
    if path.is_relative_to(CALIBRATE):
        return str(path.relative_to(CALIBRATE.parent))
    return ""


def stack_of(frame: FrameType) -> list[str]:
    """Our functions from the first one to that of a frame, each with its file."""
    stack: list[str] = []
    step: FrameType | None = frame
    while step is not None:
        name = step.f_code.co_name
        if own_file(step) and name not in _INNER:
            stack.append(f"{name} ({own_file(step)})")
        step = step.f_back
    return stack[::-1]


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
        stack.extend(stack_of(frame))
        raise _Reached

    sys.setprofile(profile)
    try:
        jt.simulate(eight_nodes(), 1.0, solver=solver)
    except _Reached:
        pass
    finally:
        sys.setprofile(None)
    return stack


def hops_of_a_weight() -> dict[str, list[str]]:
    """Functions from `fit_config` to the goals of a fitted weight, by goal."""
    stacks: dict[str, list[str]] = {}
    is_traced = False

    def goal_of(frame: FrameType) -> str:
        owner = type(frame.f_locals.get("self"))
        match frame.f_code.co_name:
            case "__post_init__" if owner.__name__ == "Parameter":
                return "parameter"
            case "row_network" if is_traced:
                return "operator"
            case "heat_rate" if is_traced and owner is RowNetwork:
                return "use of the operator"
        return ""

    def profile(frame: FrameType, event: str, argument: object) -> None:
        nonlocal is_traced
        if event != "call" or not own_file(frame):
            return
        if frame.f_code.co_name == "residuals" and not is_traced:
            is_traced = True
            # Functions that were traced for the steps would not be entered again.
            jax.clear_caches()
        goal = goal_of(frame)
        if goal:
            stacks.setdefault(goal, stack_of(frame))
        if goal == "use of the operator":
            raise _Reached

    with TemporaryDirectory() as folder:
        (Path(folder) / "scene.yaml").write_text(SCENE)
        (Path(folder) / "fit.yaml").write_text(FIT)
        sys.setprofile(profile)
        try:
            fit_config(Path(folder) / "fit.yaml", Path(folder) / "out")
        except _Reached:
            pass
        finally:
            sys.setprofile(None)
    return stacks


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
    first, second = (
        jt.Camera((0.1, 0.02, z), (0.0, 0.0, 0.0), width=16, height=12)
        for z in (0.04, 0.03)
    )
    jt.render(solution, first)
    for view in ("a new view", "the same view again"):
        drawing = entered_files(lambda: jt.render(solution, second))
        print(f"a frame in {view}: {len(drawing)} files")
        print("  " + "\n  ".join(drawing))
    for goal, hops in hops_of_a_weight().items():
        print(f"{len(hops) - 1} hops of a fitted weight, {goal}:")
        print("  " + "\n  ".join(hops))


if __name__ == "__main__":
    main()
