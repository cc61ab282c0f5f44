"""Numbers of the flows behind a cylinder, as the exhibits of wakes give them."""

from typing import TypedDict


class FitNumbers(TypedDict):
    """A family of curves fitted to a wake."""

    parameters: dict[str, str]
    """Each parameter with its standard error, in words."""
    values: list[float]
    rms: float
    largest: float


FlowNumbers = TypedDict(
    "FlowNumbers",
    {
        "channel": str,
        "speed": float,
        "Re": float,
        "strouhal": float | None,
        "bubble": float,
        "tail_0.9": float,
        "tail_0.8": float,
        "read_to": float,
        "last": float,
        "fastest": float,
        "slowest": float,
        "fits": dict[str, FitNumbers],
    },
)
"""Numbers of a flow; lengths in diameters, speeds over the undisturbed one."""


class DistanceRow(TypedDict):
    """Distances of two normalized curves."""

    speeds: list[float]
    rms: float
    largest: float
