"""Scale of colours that grows with the temperatures that are seen."""

from typing import Any, NamedTuple

import numpy as np

from ..choices import Palette


# Smallest range of colours [K], and the margin beyond what is seen, of the range [-].
_MIN_RANGE = 1.0
_MARGIN = 0.02


class Scale(NamedTuple):
    """Colours of temperatures."""

    low: float
    """[K]"""
    high: float
    """[K]"""
    palette: Palette

    def holding(self, kelvin: Any) -> "Scale":
        """The scale, or one that grew so far that it holds all temperatures [K].

        NaN counts as nothing.
        """
        low = float(np.nanmin(kelvin))
        high = float(np.nanmax(kelvin))
        if self.low <= low and high <= self.high:
            return self
        grown = scale_of(kelvin, self.palette)
        low = min(self.low, grown.low)
        high = max(self.high, grown.high)
        return Scale(low, high, self.palette)


def scale_of(kelvin: Any, palette: Palette) -> Scale:
    """The scale of temperatures [K], with a margin; NaN counts as nothing."""
    low = float(np.nanmin(kelvin))
    high = float(np.nanmax(kelvin))
    margin = max(_MARGIN * (high - low), _MIN_RANGE / 2)
    return Scale(low - margin, high + margin, palette)
