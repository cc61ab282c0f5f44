"""Mean wakes of a cylinder by Reynolds number, computed and fitted: the package's data.

`make wakes` runs it and copies both files to `jaxthermo/data`.
"""

from pathlib import Path
from typing import Any

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

from ..harness.present import Rows, show, table_of


def fitted(profiles: tuple[WakeProfile, ...]) -> tuple[WakeFit, ...]:
    """Fits of the steady and the shedding wakes among profiles."""
    of = lambda numbers: tuple(p for p in profiles if p.reynolds in numbers)
    return (
        fit_wakes("steady", of(STEADY_REYNOLDS), remains=False),
        fit_wakes("shedding", of(SHEDDING_REYNOLDS), remains=True),
    )


def run(folder: Path, height: int | None = None) -> dict[str, Any]:
    """Compute all wakes, some 25 minutes: `wake_profiles.csv` and `wake_fit.csv`.

    `height` is the number of cells across the cylinder, of a coarser lattice.
    """
    console, rows, profiles = open_console(), [], []
    for reynolds in (*STEADY_REYNOLDS, *SHEDDING_REYNOLDS):
        with console.status(f"Re {reynolds:g}") as status:
            found = wake_run(
                reynolds,
                wake_setup(reynolds, height),
                progress=lambda at, re=reynolds: status.update(f"Re {re:g}: {at.text}"),
            )
        rows.append(_numbers(found, reynolds))
        profiles.append(wake_profile(found, reynolds))
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


def _numbers(found: FlowRun, reynolds: float) -> dict[str, Any]:
    drag = force_coefficient(found.channel, found.drag[found.averaged].astype(float))
    frequency = strouhal(found)
    return {
        "Re": reynolds,
        "cells": list(found.channel.shape),
        "steps": int(found.step[-1]),
        "drag": float(drag.mean()),
        "strouhal": None if frequency != frequency else frequency,
        "bubble": recirculation_length(found),
    }


def _table(rows: Rows) -> Table:
    columns = [
        ("Re", "{Re:g}"),
        ("steps", "{steps:,}"),
        ("drag coefficient", "{drag:.3f}"),
        ("Strouhal number", lambda r: f"{r['strouhal']:.4f}" if r["strouhal"] else ""),
        ("bubble [diameters]", "{bubble:.3f}"),
    ]
    return table_of(rows, columns, "Wakes by Reynolds number")
