"""Lines, memory and time of view factors, told before they are sampled."""

import warnings
from typing import NamedTuple

from ...errors import InputError, LongComputation
from ...host_memory import readable_bytes, require_memory
from .global_lines import Bundle, bundles_of
from .line_hits import LineScene


# Memory for each pair of patches that see each other, while sums are merged [bytes].
_BYTES_PER_PAIR = 64

# Memory of one surface that a line meets, while a drawing is made [bytes].
_BYTES_PER_HIT = 400

# Number of lines from which the user is told how long they take.
_MANY_LINES = 1e7


class SamplingCost(NamedTuple):
    """Lines, memory and time of the view factors of a scene."""

    patches: int
    bundles: list[Bundle]

    @classmethod
    def of_scene(cls, scene: LineScene, lines: int | None) -> "SamplingCost":
        """The cost of a scene; `lines` as in `view_factors`."""
        return cls(patches=scene.count, bundles=bundles_of(scene, lines).bundles)

    def hits(self, directions: int) -> float:
        """Surfaces that the lines of a number of directions meet."""
        return sum(bundle.hits(directions) for bundle in self.bundles)

    def lines(self, first: int, last: int) -> float:
        """Lines between surfaces, for doubled numbers of directions up to the last."""
        counts = [first]
        while counts[-1] < last:
            counts.append(2 * counts[-1])
        # Each line leads from one surface to the next.
        return sum(map(self.hits, counts)) / 2

    @property
    def _task(self) -> str:
        return f"view factors of {self.patches} patches"

    def bytes_for(self, directions: int) -> int:
        """Memory for a number of directions [bytes]."""
        # Lines lead from one surface to the next; both patches have an entry for it.
        hits = self.hits(directions)
        pairs = min(float(self.patches) ** 2, hits)
        return int(_BYTES_PER_PAIR * pairs + _BYTES_PER_HIT * hits / directions)

    def require(self, directions: int) -> None:
        """Refuse directions that do not fit into memory, before the first line.

        Raises:
            InputError: for too little memory.
        """
        require_memory(
            self.bytes_for(directions),
            self._task,
            "give fewer `max_patches` or `directions`",
        )

    def fits(self, directions: int) -> bool:
        """True if a number of directions fits into memory."""
        try:
            self.require(directions)
        except InputError:
            return False
        return True

    def tell(self, sampled: int, seconds: float, least: int, most: int) -> None:
        """Warn of directions that take long, from those that were sampled so far.

        Args:
            sampled: number of directions.
            seconds: time that they took.
            least: number of directions after which sampling may end.
            most: number of directions at which it ends at the latest.
        """
        lines = self.lines(sampled, least)
        if lines < _MANY_LINES:
            return
        rate = seconds / self.lines(sampled, sampled)
        warnings.warn(
            f"{self._task}: {lines:.2g} lines in {least} directions take about "
            f"{rate * lines:.2g} s and {readable_bytes(self.bytes_for(least))}; the "
            f"error may require up to {most} directions, which take "
            f"{rate * self.lines(sampled, most):.2g} s; `max_patches` and `error` set "
            "their number",
            LongComputation,
            stacklevel=2,
        )
