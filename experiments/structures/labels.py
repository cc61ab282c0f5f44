"""Names in a chart that do not stand on one another, nor on points."""

import itertools
from typing import NamedTuple


LINE = 16.0
"""Height of a line of text [px]."""

LETTER = 8.0
"""Mean width of a letter [px]."""

RAISE = 13.0
"""From a point to the middle of a name above it [px]."""

POINT = 7.0
"""Half the width of a point [px]."""

Spot = tuple[float, float]


class Box(NamedTuple):
    """Where no name may stand [px]."""

    x: float
    half: float
    """Of its width."""
    y: float
    room: float
    """Least height from here to the middle of a name."""

    def meets(self, x: float, half: float, y: float) -> bool:
        """Whether a name there would stand on it."""
        return abs(self.x - x) < self.half + half and abs(self.y - y) < self.room


def apart(names: list[str], spots: list[Spot], points: list[Spot]) -> list[float]:
    """Heights for names near their points: the nearest that is clear, above first.

    Args:
        names: what is written.
        spots: middle of each name, and the highest point that it belongs to, upwards
            [px].
        points: all that are drawn [px].
    """
    taken = [Box(x, POINT, y, RAISE - 2) for x, y in points]
    found = []
    for name, (x, y) in zip(names, spots, strict=True):
        half = LETTER * len(name) / 2
        away = (RAISE + step * LINE / 4 for step in itertools.count())
        tried = (y + sign * distance for distance in away for sign in (1, -1))
        height = next(h for h in tried if not any(b.meets(x, half, h) for b in taken))
        taken.append(Box(x, half, height, LINE))
        found.append(height)
    return found
