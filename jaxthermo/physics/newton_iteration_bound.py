"""How many of Newton's steps the balance at a surface needs, known before it runs.

From a start e_0 kelvin off, each step leaves at most

    e_{n+1} = c e_n^2,    c = max |q''| / (2 G),

of a flux q with that curvature above a half cell of conductance G. A metal's half cell
conducts a thousand times better than its surface radiates: there one step from the
node's temperature is exact to rounding, where a near-insulator in the sun needs all.
"""

import numpy as np

from ..arrays import is_traced
from .term import BoundTerm, TemperatureRange, Values


ALL_STEPS = 6
"""From ten times the node's temperature in a near-insulator they leave 1e-6 of q."""

KELVIN_LEFT = {"float32": 1e-5, "float64": 1e-12}
"""About one rounding of a difference of 100 K; not more than a float64 can tell."""


def newton_steps(
    half_cell: Values, terms: list[BoundTerm], reach: TemperatureRange | None
) -> int:
    """Steps from the node's temperature that solve the balance, or all there are.

    Args:
        half_cell: of each place [W/K].
        terms: that act at the surface's temperature.
        reach: what the run can get to; None if that is not known.
    """
    if reach is None or all(term.law.is_linear for term in terms):
        return ALL_STEPS
    if is_traced((half_cell, terms)):
        return ALL_STEPS
    conducts = np.asarray(half_cell, float)
    flux, curvature = np.zeros_like(conducts), np.zeros_like(conducts)
    for term in terms:
        most = float(term.law.max_flux(reach))
        bent = float(term.law.curvature(reach))
        if not np.isfinite([most, bent]).all():
            return ALL_STEPS
        share = np.asarray(term.effective_area, float)
        flux += share * most
        curvature += share * bent
    acts = (flux > 0) & (conducts > 0)
    if not acts.any() or not np.isfinite(flux).all() or (flux[conducts <= 0] > 0).any():
        return ALL_STEPS
    left = flux[acts] / conducts[acts]
    rate = curvature[acts] / 2 / conducts[acts]
    aim = KELVIN_LEFT[np.asarray(half_cell).dtype.name]
    # Where the bound overflows it is of no use, and all steps are taken.
    with np.errstate(over="ignore"):
        for steps in range(1, ALL_STEPS):
            left = rate * left * left
            if left.max() < aim:
                return steps
    return ALL_STEPS
