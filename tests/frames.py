"""Frames of given temperatures, without a simulation."""

import jax.numpy as jnp
import numpy as np

from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.image.radiance.image import Image


def frame(kelvin, surface=None, body=None, time=90.0):
    """A frame that shows these apparent temperatures [K]."""
    kelvin = np.asarray(kelvin, float)
    body = np.zeros(kelvin.shape, int) if body is None else np.asarray(body)
    return Image(
        time=jnp.asarray(time),
        temperature=kelvin if surface is None else np.asarray(surface, float),
        radiance=STEFAN_BOLTZMANN / np.pi * kelvin**4,
        emissivity=np.ones(kelvin.shape),
        depth=np.where(body >= 0, 1.0, np.inf),
        object_id=body,
        normal=np.zeros((*kelvin.shape, 3)),
    )
