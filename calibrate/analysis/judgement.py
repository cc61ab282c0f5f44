"""Judgement of the values of a fit, by all that its data say of them."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from ..problem.problem import Problem
from ..solvers.fit import Fit
from ..solvers.noise_scale import residual_sd
from ..solvers.starts import SearchEnds
from .identifiability import Identified, identify
from .misfit import Misfit, find_misfit, gradient_covariance
from .shared_errors import shared_covariance


_STUCK = ("stalled", "at the limit of its steps")
"""Ends of a search that is at no minimum and cannot go on."""
_RARE = 1e-3
"""Probability that noise makes the true values fit worse than another end does."""


class _Judgement(NamedTuple):
    """Judgement of the values of a fit, and of the residuals that it left."""

    identified: Identified
    misfit: Misfit
    by_clusters: bool
    """True if standard errors allow for residuals that are alike."""
    elsewhere: tuple[str, ...]
    """Values, with their names, of a search that ended elsewhere and fits as well."""


def judge_values(
    problem: Problem,
    fit: Fit,
    uncertainties: Mapping[str, float],
    differences: tuple[str, ...] = (),
    ends: SearchEnds | None = None,
) -> _Judgement:
    """Judge the values of a fit.

    Args:
        problem: that was fitted.
        fit: its result.
        uncertainties: declared shared errors, see `shared_errors.declared`.
        differences: of cases that were not fitted to, see `held_out_differences`.
        ends: where searches from several starts ended.
    """
    rows = fit.jacobian
    # Without a Jacobian the residuals still tell if model and data differ.
    rows_or_zeros = np.zeros((1, len(fit.residual))) if rows is None else rows
    misfit = find_misfit(problem, rows=rows_or_zeros, residual=fit.residual)
    misfit = misfit._replace(differences=(*misfit.differences, *differences))
    scatter = None
    if rows is not None:
        scatter = gradient_covariance(
            problem, rows=rows, residual=fit.residual, misfit=misfit
        )
        if scatter is not None and uncertainties:
            scatter = scatter + shared_covariance(
                uncertainties, problem=problem, z=fit.z, rows=rows
            )
    sd = residual_sd(fit.residual, len(fit.z), problem.known_sd)
    alternatives = None if ends is None else _as_good(ends, fit=fit, sd=sd)
    identified = identify(
        problem.parameters,
        z=fit.z,
        jacobian=rows,
        sd=sd,
        scatter=scatter,
        residual=fit.residual,
        alternatives=alternatives,
        doubt=_doubt(fit, misfit),
    )
    return _Judgement(
        identified,
        misfit=misfit,
        by_clusters=rows is not None and problem.has_enough_clusters(len(rows)),
        elsewhere=_elsewhere(problem, identified, alternatives),
    )


def _doubt(fit: Fit, misfit: Misfit) -> str | None:
    """Verdict on all values that would be fine; None where none is doubtful."""
    if fit.ended in _STUCK:
        return "not converged"
    return "misfit" if misfit.differences else None


def _as_good(ends: SearchEnds, fit: Fit, sd: float) -> Float[np.ndarray, "n p"]:
    """Ends of searches whose loss noise does not tell from that of the fit."""
    # Twice the difference of two losses in units of noise is chi squared.
    max_excess = sd**2 * float(chi2.isf(_RARE, len(fit.z)))
    return ends.points[2 * (ends.losses - fit.loss) < max_excess]


def _elsewhere(
    problem: Problem,
    identified: Identified,
    alternatives: Float[np.ndarray, "n p"] | None,
) -> tuple[str, ...]:
    is_ambiguous = np.array([v.verdict == "ambiguous" for v in identified.verdicts])
    if alternatives is None or not is_ambiguous.any():
        return ()
    fitted_values = [v.value for v in identified.verdicts]
    values = np.stack([problem.parameters.flat_values(z) for z in alternatives])
    # The farthest one stands for all of them.
    distances = np.abs(values - fitted_values)[:, is_ambiguous].sum(axis=1)
    farthest = values[int(distances.argmax())]
    return tuple(
        f"{problem.parameters.labels[n]} {farthest[n]:.4g}"
        for n in np.flatnonzero(is_ambiguous)
    )
