"""Bodies that start at the steady temperatures of their scene."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from equinox import Module
from jaxtyping import Float

from ..errors import InputError, require
from ..physics.flux_law import Values
from ..scene.body_materials import AbstractMaterials
from ..scene.scene import Body, Scene
from ..structures.kinds.air import AirVolume
from ..structures.kinds.sheet import Sheet
from .run.solution import SteadySolution, finished
from .steady import STEADY_TOLERANCE, static_scene, steady_solution


_MOST_SOLVES = 20
"""Solves of a scene whose properties follow from its start."""
_TRACED_SOLVES = 4
"""As many where values are traced, so that the change is not known."""
_SETTLED = 10.0
"""Change of the start from one solve to the next over the tolerance of a solve, below
which it has settled."""


class _NodeTemperatures(Module):
    """Initial temperatures of a body, node by node."""

    kelvin: Float[Values, " n"]

    def __call__(self, positions: Float[np.ndarray, "n 3"]) -> Float[Values, " n"]:
        """Return the temperature of each node [K]; a body asks for all at once."""
        return self.kelvin


def start_steady(
    scene: Scene,
    bodies: Sequence[int] | None = None,
    *,
    at: float = 0.0,
    tolerance: float | None = None,
) -> Scene:
    """Return a scene whose bodies start at the temperatures of its steady state.

    It is the steady state of the whole scene, see `steady`. The temperatures that the
    `bodies` had are those at which the search starts, and have no other effect.

    Args:
        scene: bodies and terms.
        bodies: numbers of the bodies that start there; None for all. Others keep the
            temperatures with which they start.
        at: time of the poses and values of the steady state [s].
        tolerance: largest distance of a node from its steady temperature [K]; None for
            that of `steady`.

    Raises:
        InputError: where there is no steady state, or one that depends on the start,
            since a body exchanges heat with nothing; for a number that is no body's.
        RuntimeError: if the steady state was not found.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=300)
        >>> terms = (jt.HeatFlux(100.0), jt.Convection(10.0, 290.0))
        >>> warm = jt.start_steady(jt.Scene((body,), terms))
        >>> solution = jt.simulate(warm, 60.0)
        >>> f"{solution.mean_temperature.item():.3f}"
        '300.000'
    """
    require(scene, classes=Scene, argument="start_steady(scene=)", give="a Scene")
    numbers = tuple(range(len(scene.bodies)) if bodies is None else bodies)
    for number in numbers:
        if number not in range(len(scene.bodies)):
            raise InputError(
                f"start_steady(bodies=): there is no body {number}; count from 0 to "
                f"{len(scene.bodies) - 1}"
            )
    with scene.precision:
        solution = finished(_solution(scene, at, tolerance), throw=True)
        isolated = {*numbers} & {*solution.isolated_bodies}
        if isolated:
            listed = ", ".join(map(str, sorted(isolated)))
            raise InputError(
                f"start_steady: body {listed} exchanges heat with nothing, so that its "
                "steady temperature is that of its start: give it a number, or a term "
                "such as Convection"
            )
        started = _starting_at(scene, solution, numbers)
        if not any(_follows_start(scene.bodies[number]) for number in numbers):
            return started
        return _settled(started, solution, numbers, at=at, tolerance=tolerance)


def _settled(
    scene: Scene,
    solution: SteadySolution,
    numbers: tuple[int, ...],
    at: float,
    tolerance: float | None,
) -> Scene:
    """The scene whose steady state, with the properties at its start, is its start."""
    is_known = not scene.is_traced
    limit = STEADY_TOLERANCE[scene.dtype] if tolerance is None else tolerance
    for _ in range(_MOST_SOLVES if is_known else _TRACED_SOLVES):
        before = solution.node_temperature
        solution = finished(_solution(scene, at, tolerance), throw=True)
        scene = _starting_at(scene, solution, numbers)
        if not is_known:
            continue
        changes = [
            np.abs(np.asarray(solution.node_temperature[n]) - before[n]).max()
            for n in numbers
        ]
        if max(changes) <= _SETTLED * limit:
            return scene
    if is_known:
        raise InputError(
            "start_steady: properties of bodies follow from their start, and their "
            f"steady state still changed after {_MOST_SOLVES} solves: give tolerance= "
            "a larger number [K]"
        )
    return scene


def _solution(scene: Scene, at: float, tolerance: float | None) -> SteadySolution:
    return steady_solution(static_scene(scene, at), at, tolerance)


def _starting_at(
    scene: Scene, solution: SteadySolution, numbers: tuple[int, ...]
) -> Scene:
    bodies = list(scene.bodies)
    for number in numbers:
        kelvin = solution.node_temperature[number]
        is_air = isinstance(bodies[number].structure, AirVolume)
        start = kelvin[0] if is_air else _NodeTemperatures(kelvin)
        bodies[number] = replace(bodies[number], temperature=start)
    return replace(scene, bodies=tuple(bodies))


def _follows_start(body: Body) -> bool:
    """True if properties of a body are those at the temperature with which it starts.

    A volume of air has its density, and half cells their conductivity.
    """
    if isinstance(body.structure, AirVolume):
        return True
    if isinstance(body.structure, Sheet):
        layers = [layer for stack in body.structure.stacks for layer in stack]
        return any(layer.material.varies for layer in layers)
    if isinstance(body.material, AbstractMaterials):
        return any(material.varies for material in body.material.materials)
    return body.material is not None and body.material.varies
