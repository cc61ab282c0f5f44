"""Limits that a finished run missed: those of its error in time and of its energy.

Steps that are halved do not show an error that all of them share, such as heat that
rounding loses. The energy ledger does: the residual of a body, stored heat less the
heat of all mechanisms, is a change of its mean temperature by

    residual / C    [K],

C its heat capacity [J/K]. The stated error in time is never below that.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...choices import Dtype
from ...scene.compile.program import Program
from ..ledger import EnergyTable
from .time_error import TimeError


_LARGEST_RELATIVE = 1e-4
"""Residual over the heat that passed above which energy does not close."""

_ROUNDING = 1e-5
"""Residual over the heat that passed up to which it is rounding of float32."""


class EnergyResidual(NamedTuple):
    """Largest energy residual of a run at any saved time."""

    relative: Float[Array, ""] | float
    """Over the heat that passed [-]."""
    kelvin: Float[Array, ""] | float
    """Over the heat capacity of the body [K]."""


def energy_residual(program: Program, energy: EnergyTable) -> EnergyResidual:
    """Return the largest residuals of the energies of a run."""
    kelvin = jnp.abs(energy.residual_of_bodies) / program.total_capacity()[None]
    return EnergyResidual(relative=jnp.abs(energy.relative).max(), kelvin=kelvin.max())


class JudgedRun(NamedTuple):
    """The error in time that a run states, and the limits that it missed."""

    error: TimeError | None
    warnings: tuple[str, ...]
    """One line each: what, how much, and what to do."""


def judged_run(
    error: TimeError | None, residual: EnergyResidual, dtype: Dtype
) -> JudgedRun:
    """Return the error in time with the energy residual, and a line a missed limit.

    `error` is the estimate from passes, None if there is none; `dtype` is that of the
    state.
    """
    relative = float(residual.relative)
    kelvin = float(residual.kelvin)
    lost = relative > _LARGEST_RELATIVE
    if error is not None and kelvin > error.kelvin:
        lost = lost or relative > _ROUNDING
        error = error._replace(kelvin=kelvin, cause="the energy does not close")
    lines = []
    if lost:
        remedy = (
            "use dtype float64"
            if dtype == "float32"
            else "give a solver with a shorter step or a smaller tolerance"
        )
        text = (
            f"the energy does not close: {relative:.1e} of the heat that passed is "
            f"missing, {kelvin:.2g} K of a body's mean temperature; {remedy}"
        )
        lines.append(text)
    if error is not None and not error.holds:
        lines.append(error.text())
    return JudgedRun(error, tuple(lines))
