"""Judgement of the values of a fit, by all that its data say of them."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..problem.problem import Problem
from ..solvers.fit import Fit
from .identifiability import Identified, identify, residual_sd
from .misfit import Misfit, find_misfit, gradient_covariance
from .shared_errors import shared_covariance


class Judgement(NamedTuple):
    """Judgement of the values of a fit, and of the residuals that it left."""

    identified: Identified
    misfit: Misfit
    by_clusters: bool
    """True if standard errors allow for residuals that are alike."""


def judge_values(
    problem: Problem,
    fit: Fit,
    uncertainties: Mapping[str, float],
    differences: tuple[str, ...] = (),
) -> Judgement:
    """Judge the values of a fit.

    Args:
        problem: that was fitted.
        fit: its result.
        uncertainties: declared shared errors, see `shared_errors.declared`.
        differences: of cases that were not fitted to, see `held_out_differences`.
    """
    rows = fit.jacobian
    # Without a Jacobian the residuals still tell if model and data differ.
    known_rows = np.zeros((1, len(fit.residual))) if rows is None else rows
    misfit = find_misfit(problem, rows=known_rows, residual=fit.residual)
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
    identified = identify(
        problem.parameters,
        z=fit.z,
        jacobian=rows,
        sd=residual_sd(fit.residual, len(fit.z), problem.known_sd),
        scatter=scatter,
        residual=fit.residual,
        differs=bool(misfit.differences),
    )
    by_clusters = rows is not None and problem.scatter(rows, fit.residual) is not None
    return Judgement(identified, misfit=misfit, by_clusters=by_clusters)
