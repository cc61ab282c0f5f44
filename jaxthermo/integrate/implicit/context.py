"""Preconditioners, bounds and tolerances of implicit stages, made once per run."""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from ...errors import InputError
from ...network.multigrid import Hierarchy, hierarchy
from ...network.nonlinear import NonlinearNetwork
from ...scene.compile.program import Compiled, Program
from ...scene.scene import Scene
from ...structures.structure import AbstractStructure
from .deflation import Components, connected_components


LINEAR_TOLERANCE = {"float32": 1e-4, "float64": 1e-9}
"""Default residual of a linear solve at every node over its capacity [K]."""

MULTIGRID_STEP_RATIO = 30.0
"""Step over stable step above which multigrid pays: a cycle takes as long as five to
fifteen iterations with the diagonal (`experiments run multigrid`)."""


class ImplicitContext(eqx.Module):
    """Everything besides the compiled program that implicit stages share."""

    hierarchies: tuple[Hierarchy | None, ...]
    """Multigrid levels of each body; None to precondition by the diagonal."""
    components: tuple[Components, ...]
    """Connected components of each body."""
    nodes: tuple[Bool[Array, "..."] | None, ...]
    """Entries of each body's state that are nodes; None for all."""
    ceilings: tuple[Any, ...]
    """Upper bound of each body's states [K]; infinite where nothing bounds them."""
    tolerance: Any
    """Tolerance of linear solves [K]."""
    linear: bool = eqx.field(static=True)
    """True if one Newton iteration is the solution."""
    differentiable: bool = eqx.field(static=True, default=False)
    """True if derivatives may be asked for, which costs one more residual."""


def arranged_for_solves(scene: Scene) -> Scene:
    """Return the scene with its bodies stored as linear solves run fast."""
    bodies = tuple(
        replace(body, structure=body.structure.for_solves()) for body in scene.bodies
    )
    return replace(scene, bodies=bodies)


def implicit_context(
    scene: Scene,
    compiled: Compiled,
    max_dt: float,
    tolerance: float | None,
    traced: bool,
) -> ImplicitContext:
    """Prepare the implicit stages of a compiled scene.

    Raises:
        InputError: where conduction is not symmetric.
    """
    dtype, program = compiled.receipt.dtype, compiled.program
    if not all(body.network.is_symmetric for body in program.bodies):
        raise InputError(
            "a body has weights with `non_orthogonal`, whose conduction is not "
            "symmetric and cannot be solved for: step with ForwardEuler() or "
            "SuperTimeStepping(), or set non_orthogonal to 0"
        )
    stable_step = compiled.receipt.stable_step_s
    multigrid = stable_step is None or max_dt > MULTIGRID_STEP_RATIO * stable_step
    hierarchies: tuple[Hierarchy | None, ...] = tuple(
        hierarchy(body.structure, part.network) if multigrid else None
        for body, part in zip(scene.bodies, program.bodies, strict=True)
    )
    kelvin = LINEAR_TOLERANCE[dtype] if tolerance is None else tolerance
    return ImplicitContext(
        hierarchies=hierarchies,
        components=tuple(connected_components(b.structure) for b in scene.bodies),
        nodes=tuple(_node_mask(body.structure) for body in scene.bodies),
        ceilings=tuple(_ceiling(n, compiled) for n in range(len(program.bodies))),
        tolerance=jnp.asarray(kelvin, dtype),
        linear=_is_linear(program),
        differentiable=traced,
    )


def _node_mask(structure: AbstractStructure) -> Bool[Array, "..."] | None:
    # A list of nodes has no other entries; a lattice has them outside the body.
    if len(structure.state_shape) == 1:
        return None
    mask = np.zeros(structure.state_shape, bool)
    mask[structure.node_address()] = True
    return jnp.asarray(mask)


def _is_linear(program: Program) -> bool:
    load = program.surface
    varies = any(isinstance(body.network, NonlinearNetwork) for body in program.bodies)
    if program.enclosure is not None or varies:
        return False
    return load is None or load.by_cell.terms.is_linear


def _ceiling(number: int, compiled: Compiled) -> Any:
    # By the maximum principle no state exceeds the hottest temperature of the scene.
    # Without a loss at the surface Newton's iterates need no bound.
    dtype = compiled.receipt.dtype
    load, body = compiled.program.surface, compiled.program.bodies[number]
    if load is None or not load.is_dissipative(number):
        return jnp.asarray(jnp.inf, dtype)
    above = jnp.asarray(compiled.hottest, dtype) - body.reference
    return body.network.state_of(above)
