"""Heat flux and heat transfer coefficient of every fragment, for output."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import Time, device_array
from ...module import Module
from ...physics.surface_energy_balance import SurfaceTerms
from ..scene import Scene


class SurfaceHeat(Module):
    """Outputs of a scene for the fragments of all bodies."""

    outputs: tuple[str, ...] = eqx.field(static=True)
    """Names of the outputs in the scene, see `SURFACE_OUTPUTS`."""
    area: Float[Array, " s"]
    """[m^2]"""
    convective: tuple[int, ...] = eqx.field(static=True)
    """Numbers of the terms of convection among the surface terms."""

    def evaluate(
        self,
        terms: SurfaceTerms,
        time: Time,
        theta: Float[Array, " s"],
        by_contacts: Float[Array, " s"],
    ) -> dict[str, Float[Array, " s"]]:
        """Values of every fragment, by the name of the output.

        Args:
            terms: on the fragments, as they act above nodes of temperatures `theta`.
            time: of the loads [s].
            theta: temperatures of the nodes above the reference [K].
            by_contacts: heat rates into the fragments from other bodies [W].
        """
        values = {}
        if "heat_flux" in self.outputs:
            heat, _ = terms.rates(time, theta)
            values["heat_flux"] = (heat + by_contacts) / self.area
        if "heat_transfer_coefficient" in self.outputs:
            conductance = jnp.zeros_like(theta)
            above = theta + terms.surface_excess(time, theta)
            for number, term in terms.natural:
                if number in self.convective:
                    h = term.law.heat_transfer_coefficient(time, above)
                    conductance = conductance + jnp.asarray(term.effective_area) * h
            values["heat_transfer_coefficient"] = conductance / self.area
        return values


def surface_heat(
    scene: Scene, areas: list[Float[np.ndarray, " _"]], numbers: tuple[int, ...]
) -> SurfaceHeat | None:
    """The outputs of a scene; None if it has none.

    Args:
        scene: with the names of its outputs.
        areas: of each body's fragments [m^2].
        numbers: in the scene, of each term that acts on surfaces.
    """
    if not scene.surface_outputs:
        return None
    return SurfaceHeat(
        outputs=scene.surface_outputs,
        area=device_array(np.concatenate(areas), jnp.dtype(scene.dtype)),
        convective=tuple(
            k for k, n in enumerate(numbers) if scene.terms[n].is_convective
        ),
    )
