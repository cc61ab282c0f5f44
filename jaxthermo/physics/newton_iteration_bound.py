"""Number of Newton iterations that the balance at a surface needs, known beforehand.

From a start e_0 kelvin off, each iteration leaves at most

    e_{n+1} = c e_n^2,    c = max |q''| / (2 G),

of a flux q with that curvature above a half cell of conductance G. A metal's half cell
conducts a thousand times better than its surface radiates: there one iteration from the
node's temperature is exact to rounding, where a near-insulator in the sun needs all.
"""

import numpy as np

from ..arrays import is_traced
from .flux_law import BoundTerm, TemperatureRange, Values


MAX_ITERATIONS = 6
"""From ten times the node's temperature in a near-insulator they leave 1e-6 of q."""

TOLERANCE = {"float32": 1e-5, "float64": 1e-12}
"""About one rounding of a difference of 100 K, by the type of the state [K]."""


def newton_iterations(
    half_cell: Values, terms: list[BoundTerm], within: TemperatureRange | None
) -> int:
    """Iterations from the node's temperature that solve the balance, or the maximum.

    Args:
        half_cell: conductance of each cell [W/K].
        terms: natural terms.
        within: range of temperatures of the run; None if it is not known.
    """
    if within is None or all(term.law.is_linear for term in terms):
        return MAX_ITERATIONS
    if is_traced((half_cell, terms)):
        return MAX_ITERATIONS
    conducts = np.asarray(half_cell, float)
    flux, curvature = np.zeros_like(conducts), np.zeros_like(conducts)
    for term in terms:
        max_flux = float(term.law.max_flux(within))
        max_curvature = float(term.law.curvature(within))
        if not np.isfinite([max_flux, max_curvature]).all():
            return MAX_ITERATIONS
        area = np.asarray(term.effective_area, float)
        flux += area * max_flux
        curvature += area * max_curvature
    # A half cell without conductance gives no bound; one without flux needs none.
    acts = (flux > 0) & (conducts > 0)
    if not acts.any() or not np.isfinite(flux).all() or (flux[conducts <= 0] > 0).any():
        return MAX_ITERATIONS
    # The start is off by at most the flux over the conductance.
    error = flux[acts] / conducts[acts]
    rate = curvature[acts] / 2 / conducts[acts]
    tolerance = TOLERANCE[np.asarray(half_cell).dtype.name]
    # Where the bound overflows it is of no use, and all iterations are taken.
    with np.errstate(over="ignore"):
        for iterations in range(1, MAX_ITERATIONS):
            error = rate * error * error
            if error.max() < tolerance:
                return iterations
    return MAX_ITERATIONS
