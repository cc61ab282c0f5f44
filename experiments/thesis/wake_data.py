"""Mean wakes of a cylinder by Reynolds number, computed and fitted: the package's data.

`make wakes` runs it and copies both files to `jaxthermo/data`.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TypedDict

import numpy as np

from jaxthermo.console.terminal import open_console
from jaxthermo.flow.measures import (
    force_coefficient,
    recirculation_length,
    strouhal,
)
from jaxthermo.flow.run import FlowRun
from jaxthermo.flow.wake_fit import WakeFit, fit_wakes, write_fits
from jaxthermo.flow.wake_runs import (
    SHEDDING_REYNOLDS,
    STEADY_REYNOLDS,
    WakeProfile,
    wake_profile,
    wake_run,
    wake_setup,
    write_profiles,
)
from jaxthermo.report.table import Table

from ..harness.present import show, table_of


def fitted(profiles: tuple[WakeProfile, ...]) -> tuple[WakeFit, ...]:
    """Fits of the steady and the shedding wakes among profiles."""
    steady, shedding = (
        tuple(profile for profile in profiles if profile.reynolds in numbers)
        for numbers in (STEADY_REYNOLDS, SHEDDING_REYNOLDS)
    )
    return (
        fit_wakes("steady", steady, remains=False),
        fit_wakes("shedding", shedding, remains=True),
    )


class _FlowRow(TypedDict):
    """Numbers of the flow at one Reynolds number."""

    Re: float
    cells: list[int]
    steps: int
    drag: float
    """Drag coefficient [-]."""
    strouhal: float | None
    """None where no vortices are shed."""
    bubble: float
    """Length of the recirculation [diameters]."""


class _FitRow(TypedDict):
    """Errors of a fit of wakes."""

    kind: str
    rms: float
    largest: float


class _WakeResult(TypedDict):
    """All flows and fits, and the files that hold them."""

    flows: list[_FlowRow]
    fits: list[_FitRow]
    files: list[str]


def run(folder: Path, height: int | None = None) -> _WakeResult:
    """Compute all wakes: `wake_profiles.csv` and `wake_fit.csv`.

    `height` is the number of cells across the cylinder, of a coarser lattice.
    """
    console = open_console()
    rows = []
    profiles = []
    for reynolds in (*STEADY_REYNOLDS, *SHEDDING_REYNOLDS):
        with console.status(f"Re {reynolds:g}") as status:
            flow = wake_run(
                reynolds,
                wake_setup(reynolds, height),
                progress=lambda step, re=reynolds: status.update(
                    f"Re {re:g}: {step.text}"
                ),
            )
        rows.append(_numbers(flow, reynolds))
        profiles.append(wake_profile(flow, reynolds))
    fits = fitted(tuple(profiles))
    write_profiles(folder / "wake_profiles.csv", profiles)
    write_fits(folder / "wake_fit.csv", fits)
    show(_table(rows))
    return {
        "flows": rows,
        "fits": [
            {"kind": fit.regime, "rms": fit.rms, "largest": fit.largest} for fit in fits
        ],
        "files": ["wake_profiles.csv", "wake_fit.csv"],
    }


def _numbers(flow: FlowRun, reynolds: float) -> _FlowRow:
    drag = force_coefficient(flow.channel, flow.drag[flow.averaged].astype(float))
    frequency = strouhal(flow)
    return {
        "Re": reynolds,
        "cells": list(flow.channel.shape),
        "steps": int(flow.step[-1]),
        "drag": float(drag.mean()),
        "strouhal": None if np.isnan(frequency) else frequency,
        "bubble": recirculation_length(flow),
    }


def _table(rows: Sequence[_FlowRow]) -> Table:
    columns = [
        ("Re", "{Re:g}"),
        ("steps", "{steps:,}"),
        ("drag coefficient", "{drag:.3f}"),
        ("Strouhal number", lambda r: f"{r['strouhal']:.4f}" if r["strouhal"] else ""),
        ("bubble [diameters]", "{bubble:.3f}"),
    ]
    return table_of(rows, columns, "Wakes by Reynolds number")
