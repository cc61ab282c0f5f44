"""Time integration: the solver and its options."""

from typing import Annotated, Any

from pydantic import Field
from typing_extensions import override

from ..types.model import ByKind, KindModel, Short
from ..types.quantities import (
    TEMPERATURE_DIFFERENCE,
    Auto,
    Number,
    PositiveTime,
    Whole,
)


_Step = Annotated[PositiveTime | None, Auto]
_Kelvin = Annotated[float, TEMPERATURE_DIFFERENCE, Field(gt=0)]
_Tolerance = Annotated[_Kelvin | None, Auto]
_Stages = Annotated[Annotated[Whole, Field(ge=3, le=1000)] | None, Auto]


class AutoSolver(KindModel, kind="auto"):
    """Solver chosen from the scene."""

    @override
    def build(self, *args: Any) -> None:
        # `simulate` chooses a solver if it gets none.
        return None


class _ForwardEuler(KindModel, builds="ForwardEuler", kind="forward_euler"):
    """Explicit, first order; without `dt`, at the largest stable step."""

    dt: _Step = None


class _SuperTimeStepping(
    KindModel, builds="SuperTimeStepping", kind="super_time_stepping"
):
    """Explicit, in many stages."""

    dt: _Step = None
    stages: _Stages = None


class _BackwardEuler(KindModel, builds="BackwardEuler", kind="backward_euler"):
    """Implicit, first order."""

    dt: _Step = None
    tolerance: _Tolerance = None


class _TRBDF2(KindModel, builds="TRBDF2", kind="trbdf2"):
    """Implicit, second order; without `dt`, in steps that follow the error [K]."""

    dt: _Step = None
    error: _Kelvin = 0.01
    tolerance: _Tolerance = None


class _CrankNicolson(KindModel, builds="CrankNicolson", kind="crank_nicolson"):
    """Implicit, second order; oscillates after a jump."""

    dt: _Step = None
    tolerance: _Tolerance = None


class _ErrorControl(KindModel, builds="ErrorControl", kind="error_control"):
    """Second order, in steps that keep the error of the whole run below a limit [K]."""

    relative_error: Annotated[Number, Field(gt=0)] = 1e-3
    error: _Kelvin = 1e-3


# A word alone stands for `{kind: word}`; `dt` without a kind is explicit Euler's.
SolverConfig = Annotated[
    AutoSolver
    | _ForwardEuler
    | _SuperTimeStepping
    | _BackwardEuler
    | _TRBDF2
    | _CrankNicolson
    | _ErrorControl,
    ByKind(),
    Short("kind", "forward_euler"),
]
