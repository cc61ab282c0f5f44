"""The times at which a run ends and saves."""

from typing import Annotated, ClassVar

from .fields import NotEmpty, PositiveTime
from .model import Mistake, Model
from .schema_varying import not_increasing


_MOST_SAVES = 100_000


class TimeConfig(Model):
    """When the run ends, and at which times its state is kept."""

    end: PositiveTime
    save_at: Annotated[tuple[PositiveTime, ...], NotEmpty] | None = None
    save_every: PositiveTime | None = None

    exactly_one: ClassVar = (("save_at", "save_every"),)

    def mistakes(self) -> list[Mistake]:
        """Saved times that do not increase, or lie after the end."""
        found = not_increasing(self.save_at or (), "save_at", "s")
        for i, time in enumerate(self.save_at or ()):
            if time > self.end:
                message = f"{time:g} s is after the end, {self.end:g} s"
                found.append((("save_at", i), message))
        if self.save_every is not None:
            if self.save_every > self.end:
                message = f"{self.save_every:g} s is after the end, {self.end:g} s"
                found.append((("save_every",), message))
            if self.end / self.save_every > _MOST_SAVES:
                message = f"would save more than {_MOST_SAVES} times"
                found.append((("save_every",), message))
        return found

    @property
    def save_times(self) -> tuple[float, ...]:
        """The times at which the state is kept [s]; the end is one of `save_every`."""
        if self.save_every is None:
            return self.save_at or ()
        whole = round(self.end / self.save_every * (1.0 - 1e-9) - 0.5)
        return (*(self.save_every * (i + 1) for i in range(whole)), self.end)
