"""Pose of a camera from the outlines in its frames, to a small part of a pixel.

A pixel at an outline shows the radiance L = c L_body + (1 - c) L_behind, where c is the
fraction of it that bodies cover. Body and background near the outline are known from
the frame itself, so that it gives c there, without a model of temperatures:

    c_data = (L - L_behind) / (L_body - L_behind),

with both continued to the pixel as local planes. Those of the mesh, from several rays
a pixel, agree with them in the pose that is sought, by Gauss-Newton steps.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_dilation, binary_erosion, gaussian_filter

from jaxthermo.errors import InputError
from jaxthermo.image.pose.coverage import Coverage, coverage, coverage_slopes
from jaxthermo.image.pose.pose import moved_camera
from jaxthermo.image.surface.abstract_camera import AbstractCamera
from jaxthermo.image.surface.visible import WorldMesh

from .clusters import image_clusters, score_covariance


_SAMPLES = 8
"""Rays along each axis of a pixel."""
_FAR = 1.5
"""Spread of the neighbours that continue a radiance in a pose that is a pixel off,
where the outermost pixels are left out [pixels]."""
_NEAR = 1.0
"""Spread of the neighbours in a pose that is nearly right [pixels]."""
_RIDGE = 0.05
"""Weight against slopes of a radiance: few neighbours may lie on a line."""
_MIN_WEIGHT = 0.02
"""Least sum of the neighbours' weights; 1 for all around."""
_MAX_STEP = 1.0
"""Largest change of a pose in a step [pixels]."""
_CLOSE = 0.2
"""Change of a step below which the pose is nearly right [pixels]."""
_ACCURACY = 0.01
"""Change of a step below which the search has converged [pixels]."""
_MAX_STEPS = 30
_FLAT = 0.01
"""Singular value over the largest, below which outlines do not determine a change."""
_OUTLIER = 3.0
"""Residual beyond which a pixel counts less, over the typical one."""


class Outlines(NamedTuple):
    """Pose that outlines give, and how well they determine it."""

    numbers: Float[np.ndarray, " n"]
    """Fitted numbers of the pose."""
    information: Float[np.ndarray, "n n"]
    """Inverse of the covariance of `numbers`."""


class _Rows(NamedTuple):
    """Pixels at outlines whose covered fractions are compared."""

    pixel: Int[np.ndarray, " p"]
    residual: Float[np.ndarray, " p"]
    """Covered fraction of the mesh minus that of the data."""
    weight: Float[np.ndarray, " p"]
    """Weight of a residual, by the contrast at the pixel."""


def fit_outlines(
    bodies: tuple[WorldMesh, ...],
    camera: AbstractCamera,
    radiance: Float[np.ndarray, "h w"],
    compared: Bool[np.ndarray, "h w"],
    pose: Float[np.ndarray, "6"],
    numbers: Int[np.ndarray, " n"],
    unit: Float[np.ndarray, " n"],
) -> Outlines | None:
    """Find the pose of a camera from one that is up to some pixels off.

    Args:
        bodies: meshes in the world.
        camera: as given.
        radiance: of the frame [W/(m^2 sr)], where it is `compared`.
        compared: pixels that may be compared.
        pose: to start from.
        numbers: indices of the pose's numbers that are sought.
        unit: changes of these that move the image by about a pixel.

    Returns:
        None where steps do not end, or lead to where no body is seen.
    """
    fitted = pose.copy()
    near = False
    for _ in range(_MAX_STEPS):
        try:
            covered = coverage(bodies, moved_camera(camera, fitted), _SAMPLES)
        except InputError:
            return None
        rows = _compare(covered, radiance=radiance, compared=compared, near=near)
        all_slopes = coverage_slopes(
            covered, camera=camera, pose=fitted, pixels=rows.pixel
        )
        slopes = all_slopes[:, numbers] * unit * rows.weight[:, None]
        residual = rows.residual * rows.weight
        if len(rows.pixel) < len(numbers):
            return None
        change = np.linalg.lstsq(slopes, residual, rcond=_FLAT)[0]
        if near and np.linalg.norm(change) < _ACCURACY:
            information = _information(
                slopes, residual=residual, pixel=rows.pixel, width=camera.width
            )
            return Outlines(fitted[numbers], information / np.outer(unit, unit))
        near = near or float(np.linalg.norm(change)) < _CLOSE
        fitted[numbers] -= unit * np.clip(change, -_MAX_STEP, _MAX_STEP)
    return None


