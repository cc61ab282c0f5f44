"""Names in a chart that do not stand on one another, nor on points."""

LINE = 16.0
"""Height of a line of text [px]."""

LETTER = 8.0
"""Mean width of a letter [px]."""

RAISE = 13.0
"""From a point to the middle of a name above it [px]."""

POINT = 7.0
"""Half the width of a point [px]."""

Spot = tuple[float, float]


def apart(names: list[str], spots: list[Spot], points: list[Spot]) -> list[float]:
    """Heights for names near their points, each raised until it is clear.

    Args:
        names: what is written.
        spots: middle of each name, and the highest point that it belongs to, upwards
            [px].
        points: all that are drawn [px].
    """
    taken = [(x, POINT, y, RAISE - 2) for x, y in points]
    found = [0.0] * len(names)
    for i in sorted(range(len(names)), key=lambda i: spots[i][1]):
        x, half = spots[i][0], LETTER * len(names[i]) / 2
        height = spots[i][1] + RAISE
        # From below upwards, so that what was passed stays below.
        for other_x, other_half, other, room in sorted(taken, key=lambda t: t[2]):
            beside = abs(other_x - x) >= half + other_half
            if not beside and abs(other - height) < room:
                height = other + room
        taken.append((x, half, height, LINE))
        found[i] = height
    return found
