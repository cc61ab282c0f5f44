"""Frames of a run as they are compared with data: a quantity, in a band."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxthermo.arrays import Scalar
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.image.radiance.band import Band
from jaxthermo.image.radiance.draw import Moment, draw
from jaxthermo.image.surface.view import View
from jaxthermo.integrate.run.abstract_solution import irradiance_at
from jaxthermo.integrate.run.parametric_run import ParametricSolution
from jaxthermo.physics.time_varying import just_before
from jaxthermo.scene.scene import Scene


class FrameQuantity(NamedTuple):
    """Quantity of frames, and what surfaces reflect in them."""

    quantity: str
    """"temperature" as shown for an emissivity of 1 [K], or "radiance" [W/(m^2 sr)]."""
    band: Band | None = None
    """Band of the detector; None for all wavelengths."""
    reflected: Scalar | None = None
    """Temperature of a black body that surfaces reflect, with sources, instead of the
    thermal radiation of the heat balance [K]; None for that."""

    def moment(
        self,
        scene: Scene,
        solution: ParametricSolution,
        surface: Float[Array, " s"],
        time: Float[Array, ""],
    ) -> Moment:
        """State of a run at a saved time [s], with its surface temperatures [K]."""
        # As in the picture of a solution, an event at a saved time comes after it.
        instant = just_before(time)
        received = irradiance_at(solution.radiation.at(time), instant, surface)
        if self.reflected is not None:
            kelvin = jnp.asarray(self.reflected, surface.dtype)
            thermal = jnp.broadcast_to(STEFAN_BOLTZMANN * kelvin**4, surface.shape)
            received = received._replace(thermal=thermal)
        return Moment(
            surfaces=solution.surfaces,
            terms=scene.terms,
            temperature=surface,
            received=received,
            time=instant,
        )

    def frame(self, view: View, moment: Moment) -> Any:
        """Values of all pixels of a view."""
        image = draw(view, moment, self.band)
        if self.quantity == "temperature":
            return image.apparent_temperature
        return image.radiance

    def frames(
        self,
        view: View,
        scene: Scene,
        solution: ParametricSolution,
        times: tuple[float, ...],
    ) -> Float[Array, "t h w"]:
        """Values of all pixels of a view at the saved times [s]."""

        def frame(surface: Float[Array, " s"], time: Float[Array, ""]) -> Any:
            moment = self.moment(scene, solution, surface=surface, time=time)
            return self.frame(view, moment)

        kelvin = solution.surface_temperature
        return jax.vmap(frame)(kelvin, jnp.asarray(times, kelvin.dtype))
