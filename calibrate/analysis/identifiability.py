"""Standard errors of a fit, and a verdict for every parameter.

They follow from the Jacobian J of the residuals with respect to the coordinates, at the
best point, and the standard deviation s of a residual: the covariance is s^2 (J^T J)^-1
if the residuals are independent. Pixels of frames that a coarser model does not meet
are not: with the covariance B of the gradient J^T r, from residuals that are alike in
clusters (`problem.clusters`), it is the sandwich

    (J^T J)^-1 B (J^T J)^-1.

Residuals of a model against a full volume have no clusters; there s is what the fit
left over, and the errors rank the parameters without bounding their distance from a
truth.

Source of the sandwich: White, Econometrica 50 (1982) 1-25.

| verdict | condition |
|---|---|
| dead | no effect: its column of J is below 1e-6 of the largest |
| flat | in a direction whose singular value is below 1e-3 of the largest |
| at bound | within 1 % of the range from a bound |
| not converged | the minimum is half a standard error away, or the search was stuck |
| ambiguous | another search ended elsewhere with an error that is as small |
| trade-off | correlated by more than 0.95 with another |
| not pinned | its standard error is wider than its bounds, or than a factor of e |
| misfit | model and data differ by more than the noise allows, see `misfit` |
| fine | none of these |

The minimum of the linearized residuals is the step -(J^T J)^-1 J^T r away.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from ..problem.parameters import ParameterSet


_DEAD_NORM = 1e-6
"""Norm of a column over the largest, below which a parameter is dead."""
_FLAT_SINGULAR_VALUE = 1e-3
"""Singular value over the largest, below which a direction is flat."""
_MAX_CORRELATION = 0.95
_AT_BOUND = 0.01
"""Distance from a bound, over the range between the bounds."""
_MAX_REMAINDER = 0.5
"""Distance from the minimum over the standard error, up to which a fit converged."""
_ELSEWHERE = 4.0
"""Distance of another end over the standard error, beyond which it is another place."""
_MIN_GAIN = 0.01
"""Part of the loss that is left to gain, below which a fit without noise converged: its
standard errors fall with the number of residuals."""
_MIN_COMPONENT = 0.3
"""Component of a flat direction that makes a parameter part of it."""


class _Verdict(NamedTuple):
    """Judgement of one coordinate."""

    label: str
    verdict: str
    value: float
    standard_error: float | None
    """Standard error of the value; None if the data do not determine it."""
    with_others: tuple[str, ...] = ()
    """Parameters that it is correlated with, or flat with."""


class Identified(NamedTuple):
    """Judgement of all coordinates."""

    verdicts: tuple[_Verdict, ...]
    correlation: Float[np.ndarray, "p p"]
    """Correlation of the errors; 0 for dead or flat parameters."""
    singular_values: Float[np.ndarray, " p"]
    """Those of the Jacobian with columns of equal length, over the largest."""


def identify(
    parameters: ParameterSet,
    z: Float[np.ndarray, " p"],
    jacobian: Float[np.ndarray, "p r"] | None,
    sd: float,
    scatter: Float[np.ndarray, "p p"] | None = None,
    residual: Float[np.ndarray, " r"] | None = None,
    alternatives: Float[np.ndarray, "n p"] | None = None,
    doubt: str | None = None,
) -> Identified:
    """Judge every coordinate at a point.

    Args:
        parameters: names and bounds.
        z: coordinates of the point.
        jacobian: rows of the transposed Jacobian; None where there are too many
            coordinates.
        sd: standard deviation of a residual.
        scatter: covariance of the gradient J^T r; None without known noise, for that
            of independent residuals.
        residual: residuals at the point, where a fit ended; None where none did.
        alternatives: other points that the data do not tell from this one.
        doubt: verdict on values that would be fine, but for the fit as a whole.
    """
    values = np.asarray(parameters.flat_values(z), float)
    if jacobian is None:
        pairs = zip(parameters.labels, values, strict=True)
        judged = (
            _Verdict(label=n, verdict="not judged", value=float(v), standard_error=None)
            for n, v in pairs
        )
        return Identified(tuple(judged), np.zeros((0, 0)), np.zeros(0))
    gram = np.asarray(jacobian, float) @ np.asarray(jacobian, float).T
    directions = _flat_directions(gram)
    determined = directions.alive & ~directions.flat.any(axis=1)
    noise_is_known = scatter is not None
    scatter = sd**2 * gram if scatter is None else scatter
    covariance = _covariance(gram, determined, scatter)
    deviation = np.sqrt(np.diag(covariance))
    distance = np.zeros(len(z))
    if alternatives is not None and len(alternatives):
        distance = np.abs(alternatives - z).max(axis=0)
    is_ambiguous = distance > _ELSEWHERE * deviation
    is_far = np.zeros(len(z), bool)
    if residual is not None:
        is_far = _is_far(
            jacobian,
            residual=residual,
            determined=determined,
            deviation=deviation,
            min_gain=0.0 if noise_is_known else _MIN_GAIN,
        )
    outer = np.outer(deviation, deviation)
    correlation = np.divide(
        covariance, outer, out=np.zeros_like(covariance), where=outer > 0
    )
    _, slopes = jax.jvp(parameters.flat_values, (z,), (np.ones_like(z),))
    errors = deviation * np.abs(np.asarray(slopes, float))
    bounds = [(p.lower, p.upper) for p in parameters.parameters for _ in p.labels]
    verdicts = []
    for n, label in enumerate(parameters.labels):
        relation = _relation(n, directions=directions, correlation=correlation)
        verdict = relation.verdict
        error = float(errors[n]) if determined[n] else None
        if error is not None:
            lower, upper = bounds[n]
            precision = _precision_verdict(
                values[n], error=error, deviation=deviation[n], lower=lower, upper=upper
            )
            verdict = _graded(
                verdict,
                precision=precision,
                is_far=bool(is_far[n]),
                is_ambiguous=bool(is_ambiguous[n]),
            )
        if verdict == "fine" and doubt is not None:
            verdict = doubt
        related = relation.related if verdict == relation.verdict else ()
        judged = _Verdict(
            label=label,
            verdict=verdict,
            value=float(values[n]),
            standard_error=error,
            with_others=tuple(parameters.labels[m] for m in related),
        )
        verdicts.append(judged)
    # All may be zero, where nothing is compared that changes.
    singular = np.sort(directions.singular_values)[::-1]
    spread = singular / max(singular.max(initial=0.0), 1e-300)
    return Identified(tuple(verdicts), correlation, spread)


class _Directions(NamedTuple):
    """Effect of the coordinates on the residuals."""

    alive: Bool[np.ndarray, " p"]
    """True for coordinates that have an effect."""
    flat: Bool[np.ndarray, "p p"]
    """True for pairs of coordinates that share a flat direction."""
    singular_values: Float[np.ndarray, " _"]
    """Singular values of the coordinates that have an effect."""


def _flat_directions(gram: Float[np.ndarray, "p p"]) -> _Directions:
    norms = np.sqrt(np.diag(gram))
    largest = norms.max(initial=0.0)
    flat = np.zeros(gram.shape, bool)
    alive = norms > _DEAD_NORM * largest if largest > 0 else np.zeros(len(norms), bool)
    if not alive.any():
        return _Directions(alive, flat, np.zeros(0))
    # Columns of equal length, so that the units of the parameters do not matter.
    scaled = gram[np.ix_(alive, alive)] / np.outer(norms[alive], norms[alive])
    powers, directions = np.linalg.eigh(scaled)
    singular = np.sqrt(np.maximum(powers, 0))
    indices = np.flatnonzero(alive)
    is_flat = singular < _FLAT_SINGULAR_VALUE * singular.max(initial=0.0)
    for direction in directions[:, is_flat].T:
        members = indices[np.abs(direction) > _MIN_COMPONENT]
        flat[np.ix_(members, members)] = True
    return _Directions(alive, flat, singular)


def _covariance(
    gram: Float[np.ndarray, "p p"],
    determined: Bool[np.ndarray, " p"],
    scatter: Float[np.ndarray, "p p"],
) -> Float[np.ndarray, "p p"]:
    # The others are left out as if they were known.
    covariance = np.zeros_like(gram)
    if determined.any():
        block = np.ix_(determined, determined)
        # Scaled to a unit diagonal before it is inverted, for its condition number.
        scale = 1 / np.sqrt(np.diag(gram[block]))
        outer = np.outer(scale, scale)
        inverse = np.linalg.inv(gram[block] * outer)
        covariance[block] = inverse @ (scatter[block] * outer) @ inverse * outer
    return covariance


def _is_far(
    jacobian: Float[np.ndarray, "p r"],
    residual: Float[np.ndarray, " r"],
    determined: Bool[np.ndarray, " p"],
    deviation: Float[np.ndarray, " p"],
    min_gain: float,
) -> Bool[np.ndarray, " p"]:
    """Coordinates that are away from the minimum of the linearized residuals.

    By more than a part of their standard error, and where it is left to lower the loss
    by more than the part `min_gain`.
    """
    is_far = np.zeros(len(deviation), bool)
    if not determined.any():
        return is_far
    columns = np.asarray(jacobian, float)[determined].T
    step, *_ = np.linalg.lstsq(columns, -np.asarray(residual, float), rcond=None)
    decrease = float(np.sum((columns @ step) ** 2))
    if decrease > min_gain * float(np.sum(np.square(residual, dtype=float))):
        is_far[determined] = np.abs(step) > _MAX_REMAINDER * deviation[determined]
    return is_far


def _graded(verdict: str, precision: str, is_far: bool, is_ambiguous: bool) -> str:
    """Verdict on a coordinate that the data determine, by how its search ended too."""
    # A value at a bound has no minimum to come to.
    if is_far:
        return "at bound" if precision == "at bound" else "not converged"
    if is_ambiguous:
        return "ambiguous"
    return precision if verdict == "fine" else verdict


class _Relation(NamedTuple):
    """Effect of a coordinate on the data, compared with that of others."""

    verdict: str
    related: tuple[int, ...] = ()
    """Numbers of those others."""


def _relation(
    n: int,
    directions: _Directions,
    correlation: Float[np.ndarray, "p p"],
) -> _Relation:
    # The strongest statement that applies comes first.
    if not directions.alive[n]:
        return _Relation("dead")
    flat = directions.flat[n]
    if flat.any():
        related = tuple(int(m) for m in np.flatnonzero(flat) if m != n)
        return _Relation("flat", related)
    strong = np.abs(correlation[n]) > _MAX_CORRELATION
    strong[n] = False
    if strong.any():
        related = tuple(int(m) for m in np.flatnonzero(strong))
        return _Relation("trade-off", related)
    return _Relation("fine")


def _precision_verdict(
    value: float, error: float, deviation: float, lower: float, upper: float
) -> str:
    # Without bounds a coordinate counts in the value's own size and is no logarithm.
    is_unbounded = not np.isfinite(lower) and not np.isfinite(upper)
    is_wide = np.isfinite(upper - lower) and error > upper - lower
    if is_wide or deviation > 1 and not is_unbounded:
        return "not pinned"
    ends = np.array([lower, value, upper])
    low, middle, high = np.log(ends) if lower > 0 else ends
    near = min(middle - low, high - middle) < _AT_BOUND * (high - low)
    return "at bound" if np.isfinite(high - low) and near else "fine"


def information_gain(
    jacobian: Float[np.ndarray, "p r"], further: Float[np.ndarray, "p q"]
) -> float:
    """Half the increase of log det J^T J that further data would add [nats].

    Residuals are in their standard deviations.
    D-optimality: the volume of the confidence region shrinks by the factor exp(gain).

    Source: Pukelsheim, Optimal Design of Experiments (SIAM 2006), chapter 6.
    """
    rows = np.asarray(jacobian, float)
    added = np.asarray(further, float)
    # A unit prior keeps the gain for a dead parameter finite.
    information = rows @ rows.T + np.eye(len(rows))
    increased = information + added @ added.T
    return float(
        0.5 * (np.linalg.slogdet(increased)[1] - np.linalg.slogdet(information)[1])
    )
