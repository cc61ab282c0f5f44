"""Play, pause and reset of a run, at a rate of its time to that of a clock."""

import math
from collections import deque
from itertools import pairwise

from ..errors import InputError
from .live_run import AbstractLiveRun
from .session import STEPS_A_SECOND


FRAME = 1.0 / STEPS_A_SECOND
"""Time from one frame to the next [s]."""

# Fraction of a frame for the simulation: the rest is for drawing and sending.
_SHARE = 0.7
# A clock that stood still, as while compiling, does not make the time jump [s].
_LONGEST_TICK = 0.25
# Time over which speeds are measured [s].
_WINDOW = 2.0


class Player:
    """Moves a run on with a clock of wall time.

    Args:
        run: simulation or finished run.
        rate: seconds of the run per second.
    """

    def __init__(self, run: AbstractLiveRun, rate: float):
        self.run = run
        self.playing = False
        self.set_rate(rate)
        self._ticks: deque[tuple[float, float]] = deque()
        self._aim = run.time
        self._last_clock = math.nan

    def set_rate(self, rate: float) -> None:
        """Set the rate [s/s].

        Raises:
            InputError: for one that is not positive and finite.
        """
        if not (rate > 0 and math.isfinite(rate)):
            raise InputError(f"rate {rate:g}: give simulated seconds a second, above 0")
        self.rate = rate

    def play(self) -> None:
        """Go on; from the start if at the end."""
        if self.run.finished:
            self.run.reset()
        self.playing = True
        self.jumped()

    def pause(self) -> None:
        """Stand still."""
        self.playing = False
        self.jumped()

    def reset(self) -> None:
        """Go back to the start, and stay there."""
        self.run.reset()
        self.pause()

    def jumped(self) -> None:
        """Go on from the current time of the run, and measure speeds anew."""
        self._aim = self.run.time
        self._last_clock = math.nan
        self._ticks.clear()

    def tick(self, clock: float) -> bool:
        """Move on to a reading of the clock [s]; True if there is a new picture."""
        if not self.playing:
            return False
        passed = 0.0 if math.isnan(self._last_clock) else clock - self._last_clock
        self._last_clock = clock
        previous_time = self.run.time
        self._aim += self.rate * min(passed, _LONGEST_TICK)
        self.run.advance_to(self._aim, _SHARE * FRAME)
        # What is slower than the rate must not fall behind for ever.
        self._aim = min(self._aim, self.run.time + 2 * self.rate * FRAME)
        self._ticks.append((clock, self.run.time))
        while clock - self._ticks[0][0] > _WINDOW:
            self._ticks.popleft()
        if self.run.finished:
            self.playing = False
        return self.run.time != previous_time

    def speeds(self) -> tuple[float, float] | None:
        """Seconds of the run, and frames sent, per second; None at a standstill."""
        if not self.playing or len(self._ticks) < 2:
            return None
        (first, start) = self._ticks[0]
        (last, now) = self._ticks[-1]
        if last - first < 0.2:
            return None
        # A tick within a step shows nothing new, so that no frame is sent.
        frames = sum(previous[1] != tick[1] for previous, tick in pairwise(self._ticks))
        return (now - start) / (last - first), frames / (last - first)
