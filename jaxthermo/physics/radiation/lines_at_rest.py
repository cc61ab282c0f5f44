"""Lines through a scene in which some bodies move.

Where no moving body is, lines meet the same surfaces at all times. So the sums over
lines are those of the bodies at rest, which are found once, less what these have on the
lines around the moving bodies, plus what all bodies have there:

    S(all) = S(at rest) - S(at rest, around) + S(all, around),

on the same lines in all four.
"""

import operator
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Int
from scipy.sparse import csr_array

from ...memo.content_hash import content_hash
from ...memo.found import found
from .global_lines import (
    Bundles,
    LineSums,
    bundles_of,
    sample_all_directions,
    sample_bundles,
    sample_changes,
    views_at_once,
)
from .line_hits import LineScene, outline
from .patches import PatchedBody


class _AtRest(NamedTuple):
    """Bodies at rest of a scene, by themselves."""

    bodies: tuple[PatchedBody, ...]
    bundles: Bundles
    """Those that count lines between them."""
    patches: Int[np.ndarray, " r"]
    """Number of each of their patches in the whole scene."""

    @classmethod
    def of(
        cls, scene: LineScene, at_rest: tuple[int, ...], bundles: Bundles
    ) -> "_AtRest":
        """The bodies of these numbers."""
        counts = [body.patches.count for body in scene.bodies]
        number = np.repeat(np.arange(len(counts)), counts)
        patches = np.flatnonzero(np.isin(number, at_rest))
        return cls(
            bodies=tuple(scene.bodies[n] for n in at_rest),
            bundles=Bundles(
                bundles=[b for b in bundles.bundles if {*b.bodies} & {*at_rest}],
                of_patch=bundles.of_patch[patches],
            ),
            patches=patches,
        )

    def sums(self, directions: int) -> LineSums:
        """Sums over the lines between them, found once for all places of the others."""
        placed = [(b.points, b.spacing(directions)) for b in self.bundles.bundles]
        return found(
            (),
            by=(
                "lines at rest",
                content_hash((self.bodies, tuple(placed), directions)),
            ),
            find=lambda: sample_bundles(
                LineScene.of_bodies(self.bodies), self.bundles, directions
            ),
        )

    def among_all(self, sums: LineSums, count: int) -> LineSums:
        """Sums of their patches as sums of all patches of the scene."""
        pairs = sums.pairs.tocoo()
        ends = tuple(self.patches[end] for end in pairs.coords)
        sky, ground = np.zeros((2, count))
        sky[self.patches] = sums.sky
        ground[self.patches] = sums.ground
        return LineSums(
            pairs=csr_array((pairs.data, ends), shape=(count, count)),
            sky=sky,
            ground=ground,
        )


def sample_around_motion(
    scene: LineScene, at_rest: tuple[int, ...], directions: int, lines: int | None
) -> LineSums:
    """Areas as those of `sample_all_directions`, in which some bodies move.

    `at_rest` are the numbers of those that do not; lines of these by themselves are
    sampled once for all places of the others.
    """
    moving = tuple(n for n in range(len(scene.bodies)) if n not in at_rest)
    bundles = bundles_of(scene, lines)
    # Whole views that are drawn several at once take no longer than parts one by one.
    at_once = views_at_once(scene, bundles, bundles.bundles[0], directions)
    if not at_rest or not moving or at_once > 1:
        return sample_all_directions(scene, directions, lines)
    bundles = _around_resting(bundles, scene, at_rest)
    resting = _AtRest.of(scene, at_rest, bundles)
    around, alone_around = sample_changes(scene, bundles, directions, moving)
    alone = resting.among_all(resting.sums(directions), scene.count)
    return jax.tree.map(operator.add, jax.tree.map(_less, alone, alone_around), around)


def _less(sums: Any, crossing: Any) -> Any:
    """Sums less those of some of their lines; not below 0, which is rounding."""
    free = sums - crossing
    return free.maximum(0) if isinstance(free, csr_array) else np.maximum(free, 0)


def _around_resting(
    bundles: Bundles, scene: LineScene, at_rest: tuple[int, ...]
) -> Bundles:
    """Bundles whose lines do not change with the places of moving bodies."""
    placed = []
    for bundle in bundles.bundles:
        resting = [number for number in bundle.bodies if number in at_rest]
        if resting:
            points = np.concatenate([scene.bodies[n].vertices for n in resting])
            bundle = bundle._replace(points=outline(points))
        placed.append(bundle)
    return bundles._replace(bundles=placed)
