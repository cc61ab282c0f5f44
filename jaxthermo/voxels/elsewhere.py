"""The complement of a selection on all bodies of a scene."""

import numpy as np
from jaxtyping import Bool
from typing_extensions import override

from .selection import AbstractSelection, Everything, FragmentCentres


class Elsewhere(AbstractSelection):
    """All bodies but what a selection selects; its complement is on its bodies only."""

    selection: AbstractSelection

    @property
    @override
    def bodies(self) -> tuple[int, ...]:
        return self.selection.bodies

    @override
    def on_body(self, body: int) -> AbstractSelection | None:
        on_body = self.selection.on_body(body)
        if on_body is None:
            return Everything(body)
        return None if isinstance(on_body, Everything) else ~on_body

    @override
    def select(self, fragments: FragmentCentres) -> Bool[np.ndarray, " s"]:
        return ~self.selection.select(fragments)
