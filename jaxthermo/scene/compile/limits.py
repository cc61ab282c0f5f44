"""Limits of a run that are known beforehand: temperatures, explicit step, memory."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import is_traced, require_memory
from ...constants import STEFAN_BOLTZMANN
from ...physics.flux_law import TemperatureRange
from ..scene import AbstractMaterials, Body, Scene
from .bodies import PreparedBody
from .program import Program


def max_temperature(
    scene: Scene, prepared: tuple[PreparedBody, ...], end: float | int
) -> Float[Array, ""]:
    """An upper bound of temperatures up to `end` [K] where surfaces emit."""
    # Without imposed fluxes nothing gets hotter than the start or what terms heat
    # towards (the maximum principle). With them a surface that emits the flux does;
    # where nothing emits there is no bound, and none is needed.
    start = [
        body.reference + jnp.max(body.network.temperature(body.state))
        for body in prepared
    ]
    forcings = [term.forcing(end) for term in scene.terms]
    highest = [*start, *(forcing.highest for forcing in forcings)]
    imposed = sum(jnp.maximum(forcing.heat_flux, 0.0) for forcing in forcings)
    bound = jnp.stack([jnp.asarray(v, float) for v in highest]).max()
    emissivity = jnp.stack(
        [jnp.min(jnp.asarray(_emissivities(b), float)) for b in scene.bodies]
    ).min()
    # Emissivities below 1e-3 would give no useful bound.
    emitted = imposed / (STEFAN_BOLTZMANN * jnp.maximum(emissivity, 1e-3))
    return (bound**4 + emitted) ** 0.25


def temperature_range(
    scene: Scene, prepared: tuple[PreparedBody, ...], highest: Any, end: float | int
) -> TemperatureRange | None:
    """Range of temperatures up to `end` [s]; None if values are traced."""
    lowest = [
        body.reference + jnp.min(body.network.temperature(body.state))
        for body in prepared
    ]
    lowest += [term.forcing(end).lowest for term in scene.terms]
    # The range decides how many iterations are compiled: it must be known.
    if is_traced((lowest, highest)):
        return None
    return TemperatureRange(min(float(v) for v in lowest), float(highest), end)


def _emissivities(body: Body) -> Any:
    if isinstance(body.material, AbstractMaterials):
        return body.material.table("emissivity", float)
    return body.material.emissivity


@eqx.filter_jit
def stable_step(
    program: Program, highest: Float[Array, ""], end: float
) -> Float[Array, ""]:
    """Largest stable explicit step, min C / (sum G + stiffness) [s]; or infinity.

    Args:
        program: of a scene at one snapshot.
        highest: temperature of any surface [K].
        end: of the run [s].
    """
    # Up to this step temperatures also stay within their bounds: every node's weight in
    # its own next temperature is positive.
    rates = []
    for number, body in enumerate(program.bodies):
        network = body.network
        rates.append(network.max_rate())
        loads = _stiffness(program, number, highest, end)
        if not loads:
            continue
        total = network.diagonal() * network.max_relative_conductivity()
        for address, stiffness in loads:
            total = total.at[address].add(stiffness)
        for address, _ in loads:
            capacity = network.capacity_at(address) * network.min_relative_capacity()
            rates.append((total[address] / capacity).max())
    largest = jnp.stack(rates).max()
    return jnp.where(largest > 0, 1 / jnp.where(largest > 0, largest, 1), jnp.inf)


def _stiffness(program: Program, number: int, highest, end):
    """Addresses of a body's nodes, and the conductance that loads add there [W/K]."""
    found = []
    load = program.surface
    cells = None if load is None else load.cells_of(number)
    if load is not None and cells is not None:
        relative = program.bodies[number].network.max_relative_conductivity()
        stiffness = load.stiffness(number, highest, end, relative)
        found.append((cells.address, stiffness))
    for contact in program.contacts:
        for side in (0, 1):
            if contact.bodies[side] == number:
                found.append((contact.address[side], contact.stiffness(end)))
    return found


def check_memory(scene: Scene, saves: int, snapshots: int) -> int:
    """Estimate of the solver's peak memory [bytes].

    Args:
        scene: bodies and terms.
        saves: number of times that are saved.
        snapshots: number of geometries.

    Raises:
        InputError: if it would not fit.
    """
    width = 8 if scene.dtype == "float64" else 4
    total = 0
    for body in scene.bodies:
        structure = body.structure
        cells = int(np.prod(structure.state_shape))
        fragments = len(structure.grid.fragment_area)
        copies = 4 if not isinstance(body.material, AbstractMaterials) else 12
        # Saved rows exist twice while the solution is put together.
        each = 40 * snapshots + 2 * saves
        total += cells * (copies * width + 1) + fragments * each * width
        if len(structure.state_shape) == 1:
            # A link is in two rows, with the neighbour's number and conductance.
            total += structure.link_count * (5 * width + 24)
    remedy = "use a coarser pitch, or save fewer times"
    require_memory(total, "simulating this scene", remedy)
    return total