def _compare(
    covered: Coverage,
    radiance: Float[np.ndarray, "h w"],
    compared: Bool[np.ndarray, "h w"],
    near: bool,
) -> _Rows:
    """Covered fractions near outlines, and those that the data give."""
    square = np.ones((3, 3))
    c = covered.fraction
    outline = binary_dilation((c > 0) & (c < 1), square) & compared
    row, column = np.nonzero(outline)
    ends = []
    for pure in (c == 1, c == 0):
        # In a pose that is off the outermost of these are mixed in the data.
        unmixed = pure if near else binary_erosion(pure, square, border_value=1)
        extended = _continued(
            radiance,
            sampled=unmixed & compared,
            spread=_NEAR if near else _FAR,
            row=row,
            column=column,
        )
        ends.append(extended)
    (body, on_body), (behind, on_background) = ends
    contrast = body - behind
    is_clear = (np.minimum(on_body, on_background) > _MIN_WEIGHT) & (contrast != 0)
    row = row[is_clear]
    column = column[is_clear]
    contrast = contrast[is_clear]
    data_fraction = (radiance[row, column] - behind[is_clear]) / contrast
    residual = c[row, column] - data_fraction
    if not len(residual):
        return _Rows(row, residual, residual)
    # A noisy frame has fractions as precise as its contrast; the mesh has not.
    weight = np.minimum(np.abs(contrast) / np.median(np.abs(contrast)), 1)
    typical = 1.5 * np.median(np.abs(residual)) + 0.5 / _SAMPLES**2
    away = np.abs(residual) / (_OUTLIER * typical)
    return _Rows(
        row * c.shape[1] + column, residual, weight / np.sqrt(np.maximum(away, 1))
    )


def _continued(
    values: Float[np.ndarray, "h w"],
    sampled: Bool[np.ndarray, "h w"],
    spread: float,
    row: Int[np.ndarray, " p"],
    column: Int[np.ndarray, " p"],
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """Values at pixels of planes through the sampled ones, and their sums of weights.

    Minimizes sum_i w_i (a + b . x_i - v_i)^2 + ridge |b|^2 sum_i w_i at each pixel,
    with Gaussian weights of the distances x_i.
    """
    weight = sampled.astype(float)
    # Coordinates count from the middle, so that moments are no small differences.
    middle = 0.5 * np.reshape(values.shape, (2, 1, 1))
    y, x = np.indices(values.shape) - middle
    at = (x[row, column], y[row, column])
    level = values[sampled].mean() if sampled.any() else 0.0

    def sums(image: Float[np.ndarray, "h w"] | float) -> Float[np.ndarray, " p"]:
        blurred = gaussian_filter(weight * image, spread, mode="constant")
        return blurred[row, column]

    total = sums(1.0)
    sx = sums(x)
    sy = sums(y)
    v = sums(values - level)
    at_x, at_y = at
    moments = {
        (0, 0): sums(x * x) - 2 * at_x * sx + at_x**2 * total,
        (0, 1): sums(x * y) - at_x * sy - at_y * sx + at_x * at_y * total,
        (1, 1): sums(y * y) - 2 * at_y * sy + at_y**2 * total,
    }
    matrix = np.zeros((len(row), 3, 3))
    matrix[:, 0, 0] = total + 1e-12
    right = [v]
    for n, (axis, first) in enumerate(((x, sx), (y, sy))):
        about_pixel = first - at[n] * total
        matrix[:, 0, n + 1] = about_pixel
        matrix[:, n + 1, 0] = about_pixel
        right.append(sums((values - level) * axis) - at[n] * v)
    for (m, n), moment in moments.items():
        matrix[:, m + 1, n + 1] = matrix[:, n + 1, m + 1] = moment
    matrix[:, [1, 2], [1, 2]] += _RIDGE * total[:, None] + 1e-12
    solved = np.linalg.solve(matrix, np.stack(right, axis=1)[:, :, None])
    return level + solved[:, 0, 0], total


def _information(
    slopes: Float[np.ndarray, "p n"],
    residual: Float[np.ndarray, " p"],
    pixel: Int[np.ndarray, " p"],
    width: int,
) -> Float[np.ndarray, "n n"]:
    """Inverse of the covariance of a pose, A B^-1 A [1/pixel^2].

    A = J^T J, and B is the covariance of J^T r: neighbours have similar residuals.
    """
    square = slopes.T @ slopes
    scatter = score_covariance(slopes.T, residual, image_clusters(pixel, width))
    # Without this term, what no outline determines would count as known.
    scatter += 1e-6 * np.trace(scatter) * np.eye(len(scatter))
    return square @ np.linalg.solve(scatter, square)
