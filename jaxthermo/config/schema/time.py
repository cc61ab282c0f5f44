"""The end of a run, and the times at which it is saved."""

from typing import Annotated, ClassVar

from typing_extensions import override

from ..types.model import Location, Mistake, Model
from ..types.quantities import NotEmpty, PositiveTime
from ..types.varying import not_increasing


# A run with more saved times would fill the memory.
_MAX_SAVES = 100_000


class TimeConfig(Model):
    """The end of the run, and the times at which its state is saved."""

    end: PositiveTime
    """End of the run [s]; it stops at the last saved time if that is earlier."""
    save_at: Annotated[tuple[PositiveTime, ...], NotEmpty] | None = None
    """Times at which the state is saved [s]."""
    save_every: PositiveTime | None = None
    """Interval between saved times, instead of a list [s]."""

    exactly_one: ClassVar = (("save_at", "save_every"),)

    @override
    def mistakes(self) -> list[Mistake]:
        interval = self.save_every
        listed = self.save_at or ()
        times: list[tuple[Location, float]] = [
            (("save_at", i), time) for i, time in enumerate(listed)
        ]
        if interval is not None:
            times.append((("save_every",), interval))
        mistakes = not_increasing(listed, key="save_at", unit="s")
        for location, time in times:
            if time > self.end:
                message = f"{time:g} s is after the end, {self.end:g} s"
                mistakes.append((location, message))
        if interval is not None and self.end / interval > _MAX_SAVES:
            mistakes.append(
                (("save_every",), f"would save more than {_MAX_SAVES} times")
            )
        return mistakes

    @property
    def last(self) -> float:
        """Time at which the run stops [s]: later results would not be saved."""
        return self.save_times[-1]

    @property
    def save_times(self) -> tuple[float, ...]:
        """Times at which the state is saved [s]; with `save_every` also the end."""
        if self.save_every is None:
            return self.save_at or ()
        # An interval that rounding leaves before the end is not a step of its own.
        full_intervals = round(self.end / self.save_every * (1.0 - 1e-9) - 0.5)
        return (*(self.save_every * (i + 1) for i in range(full_intervals)), self.end)
