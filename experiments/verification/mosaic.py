"""A11: the slab that a benchmark of topology optimization is checked with."""

import numpy as np

from jaxthermo.geometry.shapes import box
from jaxthermo.physics.boundary import FixedTemperature, HeatFlux
from jaxthermo.physics.heat_source import HeatSource
from jaxthermo.scene.scene import Body
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.selection import Region
from jaxthermo.voxels.voxelize import voxelize

from .bodies import LEFT, RIGHT
from .case import Case, Measured, Value
from .walls import solid, solve


PITCH = 2.0 / 16
"""Of 16 x 8 x 1 voxels [m]."""
FLUX = 1.0 / PITCH
"""Through x = 2: one watt in all [W/m^2]."""
COLD = 300.0
"""At x = 0, for 0 there [K]."""
FORWARD = {
    0.05: 14223.80,
    0.1: 8004.001,
    0.2: 1779.359,
    0.4: 246.3964,
    0.6: 73.80618,
    0.8: 31.22024,
    0.95: 18.65851,
}
"""Compliance by density."""
WITH_SOURCE = {
    0.1: 127.3077,
    0.25: 127.6039,
    0.5: 128.0975,
    1.0: 129.0848,
    2.0: 131.0594,
    4.0: 135.0086,
}
"""Compliance by the source's amplitude, at density 0.5."""
ROUNDING = 1e-6
"""Relative: half a unit of the seventh digit, and single precision."""


def _conductivity(density: float) -> float:
    return 1e-3 + 0.999 * density**3


def _slab():
    return voxelize(box((2.0, 1.0, PITCH)), PITCH)


def _compliance(grid, conductivity: float, sources: tuple = ()) -> float:
    """The flux times the temperature where it enters [W K]."""
    body = Body(FullVolume(grid), solid(conductivity), temperature=COLD)
    terms = (FixedTemperature(COLD, on=LEFT), HeatFlux(FLUX, on=RIGHT), *sources)
    surface = np.asarray(solve((body,), terms).surface_temperature)[0]
    right = grid.fragment_normal[:, 0] > 0.9
    return float(FLUX * grid.fragment_area[right] @ (surface[right] - COLD))


def _gaussian(grid, amplitude: float) -> tuple[HeatSource, ...]:
    """Of a exp(-r^2 / (2 0.2^2)) around the middle, a slice across x at a time.

    The compliance takes no notice of where in a slice the heat is made.
    """
    x, y = (PITCH * (np.arange(n) + 0.5) for n in grid.lattice.shape[:2])
    square = (x[:, None] - 1.0) ** 2 + (y[None] - 0.5) ** 2
    mean = (amplitude * np.exp(-square / (2 * 0.2**2))).mean(axis=1)
    left = float(grid.origin[0])
    return tuple(
        HeatSource(
            float(density),
            Region(
                lower=(left + i * PITCH, -9.0, -9.0),
                upper=(left + (i + 1) * PITCH, 9.0, 9.0),
            ),
        )
        for i, density in enumerate(mean)
    )


def measure_forward() -> Measured:
    """Seven densities."""
    grid = _slab()
    return Measured(
        tuple(
            Value(
                f"compliance, density {density:g}",
                "W K",
                listed,
                _compliance(grid, _conductivity(density)),
                ROUNDING * listed,
            )
            for density, listed in FORWARD.items()
        )
    )


def measure_source() -> Measured:
    """Six amplitudes of a source inside."""
    grid = _slab()
    k = _conductivity(0.5)
    return Measured(
        tuple(
            Value(
                f"compliance, amplitude {amplitude:g}",
                "W K",
                listed,
                _compliance(grid, k, _gaussian(grid, amplitude)),
                ROUNDING * listed,
            )
            for amplitude, listed in WITH_SOURCE.items()
        )
    )


CASES = (
    Case(
        "A11",
        "Mosaic thermal-mesh: a uniform slab by its density",
        "mosaic, thermal_mesh forward_agreement (single precision, 7 digits)",
        "none stated; 1e-6 relative, its digits",
        "16 x 8 x 1 voxels; steady",
        measure_forward,
    ),
    Case(
        "A11, source",
        "the same with a Gaussian source inside",
        "mosaic, thermal_mesh (single precision, 7 digits)",
        "none stated; 1e-6 relative, its digits",
        "16 x 8 x 1 voxels, a source for each of 16 slices; steady",
        measure_source,
    ),
)
