"""Residuals of frames in units of their noise: where model and data differ by more.

At the best point of a fit, independent noise of the standard deviation s leaves in the
sum of any group c of n_c residuals

    var(sum_c r) = s^2 (n_c - v_c^T A v_c),  v_c = sum_(i in c) J_i / s,

where A is the inverse of J^T J / s^2. The mean over G groups of the squared sums, each
over its variance, is then 1, and less than the quantile of chi^2_G / G. Groups of one
pixel show noise that is larger than declared; squares of pixels, whole views, and those
at all times show what is alike in space or in time, which moves values by more than
noise of the same size. The largest of these means is the factor by which the variances
of the values are larger than those from the noise.

A group of few pixels may be lost in the mean: one is told where its sum is larger than
noise leaves in any of them, and moves a value by a part of its standard error.

Sources: Kish, Survey Sampling (Wiley 1965), for the design effect; Belsley, Kuh,
Welsch, Regression Diagnostics (Wiley 1980), 2.1, for sums at the best point and for the
influence of a group on a value.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import chi2, norm

from jaxthermo.report.numbers import count, padded

from ..config.fit_record import ResidualScale
from ..problem.problem import Problem
from ..problem.targets import CaseError, FrameTarget


_RARE = 1e-4
"""Probability that noise alone exceeds what counts as allowed, in each test."""
_UNCERTAIN_NOISE = 1.25
"""Factor up to which a declared noise counts as right: few are known better."""
_MAX_INFLUENCE = 0.5
"""Change of a value [standard error] by one group of residuals that is not noise."""
_MIN_LEFT = 0.01
"""Part of a sum's variance that the fit leaves, below which a group tells nothing."""


class Misfit(NamedTuple):
    """Residuals of a fit to frames, compared with their noise."""

    scales: tuple[ResidualScale, ...] = ()
    differences: tuple[str, ...] = ()
    """Sentences on differences between model and data; none that the noise allows."""
    widening: float = 1.0
    """Factor on standard errors that follow from independent noise."""
    times_noise_of_clusters: float = 1.0
    """Sums of the residuals of clusters, over what noise leaves in them."""


class _Residuals(NamedTuple):
    """Residuals of data at the best point, in standard deviations of the noise."""

    errors: Float[np.ndarray, " r"]
    slopes: Float[np.ndarray, "p r"]
    """Rows of the transposed Jacobian."""
    inverse: Float[np.ndarray, "p p"]
    """Covariance of the coordinates by independent noise."""

    def deviations(self, group: Int[np.ndarray, " r"]) -> Float[np.ndarray, " g"]:
        """Sums of groups, each over its standard deviation by noise."""
        size = np.bincount(group)
        total = np.bincount(group, self.errors)
        slope = np.stack([np.bincount(group, row) for row in self.slopes])
        variance = size - (slope * (self.inverse @ slope)).sum(axis=0)
        # Of groups that the fit absorbs nothing is left to compare.
        tells = variance > _MIN_LEFT * size
        return total[tells] / np.sqrt(variance[tells])

    def outliers(self) -> dict[int, float]:
        """Residuals that noise does not reach and that move a value [sd], by number."""
        moved = self.inverse @ self.slopes
        variance = np.maximum(1 - (self.slopes * moved).sum(axis=0), _MIN_LEFT)
        deviation = self.errors / np.sqrt(variance)
        standard_error = np.sqrt(np.maximum(np.diag(self.inverse), 1e-300))
        change = np.abs(moved) * np.abs(self.errors / variance)
        influence = (change / standard_error[:, None]).max(axis=0)
        limit = norm.isf(0.5 * _RARE / len(deviation))
        is_outlier = (np.abs(deviation) > limit) & (influence > _MAX_INFLUENCE)
        return {int(n): float(deviation[n]) for n in np.flatnonzero(is_outlier)}


