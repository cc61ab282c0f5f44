"""Where a body stands, or how it moves."""

from typing import Annotated, Any

from pydantic import Discriminator, Tag

from .fields import Angle, Direction, NotEmpty, Position, PositiveTime, Time
from .model import Mistake, Model
from .schema_varying import not_increasing, unequal


class RotationConfig(Model):
    """A turn about an axis through the origin, anticlockwise seen against it."""

    axis: Direction
    angle: Angle


class PoseConfig(Model):
    """Where the body is in the scene: first turned, then moved."""

    translation: Position = (0.0, 0.0, 0.0)
    rotation: RotationConfig | None = None


class MotionConfig(Model):
    """Poses at times, between which the body moves; the geometry taken anew `every`."""

    times: Annotated[tuple[Time, ...], NotEmpty]
    poses: tuple[PoseConfig, ...]
    every: PositiveTime | None = None

    def mistakes(self) -> list[Mistake]:
        """Times that do not increase; lengths that differ."""
        found = not_increasing(self.times, "times", "s")
        return [*found, *unequal(self.poses, "poses", self.times, "times")]


def _rests_or_moves(value: Any) -> str:
    moves = isinstance(value, MotionConfig)
    if isinstance(value, dict):
        moves = not {"times", "poses", "every"}.isdisjoint(value)
    return "<moves>" if moves else "<rests>"


AnyPose = Annotated[
    Annotated[PoseConfig, Tag("<rests>")] | Annotated[MotionConfig, Tag("<moves>")],
    Discriminator(_rests_or_moves),
]
