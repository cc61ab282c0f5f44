"""Functions of time as piecewise linear values, integrated on the host.

What a function does between the stages of a step is not seen by them. So the host, in
float64, divides the run into pieces, evaluates each at the points of Gauss, and halves
a piece until the integral and the first moment of both halves agree with its own. Then
neighbours are joined as long as one line describes both. The line of a piece has the
function's own integral and first moment in it,

    q(t) = m_0 / h + 12 m_1 (t - t_c) / h^3,    m_k = integral of (t - t_c)^k f dt,

so that steps that end at the pieces' ends bring the energy of the function whatever
their length; the energy that the lines move within a piece is at most `SHAPE` of what
passes in it. The first pieces have random lengths, about 1/8192 of the run: what is
shorter than an eighth of one may pass unseen.

Source: Lyness, Journal of the ACM 16 (1969) 483-495, for halving by two estimates.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..arrays import is_traced, precision, split_times
from .windows import PiecewiseLinear


_FIRST_PIECES = 8192
"""Number of pieces that a function is seen in at first."""

_RESOLVED = 1e-10
"""Change of an integral by halving a piece below which it is not halved, over what
varies in the whole run [-]."""

_MISSED = 1e-5
"""Integral that may remain unresolved without a warning, over what varies [-]."""

_ROUNDING = 1e-14
"""Change of an integral that is rounding, over the largest magnitude [-]."""

_MAX_PIECES = 2**16
"""Number of pieces above which none is halved."""

_MAX_HALVINGS = 45
"""Number of halvings that float64 can tell apart in a run."""

SHAPE = 1e-3
"""Integral that a line may move within a piece, over what varies in the piece [-]."""

_SMALL = 1e-6
"""Integral that a line may move anyway, over what varies in the whole run [-]."""

_MAX_KNOTS = 2**14
"""Largest number of knots: shapes are described less well instead."""

_CALL_POINTS = 2**14
"""Times of one call of the function: one shape of arrays for all of them."""

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_REACH = _POINTS[-1]
"""Part of a piece, from its centre, that its points reach [-]."""


class Tabulated(NamedTuple):
    """A function of time as lines."""

    value: PiecewiseLinear
    unresolved: float
    """Estimate of the integral of the function that its pieces miss."""
    shifted: float
    """Integral that the lines move within their pieces."""
    varying: float
    """Integral of |f - its median|."""
    shape: float
    """Integral that a line may move within a piece, over what varies in it [-]."""
    spacing: float
    """Typical distance of the times at which the function was evaluated first [s]."""

    @property
    def is_resolved(self) -> bool:
        """True if halving its pieces any further would change nothing."""
        return self.unresolved <= _MISSED * self.varying

    @property
    def is_shaped(self) -> bool:
        """True if there are enough knots for its shape between them."""
        return self.shifted <= 2 * self.shape * self.varying


class _Pieces(NamedTuple):
    """Pieces of time with integrals of a function less a constant."""

    begin: Float[np.ndarray, " n"]
    end: Float[np.ndarray, " n"]
    integral: Float[np.ndarray, " n"]
    moment: Float[np.ndarray, " n"]
    """About the middle of each piece."""
    square: Float[np.ndarray, " n"]
    """Integral of the square."""
    magnitude: Float[np.ndarray, " n"]
    """Integral of the magnitude."""
    lowest: Float[np.ndarray, " n"]
    highest: Float[np.ndarray, " n"]

    @property
    def length(self) -> Float[np.ndarray, " n"]:
        """Duration of each piece [s]."""
        return self.end - self.begin

    @property
    def residual(self) -> Float[np.ndarray, " n"]:
        """Bound of the integral of |f - line|, by Cauchy and Schwarz."""
        length = self.length
        left = self.square - self.integral**2 / length
        left = left - 12 * self.moment**2 / length**3
        return np.sqrt(np.maximum(length * left, 0))

    def selected(self, mask: Any) -> "_Pieces":
        """Some of the pieces."""
        return _Pieces(*(column[mask] for column in self))

    def joined(self, following: "_Pieces") -> "_Pieces":
        """Each piece with the one that follows it."""
        middle = (self.begin + following.end) / 2
        shift = (self.begin + self.end) / 2 - middle
        following_shift = (following.begin + following.end) / 2 - middle
        return _Pieces(
            begin=self.begin,
            end=following.end,
            integral=self.integral + following.integral,
            moment=self.moment
            + following.moment
            + shift * self.integral
            + following_shift * following.integral,
            square=self.square + following.square,
            magnitude=self.magnitude + following.magnitude,
            lowest=np.minimum(self.lowest, following.lowest),
            highest=np.maximum(self.highest, following.highest),
        )


def _together(first: _Pieces, second: _Pieces) -> _Pieces:
    order = np.argsort(np.concatenate([first.begin, second.begin]), kind="stable")
    pairs = zip(first, second, strict=True)
    return _Pieces(*(np.concatenate(pair)[order] for pair in pairs))


def tabulated(
    function: Callable[[Any], Any],
    end: float,
    cuts: tuple[float, ...],
    ends_steps: bool,
    shape: float = SHAPE,
) -> Tabulated | None:
    """Integrate a function of time from 0 to `end` [s] in float64.

    Args:
        function: of the time [s].
        end: end of the run [s].
        cuts: times at which pieces must end, as those that are saved [s].
        ends_steps: True if steps will end at the ends of the pieces.
        shape: integral that a line may move within a piece, over what varies in it [-].

    Returns:
        Its lines; None for a function that has other results than one finite number
        without a derivative.
    """
    with (
        jax.ensure_compile_time_eval(),
        precision("float64"),
        # A function may hold arrays of float32.
        jax.numpy_dtype_promotion("standard"),
    ):
        first = function(jnp.zeros((), float))
        if is_traced(first) or np.ndim(first) or not np.isfinite(first):
            return None
        vectorized = jax.vmap(lambda time: jnp.asarray(function(time), float))

        def values(times: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
            return _evaluated(vectorized, times)

        edges = _first_edges(end, cuts)
        samples = values(_times(edges[:-1], edges[1:]))
        if not np.isfinite(samples).all():
            return None
        base = float(np.median(samples))
        scale = float(np.abs(samples).max())
        pieces = _pieces(edges[:-1], edges[1:], samples - base)
        pieces, unresolved = _halved(
            pieces,
            lambda times: values(times) - base,
            rounding=_ROUNDING * scale,
            shape=shape,
        )
    if not np.isfinite(pieces.integral).all():
        return None
    varying = float(pieces.magnitude.sum())
    lines = _few(pieces, cuts=np.asarray(cuts, float), varying=varying, shape=shape)
    return Tabulated(
        value=_as_lines(lines, base, ends_steps),
        unresolved=unresolved,
        shifted=float(lines.residual.sum()),
        varying=varying,
        shape=shape,
        spacing=end / (_FIRST_PIECES * len(_POINTS)),
    )


def _evaluated(vectorized, times: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    results = []
    for begin in range(0, len(times), _CALL_POINTS):
        part = times[begin : begin + _CALL_POINTS]
        padded = np.full(_CALL_POINTS, part[0])
        padded[: len(part)] = part
        results.append(np.asarray(vectorized(jnp.asarray(padded)))[: len(part)])
    return np.concatenate(results)


def _first_edges(end: float, cuts: tuple[float, ...]) -> Float[np.ndarray, " n"]:
    # Random, but the same in every run: with equal lengths a periodic function might
    # look constant.
    jitter = np.random.default_rng(0).uniform(-0.4, 0.4, _FIRST_PIECES - 1)
    inner = (np.arange(1, _FIRST_PIECES) + jitter) * (end / _FIRST_PIECES)
    within = [time for time in cuts if 0 < time < end]
    return np.unique(np.concatenate([[0.0], inner, within, [end]]))


def _times(begin, end) -> Float[np.ndarray, " n"]:
    middle = (begin + end) / 2
    return (middle[:, None] + np.outer((end - begin) / 2, _POINTS)).reshape(-1)


def _pieces(begin, end, samples: Float[np.ndarray, " n"]) -> _Pieces:
    rows = samples.reshape(-1, len(_POINTS))
    half = (end - begin) / 2
    return _Pieces(
        begin=begin,
        end=end,
        integral=half * (rows @ _WEIGHTS),
        moment=half**2 * (rows @ (_WEIGHTS * _POINTS)),
        square=half * (rows**2 @ _WEIGHTS),
        magnitude=half * (np.abs(rows) @ _WEIGHTS),
        lowest=rows.min(axis=1),
        highest=rows.max(axis=1),
    )


def _halved(
    pieces: _Pieces, values, rounding: float, shape: float
) -> tuple[_Pieces, float]:
    """Halve pieces until their integrals stay; also estimate what remains unseen."""
    resolved: _Pieces | None = None
    unresolved = 0.0
    for halving in range(_MAX_HALVINGS):
        middle = (pieces.begin + pieces.end) / 2
        left = _pieces(pieces.begin, middle, values(_times(pieces.begin, middle)))
        right = _pieces(middle, pieces.end, values(_times(middle, pieces.end)))
        both = left.joined(right)
        change = np.abs(both.integral - pieces.integral)
        change = change + np.abs(both.moment - pieces.moment) / pieces.length
        varying = both.magnitude.sum() + (
            0.0 if resolved is None else resolved.magnitude.sum()
        )
        limit = np.maximum(_RESOLVED * varying, rounding * pieces.length)
        is_resolved = change <= limit
        # Lines must describe its shape too.
        moved = np.maximum(shape * both.magnitude, _SMALL * varying)
        is_resolved &= both.residual <= np.maximum(moved, rounding * pieces.length)
        count = 0 if resolved is None else len(resolved.begin)
        is_last = halving == _MAX_HALVINGS - 1
        if is_last or count + 2 * len(pieces.begin) > _MAX_PIECES + 2 * _FIRST_PIECES:
            unresolved = float(change[~is_resolved].sum())
            is_resolved = np.ones_like(is_resolved)
        halves = _together(left.selected(is_resolved), right.selected(is_resolved))
        resolved = halves if resolved is None else _together(resolved, halves)
        if is_resolved.all():
            break
        pieces = _together(left.selected(~is_resolved), right.selected(~is_resolved))
    assert resolved is not None
    return resolved, unresolved


def _few(
    pieces: _Pieces, cuts: Float[np.ndarray, " _"], varying: float, shape: float
) -> _Pieces:
    """Join neighbours that one line describes."""
    while True:
        joined = _joined_pieces(pieces, cuts, shape=shape, small=_SMALL * varying)
        if len(joined.begin) < _MAX_KNOTS:
            return joined
        shape *= 2


def _joined_pieces(
    pieces: _Pieces, cuts: Float[np.ndarray, " _"], shape: float, small: float
) -> _Pieces:
    parity = 0
    idle = 0
    while idle < 2 and len(pieces.begin) > 1:
        count = (len(pieces.begin) - parity) // 2
        first = slice(parity, parity + 2 * count, 2)
        second = slice(parity + 1, parity + 2 * count, 2)
        pairs = pieces.selected(first).joined(pieces.selected(second))
        limit = np.maximum(shape * pairs.magnitude, small)
        is_one = pairs.residual <= limit
        is_one &= ~np.isin(pieces.begin[second], cuts)
        keeps: Bool[np.ndarray, " n"] = np.ones(len(pieces.begin), bool)
        keeps[second] = ~is_one
        columns = []
        for column, pair in zip(pieces, pairs, strict=True):
            changed = column.copy()
            changed[first] = np.where(is_one, pair, column[first])
            columns.append(changed[keeps])
        pieces = _Pieces(*columns)
        idle = 0 if is_one.any() else idle + 1
        parity = 1 - parity
    return pieces


def _as_lines(pieces: _Pieces, base: float, ends_steps: bool) -> PiecewiseLinear:
    length = pieces.length
    mean = pieces.integral / length
    # The values at the points, as far as they reach: a line must not leave them, since
    # a negative coefficient, say, would be of another kind.
    centre = (pieces.lowest + pieces.highest) / 2
    half_range = (pieces.highest - pieces.lowest) / 2 / _REACH
    lowest = np.maximum(centre - half_range, pieces.lowest.min())
    highest = np.minimum(centre + half_range, pieces.highest.max())
    steepest = np.maximum(np.minimum(highest - mean, mean - lowest), 0)
    rise = np.clip(6 * pieces.moment / length**2, -steepest, steepest)
    # One shape for numbers of pieces that differ little; what follows the end of the
    # run is never reached.
    room = 2 ** math.ceil(math.log2(len(mean) + 1)) - len(mean)
    after = pieces.end[-1] * (1 + np.arange(1, room + 1))
    times = np.concatenate([pieces.begin, pieces.end[-1:], after])
    return PiecewiseLinear(
        times=split_times(times),
        first=np.pad(base + mean - rise, (0, room), mode="edge"),
        last=np.pad(base + mean + rise, (0, room), mode="edge"),
        ends_steps=ends_steps,
    )
