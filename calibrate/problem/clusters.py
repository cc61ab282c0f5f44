"""Residuals of a model that is not quite right: near ones are alike.

The gradient J^T r of a sum of squares is a sum over clusters of residuals, here squares
of an image at all times. Those of different clusters are taken to be independent, those
within one are not: with g_c = sum_(i in c) J_i r_i for each of G clusters,

    cov(J^T r) = G / (G - 1) sum_c g_c g_c^T.

Source: Liang, Zeger, Biometrika 73 (1986) 13-22; the factor of Stata and of Cameron,
Miller, Journal of Human Resources 50 (2015) 317-372, section II.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int


_SQUARE = 32
"""Edge of the squares of an image that count as one cluster [pixels]."""


def image_clusters(
    pixel: Int[np.ndarray, " p"], width: int, edge: int | None = None
) -> Int[np.ndarray, " p"]:
    """Numbers of the squares that pixels of an image belong to.

    `edge` is that of the squares in pixels, by default that of clusters.
    """
    edge = _SQUARE if edge is None else edge
    row, column = np.divmod(pixel, width)
    number = row // edge * (width // edge + 1) + column // edge
    return np.unique(number, return_inverse=True)[1].reshape(-1)


def view_clusters(
    pixels: Sequence[Any],
    widths: Sequence[int],
    times: int,
    edge: int | None = None,
    through_time: bool = True,
) -> Int[np.ndarray, " r"]:
    """Squares of the compared pixels of several views, times first.

    A square holds its pixels at all times, or at one of them unless `through_time`.
    """
    numbers = []
    first = 0
    for pixel, width in zip(pixels, widths, strict=True):
        number = first + image_clusters(np.asarray(pixel), width, edge)
        numbers.append(number)
        first = int(number.max()) + 1
    at_one_time = np.concatenate(numbers)
    shift = 0 if through_time else first
    return np.concatenate([at_one_time + shift * time for time in range(times)])


def score_covariance(
    rows: Float[np.ndarray, "n p"],
    residual: Float[np.ndarray, " p"],
    cluster: Int[np.ndarray, " p"],
) -> Float[np.ndarray, "n n"]:
    """Covariance of J^T r by the clusters of the residuals; `rows` are those of J^T."""
    count = int(cluster.max()) + 1
    products = rows * residual
    scores = np.stack([np.bincount(cluster, row, count) for row in products])
    return scores @ scores.T * (count / max(count - 1, 1))


def design_effect(
    residual: Float[np.ndarray, " p"], cluster: Int[np.ndarray, " p"]
) -> float:
    """Variance of the residuals' sum over that of independent ones of variance 1.

    1 for white noise; the squares of a bias, times the number of residuals alike.
    """
    sums = np.bincount(cluster, residual)
    return float(sums @ sums / len(residual))
