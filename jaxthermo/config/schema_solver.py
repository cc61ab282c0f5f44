"""How time is stepped."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from .fields import Auto, Number, PositiveTime, Whole
from .kinds import KindModel, by_kind, short_kind


Step = Annotated[PositiveTime | None, Auto]
"""None: as the kind has it."""
Kelvin = Annotated[Number, Field(gt=0)]
"""A difference of temperature."""
Tolerance = Annotated[Kelvin | None, Auto]
Stages = Annotated[Annotated[Whole, Field(ge=3, le=1000)] | None, Auto]


class AutoSolver(KindModel):
    """Chosen from the scene."""

    kind: Literal["auto"] = "auto"


class ForwardEuler(KindModel):
    """Explicit; without `dt`, at the largest stable step."""

    kind: Literal["forward_euler"] = "forward_euler"
    dt: Step = None


class SuperTimeStepping(KindModel):
    """Explicit, in many stages."""

    kind: Literal["super_time_stepping"] = "super_time_stepping"
    dt: Step = None
    stages: Stages = None


class BackwardEuler(KindModel):
    """Implicit, first order."""

    kind: Literal["backward_euler"] = "backward_euler"
    dt: Step = None
    tolerance: Tolerance = None


class TRBDF2(KindModel):
    """Implicit, second order; without `dt`, in steps that follow the error [K]."""

    kind: Literal["trbdf2"] = "trbdf2"
    dt: Step = None
    error: Kelvin = 0.01
    tolerance: Tolerance = None


class CrankNicolson(KindModel):
    """Implicit, second order, rings."""

    kind: Literal["crank_nicolson"] = "crank_nicolson"
    dt: Step = None
    tolerance: Tolerance = None


SolverConfig = Annotated[
    Annotated[AutoSolver, Tag("<auto>")]
    | Annotated[ForwardEuler, Tag("<forward_euler>")]
    | Annotated[SuperTimeStepping, Tag("<super_time_stepping>")]
    | Annotated[BackwardEuler, Tag("<backward_euler>")]
    | Annotated[TRBDF2, Tag("<trbdf2>")]
    | Annotated[CrankNicolson, Tag("<crank_nicolson>")],
    Discriminator(by_kind),
    short_kind("forward_euler"),
]
"""A word alone stands for `{kind: word}`; `dt` without a kind is explicit Euler's."""
