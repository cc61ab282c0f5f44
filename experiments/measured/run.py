"""`experiments run measured`: measured temperatures, and what runs make of them."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..harness.case import Check, Group, case
from ..harness.report import CasesResult, PageTexts, run_cases
from . import data, module, sky, wall
from .folds import left_out, residuals_of, rms
from .laws import DAYTIME, RUNNING_IN
from .peers import faiman_with_lag


def _below(name: str, computed: float, highest: float, unit: str = "K") -> Check:
    return Check(name, computed, highest=highest, lowest=-highest, unit=unit)


def _module(file: str, ratio: float) -> Iterator[Check]:
    columns = data.read_module(file)
    day = columns["day"][1:]
    is_lit = columns["irradiance_plane_W_m2"][1:] > DAYTIME
    residuals = residuals_of(module.problem(columns))
    plain = residuals.at(np.zeros(residuals.size))
    fitted = left_out(residuals, day, used=np.ones(len(day), bool))
    peer = left_out(faiman_with_lag(columns), day, used=is_lit)
    yield _below("rms by day, without a fit", rms(plain[is_lit]), 3.5)
    share = rms(fitted[is_lit]) / rms(peer[is_lit])
    yield _below("fitted, over Faiman's model with a lag", share, ratio, unit="")
    if (~is_lit).sum() > len(is_lit) / 4:
        yield _below("bias by night, without a fit", plain[~is_lit].mean(), 3.0)
        yield _below("bias by night, fitted", fitted[~is_lit].mean(), 1.0)


@case(
    "module, one minute",
    title="photovoltaic module, four days in March 2020, days and nights",
    source="PV Performance Labs, in the repository of pvlib",
    requirement="rms 3.5 K without a fit; 0.85 of Faiman's model on days left out",
    method="one cell; steps of 60 s",
)
def _one_minute() -> Iterator[Check]:
    return _module("pv_module_one_minute.csv", ratio=0.85)


@case(
    "module, Tempe",
    title="photovoltaic module in Arizona, six days of 2016",
    source="in the repository of pvlib",
    requirement="rms 3.5 K without a fit; 1.0 of Faiman's model on days left out",
    method="one cell; steps of 60 s",
)
def _tempe() -> Iterator[Check]:
    return _module("pv_module_tempe_ten_minutes.csv", ratio=1.0)


@case(
    "wall",
    title="west wall of a test house, 41 days",
    source="IEA EBC Annex 58, Twin Houses, Holzkirchen",
    requirement="outer surface 1.5 K rms without a fit, layer 0.2 K",
    method="two sheets of 6 and 13 cells; steps of 10 min",
)
def _wall() -> Iterator[Check]:
    columns = data.read_table("twin_house_west_wall.csv")
    is_late = columns["time_s"][1:] > RUNNING_IN
    for name, highest in (("outer_surface_degC", 1.5), ("layer_degC", 0.2)):
        residuals = residuals_of(wall.problem(columns, name))
        plain = residuals.at(np.zeros(residuals.size))
        used = is_late & np.isfinite(columns[name][1:])
        words = name.removesuffix("_degC").replace("_", " ")
        yield _below(f"{words}, rms without a fit", rms(plain[used]), highest)


@case(
    "sky",
    title="long wave of the sky from air, humidity and the diffuse share",
    source="IEA EBC Annex 58, Twin Houses, Holzkirchen",
    requirement="40 W/m^2 rms on the days by which the law was not chosen",
)
def _sky() -> Iterator[Check]:
    columns = data.read_table("twin_house_west_wall.csv")
    errors = sky.errors(columns)
    chooses = sky.is_chosen_by(columns)
    best = min(errors, key=lambda laws: rms(errors[laws][chooses]))
    name = f"{best[0]}, {best[1]}, {best[2]:g} h"
    yield _below(name, rms(errors[best][~chooses]), 40.0, unit="W/m^2")


GROUPS = (
    Group("Photovoltaic modules", (_one_minute, _tempe)),
    Group("A wall and its sky", (_wall, _sky)),
)

PAGE = PageTexts(
    "Measured temperatures",
    (
        "The laws and numbers of these runs, with their sources, are in "
        "experiments/measured/laws.py; they were written down before the first "
        "comparison.",
    ),
)


def run(folder: Path, cases: str | None = None) -> CasesResult:
    """Run the cases whose ids begin so, such as "wall,sky", or all; write the page.

    Without the folder of the measured series it says so, and exits with status 0.
    """
    if data.folder() is None:
        sys.stdout.write(
            f"measured: {data.VARIABLE} names no folder with measured series: nothing "
            "is compared\n"
        )
        sys.exit(0)
    return run_cases(GROUPS, names=cases, folder=folder, texts=PAGE, at_once=1)
