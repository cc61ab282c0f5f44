"""The config of a scene, complete."""

from typing import Annotated, Any, Literal

from pydantic import Field

from .cross_checks import no_such_body, not_saved, twice_emitted
from .fields import Flag, NotEmpty
from .model import Mistake, Model
from .schema_geometry import BodyConfig
from .schema_image import CameraConfig, ImageConfig, PinholeConfig
from .schema_solver import AutoSolver, SolverConfig
from .schema_terms import TermConfig
from .schema_time import TimeConfig


class SceneConfig(Model):
    """A scene, its run and its images, in SI units."""

    name: Annotated[str, Field(min_length=1)] | None = None
    allow_extreme_temperatures: Flag = False
    dtype: Literal["float32", "float64"] = "float32"
    bodies: Annotated[tuple[BodyConfig, ...], NotEmpty]
    terms: tuple[TermConfig, ...] = ()
    time: TimeConfig
    solver: SolverConfig = AutoSolver()
    camera: CameraConfig = PinholeConfig()
    image: ImageConfig = ImageConfig()

    @classmethod
    def raw_mistakes(cls, data: dict[str, Any]) -> list[Mistake]:
        """Parts that do not fit together, even while other parts are wrong."""
        return [*no_such_body(data), *not_saved(data), *twice_emitted(data)]
