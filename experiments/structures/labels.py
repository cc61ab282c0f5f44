"""Names in a chart that do not stand on one another."""

LINE = 16.0
"""Height of a line of text [px]."""

LETTER = 8.0
"""Mean width of a letter [px]."""

RAISE = 13.0
"""From a point up to the middle of its name [px]."""


def apart(names: list[str], x: list[float], y: list[float]) -> list[float]:
    """Heights for names near their points, each raised until it is clear of others.

    Args:
        names: what is written.
        x: middle of each name [px].
        y: of the point that it belongs to, upwards [px].
    """
    placed: list[tuple[float, float, float]] = []
    found = [0.0] * len(names)
    for i in sorted(range(len(names)), key=lambda i: y[i]):
        half, height = LETTER * len(names[i]) / 2, y[i] + RAISE
        for other_x, other_half, other in sorted(placed, key=lambda p: p[2]):
            beside = abs(other_x - x[i]) >= half + other_half
            if not beside and abs(other - height) < LINE:
                height = other + LINE
        placed.append((x[i], half, height))
        found[i] = height
    return found
