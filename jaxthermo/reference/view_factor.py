"""View factors in closed form.

Sources: Howell and Menguc, A Catalog of Radiation Heat Transfer Configuration Factors;
Incropera et al., Fundamentals of Heat and Mass Transfer, table 13.2.
"""

import numpy as np

from ..arrays import Scalar


def parallel_rectangles(width: Scalar, length: Scalar, gap: Scalar) -> float:
    """Between two equal rectangles that face each other squarely.

    Args:
        width: of both [m].
        length: of both [m].
        gap: between them [m].
    """
    x, y = float(width) / float(gap), float(length) / float(gap)
    p, q = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
    corners = np.log(p * q / np.sqrt(1 + x * x + y * y))
    sides = x * q * np.arctan(x / q) + y * p * np.arctan(y / p)
    ends = x * np.arctan(x) + y * np.arctan(y)
    return float(2 / (np.pi * x * y) * (corners + sides - ends))


def perpendicular_rectangles(shared: Scalar, height: Scalar, width: Scalar) -> float:
    """From a floor to the wall that stands on one of its edges.

    Args:
        shared: length of the edge they share [m].
        height: of the wall [m].
        width: of the floor, away from the wall [m].
    """
    h, w = float(height) / float(shared), float(width) / float(shared)
    h2, w2 = h * h, w * w
    s = h2 + w2
    angles = w * np.arctan(1 / w) + h * np.arctan(1 / h)
    angles -= np.sqrt(s) * np.arctan(1 / np.sqrt(s))
    powers = np.log((1 + w2) * (1 + h2) / (1 + s))
    powers += w2 * np.log(w2 * (1 + s) / ((1 + w2) * s))
    powers += h2 * np.log(h2 * (1 + s) / ((1 + h2) * s))
    return float((angles + powers / 4) / (np.pi * w))


def coaxial_discs(first: Scalar, second: Scalar, gap: Scalar) -> float:
    """From a disc to another one on the same axis.

    Args:
        first: radius of the one that emits [m].
        second: radius of the other [m].
        gap: between them [m].
    """
    a, b = float(first) / float(gap), float(second) / float(gap)
    s = 1 + (1 + b * b) / (a * a)
    return float((s - np.sqrt(s * s - 4 * (b / a) ** 2)) / 2)


def element_to_disc(radius: Scalar, gap: Scalar) -> float:
    """From an element on the axis of a disc that it faces: R^2 / (R^2 + H^2)."""
    square = float(radius) ** 2
    return square / (square + float(gap) ** 2)


def element_to_rectangle(width: Scalar, length: Scalar, gap: Scalar) -> float:
    """From an element to a rectangle that it faces, below one of its corners.

    Args:
        width: of the rectangle [m].
        length: of the rectangle [m].
        gap: to the corner above the element [m].
    """
    x, y = float(width) / float(gap), float(length) / float(gap)
    p, q = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
    return float((x / p * np.arctan(y / p) + y / q * np.arctan(x / q)) / (2 * np.pi))


def element_to_strip(width: Scalar, gap: Scalar) -> float:
    """From an element to an endless strip above its middle: the sine of the half angle.

    Args:
        width: of the strip [m].
        gap: to its middle [m].
    """
    half = float(width) / 2
    return half / np.hypot(half, float(gap))


def element_to_sphere(radius: Scalar, distance: Scalar, cosine: Scalar) -> float:
    """From an element to a sphere wholly above its horizon: (R / d)^2 cos(angle).

    Args:
        radius: R [m].
        distance: d to the sphere's centre [m].
        cosine: of the angle between the element's normal and the way to the centre.
    """
    return (float(radius) / float(distance)) ** 2 * float(cosine)


def out_of_groove(position: Scalar, length: Scalar, angle: Scalar) -> float:
    """From an element on the wall of an endless V-groove to the outside.

    F = [1 - (L cos a - x) / sqrt(L^2 + x^2 - 2 x L cos a)] / 2

    Args:
        position: x, from the bottom along the wall [m].
        length: L of both walls [m].
        angle: a between them [rad].
    """
    x, far = float(position), float(length)
    along = far * np.cos(float(angle)) - x
    across = far * np.sin(float(angle))
    return float((1 - along / np.hypot(along, across)) / 2)


def groove_mouth(angle: Scalar) -> float:
    """From both walls of an endless V-groove to the outside: sin(angle / 2)."""
    return float(np.sin(float(angle) / 2))
