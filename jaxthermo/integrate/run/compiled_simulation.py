"""`compile_simulation`: a run that is compiled once, for scenes with other numbers."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ...alike_lines import grouped_lines
from ...errors import InputError, require
from ...scene.compile.traced_scene import changed_constants
from ...scene.scene import Body, Scene
from ..solvers import AbstractSolver
from .plan import Plan, plan_run, with_note, without_searches
from .simulate import compile_plan, run_plan
from .solution import Solution, finished


@dataclass(frozen=True, eq=False)
class CompiledSimulation:
    """A compiled run of one scene, from `compile_simulation`.

    Called without a scene it runs that one again, which costs its steps and the reading
    of its surface. Called with another scene it runs that, with other numbers in arrays
    of the same shapes: materials, weights, coefficients, temperatures, irradiances and
    tables. They cost no compilation and no search in geometry, but for what moved or
    lights up another part: `Solution.receipt.searches` lists what was searched again.
    A number that becomes 0 or 1, or was that, changes what is compiled; a note of the
    receipt says so.
    """

    scene: Scene
    """The scene that it was compiled for."""
    plan: Plan
    """Its steps and arrays."""
    t1: float | int
    save_at: tuple[float, ...] | None
    solver: AbstractSolver | None
    reverse_memory: int | None

    def __call__(self, scene: Scene | None = None, *, throw: bool = True) -> Solution:
        """Run the scene, or another one of the same shapes.

        It may be jitted, mapped and differentiated with respect to the numbers of the
        other scene, as `simulate`, with the same restrictions.

        Raises:
            InputError: in one line, where the other scene differs by more than numbers,
                poses and directions.
            RuntimeError: if the run failed and `throw` is set.
        """
        if scene is None:
            plan = self.plan
        else:
            require(
                scene,
                classes=Scene,
                argument="CompiledSimulation(scene=)",
                give="a Scene",
            )
            _check_alike(self.scene, scene)
            plan = _planned(
                scene,
                t1=self.t1,
                save_at=self.save_at,
                solver=self.solver,
                reverse_memory=self.reverse_memory,
            )
            if not scene.is_traced:
                for line in changed_constants(self.scene, scene):
                    plan = plan._replace(compiled=with_note(plan.compiled, line))
        with plan.scene.precision:
            solution = run_plan(plan)
        for warning in grouped_lines(solution.run.warnings):
            warnings.warn(warning, stacklevel=2)
        return finished(solution, throw)


def compile_simulation(
    scene: Scene,
    t1: float | int,
    save_at: Sequence[float] | None = None,
    *,
    solver: AbstractSolver | None = None,
    reverse_memory: int | None = None,
) -> CompiledSimulation:
    """Compile the run of a scene, for that scene and others of the same shapes.

    The equations, arguments, units and errors are those of `simulate`, and so are the
    results: a run of the compiled simulation equals `simulate` of the same scene bit
    for bit. Steps follow from each scene's numbers.

    Returns:
        A function of a scene, `CompiledSimulation`, that returns its `Solution`.

    Raises:
        InputError: as `simulate`; also for a scene of traced values: compile for known
            ones, and call the result with traced values.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> def scene(coefficient):
        ...     body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], 350.0)
        ...     return jt.Scene((body,), (jt.Convection(coefficient, 290.0),))
        >>> run = jt.compile_simulation(scene(10.0), 60.0)
        >>> slow, fast = run(), run(scene(20.0))
        >>> bool(fast.mean_temperature[0, 0] < slow.mean_temperature[0, 0])
        True
        >>> fast.receipt.searches
        ()
    """
    require(scene, classes=Scene, argument="compile_simulation(scene=)", give="a Scene")
    if scene.is_traced:
        raise InputError(
            "compile_simulation: values of the scene are traced: compile it for known "
            "values, and call the result with traced ones"
        )
    saves = None if save_at is None else tuple(save_at)
    plan = _planned(
        scene, t1=t1, save_at=saves, solver=solver, reverse_memory=reverse_memory
    )
    for warning in grouped_lines(plan.compiled.receipt.warnings):
        warnings.warn(warning, stacklevel=2)
    with scene.precision:
        compile_plan(plan)
    return CompiledSimulation(
        scene=scene,
        plan=without_searches(plan),
        t1=t1,
        save_at=saves,
        solver=solver,
        reverse_memory=reverse_memory,
    )


def _planned(scene, t1, save_at, solver, reverse_memory) -> Plan:
    with scene.precision:
        return plan_run(
            scene,
            t1=t1,
            save_at=save_at,
            solver=solver,
            reverse_memory=reverse_memory,
            control_error=True,
        )


def _check_alike(original: Scene, changed: Scene) -> None:
    """Refuse a scene that differs by more than numbers, poses and directions."""
    differs = _difference(original, changed)
    if differs:
        raise InputError(
            f"CompiledSimulation: {differs}: compile that scene by itself, with "
            "compile_simulation or simulate"
        )


def _difference(original: Scene, changed: Scene) -> str:
    """First difference of two scenes, in words; empty if there is none."""
    for property_name, a, b in (
        ("bodies", len(original.bodies), len(changed.bodies)),
        ("terms", len(original.terms), len(changed.terms)),
        ("probes", len(original.probes), len(changed.probes)),
        ("dtype", original.dtype, changed.dtype),
        ("surface_outputs", original.surface_outputs, changed.surface_outputs),
    ):
        if a != b:
            return f"{property_name} is {b} instead of {a}"
    for n, (first, second) in enumerate(
        zip(original.bodies, changed.bodies, strict=True)
    ):
        differs = _body_difference(first, second)
        if differs:
            return f"bodies[{n}]{differs}"
    for n, (first, second) in enumerate(
        zip(original.terms, changed.terms, strict=True)
    ):
        if type(first) is not type(second):
            return (
                f"terms[{n}] is a {type(second).__name__} instead of a "
                f"{type(first).__name__}"
            )
        differs = _other_shapes(first, second)
        if differs:
            return f"terms[{n}], {second.name},{differs}"
    return ""


def _body_difference(original: Body, changed: Body) -> str:
    a = original.structure
    b = changed.structure
    if type(a) is not type(b) or a.node_count != b.node_count:
        return (
            f".structure is {type(b).__name__} of {b.node_count} nodes instead of "
            f"{type(a).__name__} of {a.node_count} nodes"
        )
    if a.link_count != b.link_count:
        return f".structure has {b.link_count} links instead of {a.link_count}"
    if a.state_shape != b.state_shape:
        return ".structure is a stencil in one of the scenes only, without weights"
    fragments = len(b.grid.fragment_area)
    original_fragments = len(a.grid.fragment_area)
    if fragments != original_fragments:
        return f".structure has {fragments} fragments instead of {original_fragments}"
    if type(original.surface_map) is not type(changed.surface_map):
        return ".surface_map is of another kind"
    if callable(original.temperature) != callable(changed.temperature):
        return ".temperature is a function in one of the scenes only"
    return _other_shapes(original.material, changed.material) and (
        ".material" + _other_shapes(original.material, changed.material)
    )


def _other_shapes(original: Any, changed: Any) -> str:
    """Name the first number of another shape, or kind of value; empty if none."""
    shapes, node_kinds = _numbers(original)
    changed_shapes, changed_kinds = _numbers(changed)
    if node_kinds != changed_kinds:
        return " has other kinds of values (a number, a table or none)"
    for (name, shape), (_, changed_shape) in zip(shapes, changed_shapes, strict=True):
        if shape != changed_shape:
            named = jax.tree_util.keystr(name)
            return f" has {named} of shape {changed_shape} instead of {shape}"
    return ""


def _numbers(tree: Any) -> tuple[list[tuple[Any, tuple[int, ...]]], list[Any]]:
    """Paths and shapes of the numbers of a pytree, and the kinds of its nodes."""
    named = jax.tree_util.tree_leaves_with_path(tree)
    number = float | int | np.ndarray | np.generic | jax.Array
    shapes = [
        (path, np.shape(leaf)) for path, leaf in named if isinstance(leaf, number)
    ]
    leaf_kinds: list[Any] = [path for path, _ in named]
    leaf_kinds += [type(leaf) for _, leaf in named if not isinstance(leaf, number)]
    return shapes, leaf_kinds
