"""What a camera sees: A17."""

import numpy as np

from jaxthermo.arrays import precision
from jaxthermo.image.camera import Camera
from jaxthermo.image.render import render
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.material.material import Material
from jaxthermo.physics.radiation.emission import Surroundings
from jaxthermo.scene.scene import Body, Scene
from jaxthermo.structures.kinds.full import FullVolume

from .bodies import bar
from .case import Case, Measured, Value


APPARENT = 296.4424


def measure_apparent() -> Measured:
    """A17: a box of 300 K in surroundings of 250 K, at the pixel that is off most."""
    grey = Material(1.0, 1000.0, 1000.0, emissivity=0.91)
    body = Body(FullVolume(bar(2, 0.1).grid), grey, temperature=300.0)
    scene = Scene((body,), (Surroundings(250.0),), dtype="float64")
    camera = Camera((1.0, -1.0, 0.5), (0.0, 0.0, 0.0), width=64, height=48)
    # The frame is in double precision, and so is what is computed from it.
    with precision("float64"):
        image = render(simulate(scene, 0.0, [0.0]), camera)
        seen = np.asarray(image.apparent_temperature)
    seen = seen[np.asarray(image.object_id) == 0]
    worst = float(seen[np.argmax(np.abs(seen - APPARENT))])
    return Measured((Value("apparent temperature", "K", APPARENT, worst, 5e-5),))


CASES = (
    Case(
        "A17",
        "ThRend: apparent temperature of a grey surface",
        "ThRend main.cpp",
        "none stated; half its last digit",
        "frame of a box of emissivity 0.91 at 300 K, 250 K around",
        measure_apparent,
    ),
)
