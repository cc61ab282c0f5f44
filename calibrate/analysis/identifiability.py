"""What a fit is worth: standard errors, and a verdict for every parameter and pair.

From the Jacobian J of the misfits by the free numbers, at the point that was found, and
the standard deviation s of a misfit: the covariance is s^2 (J^T J)^-1, if the misfits
are independent. Those of a model against a full volume are not; there s is what the fit
left over, and the errors say which parameters are told best, not how near they are to a
truth.

| verdict | when |
|---|---|
| dead | nothing changes with it: its column is below 1e-6 of the largest |
| flat | it lies in a direction of a singular value below 1e-3 of the largest |
| not pinned | its standard error is wider than its bounds, or than a factor of e |
| at bound | it ended within 1 % of the way to a bound |
| trade-off | it is correlated by more than 0.95 with another |
| fine | none of these |
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..problem.parameters import ParameterSet


DEAD, FLAT, TRADED, NEAR = 1e-6, 1e-3, 0.95, 0.01
INVOLVED = 0.3
"""Of a flat direction's length, that makes a parameter part of it."""


class Verdict(NamedTuple):
    """Of one free number."""

    label: str
    verdict: str
    value: float
    standard_error: float | None
    """Of the value; None if it is not told by the data."""
    with_others: tuple[str, ...] = ()
    """Those that it trades with, or is flat with."""


class Identified(NamedTuple):
    """Of all free numbers together."""

    verdicts: tuple[Verdict, ...]
    correlation: Float[np.ndarray, "p p"]
    """0 beside what is dead or flat."""
    singular_values: Float[np.ndarray, " p"]
    """Over the largest, after columns are scaled to the same length."""


def identify(
    parameters: ParameterSet,
    z: Float[np.ndarray, " p"],
    jacobian: Float[np.ndarray, "p r"] | None,
    sd: float,
) -> Identified:
    """Judge every free number at a point.

    Args:
        parameters: of the fit.
        z: the free numbers.
        jacobian: of the misfits, a row a free number; None where there are too many.
        sd: standard deviation of a misfit.
    """
    if jacobian is None:
        return _not_judged(parameters, z)
    rows = np.asarray(jacobian, float)
    gram = rows @ rows.T
    norms = np.sqrt(np.diag(gram))
    largest = norms.max(initial=0.0)
    alive = norms > DEAD * largest if largest > 0 else np.zeros(len(norms), bool)
    scaled = gram[np.ix_(alive, alive)] / np.outer(norms[alive], norms[alive])
    powers, directions = np.linalg.eigh(scaled) if alive.any() else _nothing()
    singular = np.sqrt(np.maximum(powers, 0))
    flat = singular < FLAT * singular.max(initial=0.0)
    involved = np.zeros((len(norms), len(norms)), bool)
    number = np.flatnonzero(alive)
    for direction in directions[:, flat].T:
        members = number[np.abs(direction) > INVOLVED]
        involved[np.ix_(members, members)] = True
    told = alive & ~involved.any(axis=1)
    covariance = _covariance(gram, told, sd)
    deviation = np.sqrt(np.diag(covariance))
    outer = np.outer(deviation, deviation)
    correlation = np.divide(
        covariance, outer, out=np.zeros_like(covariance), where=outer > 0
    )
    slope = value_slopes(parameters, z)
    values = np.asarray(parameters.flat_values(z), float)
    labels, verdicts = parameters.labels, []
    for n, label in enumerate(labels):
        kind, others = _judged(n, alive, involved, correlation)
        error = float(deviation[n] * abs(slope[n])) if told[n] else None
        lower, upper = _bounds(parameters)[n]
        if kind == "fine" and error is not None:
            wide = upper - lower if np.isfinite(upper - lower) else np.inf
            if error > wide or deviation[n] > 1 and not _by_size(lower, upper):
                kind = "not pinned"
            elif _at_bound(values[n], lower, upper):
                kind = "at bound"
        names = tuple(labels[m] for m in others)
        verdicts.append(Verdict(label, kind, float(values[n]), error, names))
    spread = np.sort(singular)[::-1] / max(singular.max(initial=0.0), 1e-300)
    return Identified(tuple(verdicts), correlation, spread)


