"""How hot and how cold a scene can get: how stiff and how linear its emission is."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...arrays import is_traced
from ...constants import STEFAN_BOLTZMANN
from ...physics.boundary import HeatFlux
from ...physics.heat_source import HeatSource
from ...physics.term import TemperatureRange
from ...physics.time_varying import is_zero, smallest
from ..scene import AbstractMaterials, Body, Scene
from .bodies import PreparedBody


UNBOUNDED = 1e5
"""Where heat is released inside, no surface bounds the temperature [K]: emission is
then taken to be as steep as the half cell below it lets it be."""


def hottest(
    scene: Scene, prepared: tuple[PreparedBody, ...], end: float | int
) -> Float[Array, ""]:
    """An upper bound of temperatures up to `end` [K] where surfaces emit.

    Without imposed fluxes nothing gets hotter than the start or what terms pull to (the
    maximum principle). With them a surface that sheds the flux by emission alone does;
    where nothing emits there is no bound, and none is needed.
    """
    start = [
        one.reference + jnp.max(one.network.temperature(one.state)) for one in prepared
    ]
    drives = [term.forcing(end) for term in scene.terms]
    pulls = [drive.temperature for drive in drives]
    if any(isinstance(t, HeatSource) and not is_zero(t.values[0]) for t in scene.terms):
        pulls.append(UNBOUNDED)
    pushed = sum(jnp.maximum(drive.heat_flux, 0.0) for drive in drives)
    bound = jnp.stack([jnp.asarray(v, float) for v in (*start, *pulls)]).max()
    least = jnp.stack(
        [jnp.min(jnp.asarray(_least_emissivity(b), float)) for b in scene.bodies]
    ).min()
    shed = pushed / (STEFAN_BOLTZMANN * jnp.maximum(least, 1e-3))
    return (bound**4 + shed) ** 0.25


def reach(
    scene: Scene, prepared: tuple[PreparedBody, ...], hottest: Any, end: float | int
) -> TemperatureRange | None:
    """What surfaces can get to; None if it is not known.

    Args:
        scene: bodies and terms.
        prepared: the bodies.
        hottest: as `hottest` says.
        end: of the run [s].
    """
    values: list[Any] = [
        one.reference + jnp.min(one.network.temperature(one.state)) for one in prepared
    ]
    for term in scene.terms:
        if isinstance(term, HeatFlux | HeatSource):
            taken = smallest(term.values[0], end)
            # What takes heat out cools without bound.
            values.append(jnp.where(taken < 0, 0.0, jnp.inf))
        pulls = (getattr(term, name, None) for name in ("temperature", "ground"))
        values += [smallest(pull, end) for pull in pulls if pull is not None]
    if is_traced((values, hottest)):
        return None
    return TemperatureRange(min(float(value) for value in values), float(hottest), end)


def _least_emissivity(body: Body) -> Any:
    if isinstance(body.material, AbstractMaterials):
        return body.material.table("emissivity", float)
    return body.material.emissivity
