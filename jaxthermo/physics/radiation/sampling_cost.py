"""Lines, memory and time of view factors, told before they are sampled."""

import warnings
from typing import NamedTuple

from ...errors import InputError, LongComputation
from ...host_memory import readable_bytes, require_memory
from .global_lines import bundles_of
from .line_hits import LineScene


# Memory for each pair of patches that see each other, while sums are merged [bytes].
_BYTES_PER_PAIR = 64

# Memory of one surface that a line meets, while a drawing is made [bytes].
_BYTES_PER_HIT = 400

# Surfaces that lines meet, from which the user is told how long they take.
_MANY_HITS = 2e7


class SamplingCost(NamedTuple):
    """What view factors of a scene cost, by the number of directions."""

    patches: int
    hits: float
    """Surfaces that the lines of two opposite directions meet."""

    @classmethod
    def of_scene(cls, scene: LineScene, lines: int | None) -> "SamplingCost":
        """The cost of a scene; `lines` as in `view_factors`."""
        hits = 0.0
        for bundle in bundles_of(scene, lines).bundles:
            # Seen from all directions, the mean area of a surface is half its own.
            hits += bundle.area / 2 / bundle.pixel**2
        return cls(patches=scene.count, hits=hits)

    @property
    def _task(self) -> str:
        return f"view factors of {self.patches} patches"

    def bytes_for(self, directions: int) -> int:
        """Memory for a number of directions [bytes]."""
        # Lines lead from one surface to the next; both patches have an entry for it.
        pairs = min(float(self.patches) ** 2, self.hits * directions / 2)
        return int(_BYTES_PER_PAIR * pairs + _BYTES_PER_HIT * self.hits)

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
        if self.hits * least / 2 < _MANY_HITS:
            return
        # All numbers of directions up to the last one have twice as many.
        rate = 2 * seconds / sampled
        warnings.warn(
            f"{self._task}: {sampled} directions with {self.hits * sampled / 2:.2g} "
            f"lines took {seconds:.2g} s; {least} take about {rate * least:.2g} s and "
            f"{readable_bytes(self.bytes_for(least))}, and the error may require up to "
            f"{most}, which take {rate * most:.2g} s; `max_patches` and `error` set "
            "their number",
            LongComputation,
            stacklevel=2,
        )
