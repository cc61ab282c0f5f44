"""Surface fragments that a mask flags."""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool
from typing_extensions import override

from ..errors import InputError
from .selection import AbstractOnOneBody, FragmentCentres


class FragmentMask(AbstractOnOneBody):
    """Surface fragments given by a mask, in the order of the body's grid."""

    body: int | str = eqx.field(static=True, default=0)
    count: int = eqx.field(static=True, default=0)
    """Number of fragments of the body."""
    packed: bytes = eqx.field(static=True, default=b"")
    """Mask with eight fragments a byte: static fields must be hashable."""

    def __init__(self, mask: Any, body: int | str = 0):
        """Select fragments by a mask.

        Args:
            mask: one truth value per fragment, e.g.
                `grid.fragment_position[:, 2] > 0.1`.
            body: number of the body, or its name.

        Raises:
            InputError: for anything but one-dimensional truth values.
        """
        values = np.asarray(mask)
        if values.dtype != bool or values.ndim != 1:
            raise InputError(
                f"FragmentMask(mask=): got {values.dtype} values of shape "
                f"{values.shape}: give one True or False for each fragment"
            )
        self.body = body if isinstance(body, str) else int(body)
        self.count = len(values)
        self.packed = np.packbits(values).tobytes()

    @override
    def numbered(self, body: int) -> "FragmentMask":
        return FragmentMask(self.mask, body=body)

    @property
    def mask(self) -> Bool[np.ndarray, " s"]:
        """Flags of the selected fragments."""
        bits = np.frombuffer(self.packed, np.uint8)
        return np.unpackbits(bits, count=self.count).astype(bool)

    @property
    @override
    def is_geometric(self) -> bool:
        return False

    def __repr__(self) -> str:
        selected = int(np.count_nonzero(self.mask))
        return f"FragmentMask({selected} of {self.count} fragments, body={self.body})"

    @override
    def select(self, fragments: FragmentCentres) -> Bool[np.ndarray, " s"]:
        if len(fragments.position) != self.count:
            raise InputError(
                f"FragmentMask(mask=): it has {self.count} values and body "
                f"{self.body} has {len(fragments.position)} fragments: make it from "
                "the grid of that body"
            )
        return self.mask