def find_misfit(
    problem: Problem,
    rows: Float[np.ndarray, "p r"],
    residual: Float[np.ndarray, " r"],
) -> Misfit:
    """Compare the residuals of a fit's best point with the noise.

    `rows` are those of the transposed Jacobian. References have no noise: nothing
    differs there.
    """
    sd = problem.known_sd
    pixels = problem.clusters(edge=1, through_time=False)
    if sd is None or pixels is None:
        return Misfit()
    data = len(pixels)
    information = (rows / sd) @ (rows / sd).T
    residuals = _Residuals(
        errors=residual[:data] / sd,
        slopes=rows[:, :data] / sd,
        inverse=np.linalg.pinv(information, rcond=1e-10, hermitian=True),
    )
    scales: list[ResidualScale] = []
    for through_time in (False, True):
        for edge in problem.edges:
            group = problem.clusters(edge=edge, through_time=through_time)
            assert group is not None
            deviation = residuals.deviations(group)
            number = len(deviation)
            if number:
                scale = ResidualScale(
                    pixels=edge,
                    through_time=through_time,
                    groups=number,
                    times_noise=float(np.sqrt(np.mean(deviation**2))),
                    allowed=float(np.sqrt(chi2.isf(_RARE, number) / number)),
                )
                scales.append(scale)
    clusters = problem.clusters()
    assert clusters is not None
    of_clusters = residuals.deviations(clusters)
    beyond = [s for s in scales if s["times_noise"] > s["allowed"]]
    differing = [s for s in beyond if s["times_noise"] > _UNCERTAIN_NOISE]
    # Noise that is larger is so in all means, which then count for what is alike.
    pixel_noise = max([1.0, *(s["times_noise"] for s in beyond if s is scales[0])])
    alike = [s for s in beyond if s["times_noise"] > s["allowed"] * pixel_noise]
    widening = max([pixel_noise, *(s["times_noise"] for s in alike)])
    return Misfit(
        scales=tuple(scales),
        differences=(
            *_scale_words(differing, whole=problem.edges[-1]),
            *_outlier_words(problem, residuals.outliers()),
        ),
        widening=widening,
        times_noise_of_clusters=float(np.sqrt(np.mean(of_clusters**2))),
    )


def _scale_words(differing: list[ResidualScale], whole: int) -> list[str]:
    """Single pixels, and the means that differ the most from what noise leaves."""
    named = [s for s in differing if s["pixels"] == 1 and not s["through_time"]]
    if differing:
        worst = max(differing, key=lambda s: s["times_noise"])
        named += [worst] if worst not in named else []
    words = []
    for scale in named:
        edge = scale["pixels"]
        squares = f"means over squares of {edge} pixels"
        groups = {1: "pixels", whole: "means over whole views"}.get(edge, squares)
        if scale["through_time"]:
            groups += " and over all times" if edge > 1 else " in the mean of all times"
        words.append(f"{groups} by {padded(scale['times_noise'])} times")
    return words


def _outlier_words(problem: Problem, outliers: dict[int, float]) -> list[str]:
    if not outliers:
        return []
    worst = max(outliers, key=lambda n: abs(outliers[n]))
    first = 0
    for case in problem.cases:
        target = case.target
        assert isinstance(target, FrameTarget)
        if worst < first + target.pixel_count:
            where = f"{case.name}, {target.pixel_words(worst - first)}"
            break
        first += target.pixel_count
    number = count(len(outliers), "pixel")
    return [f"{number} by up to {padded(abs(outliers[worst]))} times, at {where}"]


def held_out_differences(
    problem: Problem, errors: Mapping[str, CaseError]
) -> tuple[str, ...]:
    """Frames that were not fitted to, and differ by more than the noise allows."""
    words = []
    for case in problem.cases:
        if not isinstance(case.target, FrameTarget):
            continue
        pixels = case.target.pixel_count // len(case.target.times)
        limit = max(float(chi2.isf(_RARE, pixels) / pixels) ** 0.5, _UNCERTAIN_NOISE)
        worst = errors[case.name].worst / 100
        if worst > limit:
            words.append(f"pixels of {case.name}, held out, by {padded(worst)} times")
    return tuple(words)


def gradient_covariance(
    problem: Problem,
    rows: Float[np.ndarray, "p r"],
    residual: Float[np.ndarray, " r"],
    misfit: Misfit,
) -> Float[np.ndarray, "p p"] | None:
    """Covariance of the gradient J^T r, from the noise and what is beyond it.

    Where there are clusters enough, residuals that are alike within them count as they
    are, see `problem.clusters`, and in addition by how much the clusters are alike.
    None where the noise is not known.
    """
    sd = problem.known_sd
    clusters = problem.clusters()
    if sd is None or clusters is None:
        return None
    data = len(clusters)
    prior = problem.prior_scatter(rows[:, data:])
    scatter = problem.scatter(rows, residual)
    if scatter is None:
        noise = sd**2 * rows[:, :data] @ rows[:, :data].T
        return misfit.widening**2 * noise + prior
    excess = misfit.widening / max(misfit.times_noise_of_clusters, 1.0)
    return max(excess, 1.0) ** 2 * (scatter - prior) + prior
