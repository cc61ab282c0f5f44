"""A metal plate under a radiant heater, then cooling in still air.

A plate thermometer, Inconel of 0.79 mm on ceramic wool of 25.4 mm, 100 mm square, looks
up at a cone heater of 25 or 75 kW/m^2 (repository firemodels/exp of the NIST, SP_AST,
commit 39d8b735). Its layers and their properties by temperature are those of the input
files of FDS (firemodels/fds, Validation/SP_AST); the emissivity is the 0.9 of one of
both files, where the other has 0.85. Heat that leaves by the sides of the wool is left
out, so that half of the plate stands for all of it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

import jaxthermo as jt
from jaxthermo.constants import ZERO_CELSIUS


_PITCH = 25.4e-3 / 8  # [m]
_METAL = 0.79e-3  # [m]
_SIDE = 16
"""Voxels along the sides of the computed part, half of the plate's."""
_LENGTH = 0.025  # [m]
"""Area over perimeter of the plate."""
_STEP = 2.5  # [s]
_EMISSIVITY = 0.9


class _Exposure(NamedTuple):
    """Measured temperatures of a plate, with the heater on and then away."""

    irradiance: float
    """[W/m^2]"""
    off: float
    """Time at which the heater is taken away [s]."""
    time: tuple[float, ...]
    """[s]"""
    celsius: tuple[float, ...]
    """[degC]"""

    @property
    def steady(self) -> int:
        """Index of the last time before the heater is taken away."""
        return int(np.searchsorted(self.time, self.off)) - 1


WEAK = _Exposure(
    25e3,
    off=1305.0,
    time=(
        *(15, 30, 60, 120, 180, 240, 300, 600, 1200),
        *(1320, 1380, 1440, 1500, 1560, 1680, 1800, 1980),
    ),
    celsius=(
        *(86.9, 154.3, 260.0, 385.7, 438.0, 458.8, 469.1, 480.1, 481.0),
        *(425.3, 285.2, 211.2, 165.8, 133.7, 90.6, 64.6, 43.2),
    ),
)
STRONG = _Exposure(
    75e3,
    off=1157.0,
    time=(15, 30, 60, 120, 180, 240, 300, 600, 1140, 1200, 1260, 1320, 1380, 1440),
    celsius=(
        *(203.3, 383.1, 612.7, 734.5, 750.1, 754.7, 756.8, 758.8, 761.5),
        *(472.8, 316.8, 237.0, 185.8, 149.8),
    ),
)
AIR = 23.9 + ZERO_CELSIUS  # [K]


def _property(celsius: tuple[float, ...], values: tuple[float, ...]) -> jt.Property:
    return jt.Property(np.array(celsius) + ZERO_CELSIUS, values)


INCONEL_HEAT_CAPACITY = _property(
    (20.0, 100.0, 300.0, 500.0, 600.0, 900.0),
    (444.0, 465.0, 502.0, 536.0, 578.0, 628.0),
)
WOOL = jt.Material(
    _property((260.0, 400.0, 800.0, 1000.0), (0.06, 0.10, 0.20, 0.27)),
    density=128.0,
    specific_heat=1130.0,
)


def scene(exposure: _Exposure) -> jt.Scene:
    """Plate and wool as one solid, whose sides and bottom exchange no heat.

    The metal is a layer of voxels of its mass; its resistance is negligible.
    """
    solid = np.ones((_SIDE, _SIDE, 9), bool)
    labels = np.ones(solid.shape, int)
    labels[..., -1] = 0
    metal = jt.Material(
        20.0,
        density=8470.0 * _METAL / _PITCH,
        specific_heat=INCONEL_HEAT_CAPACITY,
        emissivity=_EMISSIVITY,
    )
    body = jt.Body(
        jt.FullVolume(jt.grid_from_voxels(solid, _PITCH)),
        jt.MaterialLabels(labels, (metal, WOOL)),
        temperature=AIR,
    )
    top = jt.Side((0.0, 0.0, 1.0))
    terms = (
        jt.Sun((0.0, 0.0, -1.0), jt.Until(exposure.irradiance, exposure.off), on=top),
        jt.Surroundings(AIR, on=top),
        jt.FreeConvection(AIR, length=_LENGTH, body_shape="plate", on=top),
    )
    return jt.Scene((body,), terms, dtype="float64")


def errors(exposure: _Exposure) -> Float[np.ndarray, " t"]:
    """Computed less measured temperatures at the times of an exposure [K]."""
    plate = scene(exposure)
    solver = jt.SuperTimeStepping(dt=_STEP)
    saves = [float(time) for time in exposure.time]
    solution = jt.simulate(plate, saves[-1], saves, solver=solver)
    normal = plate.bodies[0].structure.grid.fragment_normal
    top = np.flatnonzero(normal[:, 2] > 0.5)
    computed = np.asarray(solution.surface_temperature)[:, top].mean(axis=1)
    return computed - ZERO_CELSIUS - np.array(exposure.celsius)
