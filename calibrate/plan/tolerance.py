"""Limits of a plan: of the error, the run time and the memory of a model."""

from typing import NamedTuple


class Tolerance(NamedTuple):
    """Limits of a plan."""

    percent: float | None = None
    """Largest RMS error over the range of the reference [%]; None for no limit."""
    kelvin: float | None = None
    """Largest RMS error [K]; None for no limit."""
    run_time: float | None = None
    """Longest time of the compiled loop [s]; None for no limit."""
    memory: float | None = None
    """Largest peak memory [bytes]; None for no limit."""

    def affords(self, run_time: float, memory: float | int) -> bool:
        """True if a time [s] and a memory [bytes] are within the limits."""
        in_time = self.run_time is None or run_time <= self.run_time
        return in_time and (self.memory is None or memory <= self.memory)

    def excess(self, percent: float, kelvin: float) -> float:
        """Error over the tolerance [-]: at most 1 within it."""
        ratios = []
        if self.percent is not None:
            ratios.append(percent / self.percent)
        if self.kelvin is not None:
            ratios.append(kelvin / self.kelvin)
        return max(ratios)

    def words(self) -> str:
        """As in a sentence: "1 %, 0.2 K"."""
        limits = []
        if self.percent is not None:
            limits.append(f"{self.percent:.3g} %")
        if self.kelvin is not None:
            limits.append(f"{self.kelvin:.3g} K")
        if self.run_time is not None:
            limits.append(f"{1e3 * self.run_time:.3g} ms")
        if self.memory is not None:
            limits.append(f"{self.memory / 2**20:.4g} MiB")
        return ", ".join(limits)