def _not_judged(parameters: ParameterSet, z: Float[np.ndarray, " p"]) -> Identified:
    """Of more values than there is a Jacobian of."""
    values = np.asarray(parameters.flat_values(z), float)
    pairs = zip(parameters.labels, values, strict=True)
    verdicts = tuple(Verdict(n, "not judged", float(v), None) for n, v in pairs)
    return Identified(verdicts, np.zeros((0, 0)), np.zeros(0))


def _nothing():
    return np.zeros(0), np.zeros((0, 0))


def _by_size(lower: float, upper: float) -> bool:
    """Whether z is in the value's own size, and no logarithm."""
    return not np.isfinite(lower) and not np.isfinite(upper)


def _covariance(gram, told, sd):
    """Of the told numbers, the others left out as if they were known."""
    found = np.zeros_like(gram)
    if told.any():
        part = gram[np.ix_(told, told)]
        scale = 1 / np.sqrt(np.diag(part))
        inner = np.linalg.inv(part * np.outer(scale, scale))
        found[np.ix_(told, told)] = sd**2 * inner * np.outer(scale, scale)
    return found


def _judged(n, alive, involved, correlation):
    if not alive[n]:
        return "dead", ()
    if involved[n].any():
        return "flat", tuple(m for m in np.flatnonzero(involved[n]) if m != n)
    strong = np.abs(correlation[n]) > TRADED
    strong[n] = False
    if strong.any():
        return "trade-off", tuple(np.flatnonzero(strong))
    return "fine", ()


def _bounds(parameters: ParameterSet) -> list[tuple[float, float]]:
    return [(p.lower, p.upper) for p in parameters.parameters for _ in p.labels]


def _at_bound(value: float, lower: float, upper: float) -> bool:
    ends = np.array([lower, value, upper])
    if lower > 0:
        ends = np.log(ends)
    low, here, high = ends
    if not np.isfinite(high - low):
        return False
    return bool(min(here - low, high - here) < NEAR * (high - low))


def value_slopes(
    parameters: ParameterSet, z: Float[np.ndarray, " p"]
) -> Float[np.ndarray, " p"]:
    """How each value changes with its free number."""
    ones = np.ones_like(z)
    _, slopes = jax.jvp(parameters.flat_values, (z,), (ones,))
    return np.asarray(slopes, float)


def left_over(
    residual: Float[np.ndarray, " r"], free: int, known: float | None
) -> float:
    """Standard deviation of a misfit: as known, or what a fit left over.

    Args:
        residual: misfits at the point.
        free: how many numbers were fitted.
        known: from the noise of the data.
    """
    if known is not None:
        return known
    spare = max(len(residual) - free, 1)
    return float(np.sqrt((np.asarray(residual, float) ** 2).sum() / spare))


def information_gain(
    jacobian: Float[np.ndarray, "p r"],
    further: Float[np.ndarray, "p q"],
    sd: float,
) -> float:
    """How much more a further run would tell, as half the gain of log det [nats].

    D-optimality: the volume of the confidence region shrinks by exp of this.

    Args:
        jacobian: of what is fitted.
        further: of the run that might be added.
        sd: standard deviation of a misfit.

    Source: Pukelsheim, Optimal Design of Experiments (SIAM 2006), chapter 6.
    """
    have, more = np.asarray(jacobian, float), np.asarray(further, float)
    # So little is known of a dead parameter that anything is a gain: a unit prior in
    # free numbers keeps that finite.
    before = have @ have.T / sd**2 + np.eye(len(have))
    after = before + more @ more.T / sd**2
    return float(0.5 * (np.linalg.slogdet(after)[1] - np.linalg.slogdet(before)[1]))
