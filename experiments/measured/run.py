"""`experiments run measured`: measured temperatures, and what runs make of them."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from calibrate.problem.problem import Problem

from ..harness.case import Check, Group, Row, case
from ..harness.report import CasesResult, PageTexts, run_cases
from . import data, literature, module, sky, soil, wall
from .folds import Residuals, fitted, judged, left_out, residuals_of, rms
from .laws import DAYTIME, RUNNING_IN, SOILS, WATMUFF, WIND_LAWS
from .peers import MODELS, faiman_with_lag
from .rows import by_group, fitted_values, limited


_TWIN_HOUSE = "IEA EBC Annex 58, Twin Houses, Holzkirchen"
_ON_WALL = "rms on the wall, other days"
_DAY = 86400.0  # [s]


def _scores(
    errors: Float[np.ndarray, " t"],
    is_lit: Bool[np.ndarray, " t"],
    highest: float = np.inf,
    highest_by_night: float = np.inf,
) -> tuple[Check, ...]:
    """Errors of a module by day, and by night where there are nights."""
    checks = [limited("rms by day", rms(errors[is_lit]), highest)]
    if (~is_lit).sum() > len(is_lit) / 4:
        night = errors[~is_lit].mean()
        checks.append(limited("bias by night", night, highest_by_night))
    return tuple(checks)


def _unfitted(columns: data.Columns) -> Iterator[tuple[str, Float[np.ndarray, " t"]]]:
    """Errors of a module by other laws than those that the limits are for."""
    for law in WIND_LAWS:
        if law is not WATMUFF:
            scene = module.scene(columns, module.linear_wind(columns, law))
            yield f"wind by {law.source}", module.errors(columns, scene)
    for name, is_buoyant in (("wind", False), ("wind and free convection", True)):
        scene = module.scene(columns, module.flat_plate(columns, is_buoyant))
        yield f"{name} of a flat plate", module.errors(columns, scene)
    scene = module.scene(columns, module.linear_wind(columns), sky="berdahl_martin")
    yield "sky by Berdahl and Martin", module.errors(columns, scene)


def _module(file: str, highest_share: float) -> Iterator[Row]:
    columns = data.read_module(file)
    day = columns["day"][1:]
    is_lit = columns["irradiance_plane_W_m2"][1:] > DAYTIME
    everything = np.ones(len(day), bool)
    for name, model in MODELS.items():
        errors = (model(columns) - columns["module_temperature_C"])[1:]
        yield Row("models", name, checks=_scores(errors, is_lit))
    lagged = left_out(faiman_with_lag(columns), day, used=is_lit)
    name = "Faiman with a lag, fitted to the other days"
    yield Row("models", name, checks=_scores(lagged, is_lit))
    for name, errors in _unfitted(columns):
        yield Row("models", f"without a fit, {name}", checks=_scores(errors, is_lit))
    problem = module.problem(columns)
    residuals = residuals_of(problem)
    plain = residuals.at(np.zeros(residuals.size))
    checks = _scores(plain, is_lit, highest=3.5, highest_by_night=3.0)
    yield Row("models", "without a fit", checks=checks)
    by_others = left_out(residuals, day, used=everything)
    checks = _scores(by_others, is_lit, highest_by_night=1.0)
    share = rms(by_others[is_lit]) / rms(lagged[is_lit])
    over = limited("over Faiman's with a lag", share, highest_share, unit="")
    yield Row("models", "fitted to the other days", checks=(*checks, over))
    models = {"without a fit": plain, "fitted": by_others}
    yield from by_group("hours", _hours(columns), models)
    yield from by_group("winds by day", _winds(columns, is_lit), models)
    days = {f"day {n + 1:.0f}": is_lit & (day == n) for n in np.unique(day)}
    yield from by_group("days", days, {**models, "Faiman with a lag": lagged})
    names = ("absorptance", "coefficient by wind", "emissivity")
    yield from _values(problem, residuals, names, used=everything)


def _values(
    problem: Problem,
    residuals: Residuals,
    names: Sequence[str],
    used: Bool[np.ndarray, " t"],
) -> Iterator[Row]:
    """The numbers of a problem, by these names, fitted to all rows that are used."""
    z = fitted(residuals, used)
    identified = judged(problem.parameters, residuals, z=z, used=used)
    labels = problem.parameters.labels
    return fitted_values(identified, dict(zip(labels, names, strict=True)))


def _hours(columns: data.Columns) -> Mapping[str, Bool[np.ndarray, " t"]]:
    hour = columns["hour"][1:]
    return {
        f"{start} to {start + 3} h": (hour >= start) & (hour < start + 3)
        for start in range(0, 24, 3)
    }


def _winds(
    columns: data.Columns, is_lit: Bool[np.ndarray, " t"]
) -> Mapping[str, Bool[np.ndarray, " t"]]:
    speed = columns["wind_speed_m_s"][1:]
    ranges = {
        "below 1 m/s": (0.0, 1.0),
        "1 to 2 m/s": (1.0, 2.0),
        "2 to 4 m/s": (2.0, 4.0),
        "above 4 m/s": (4.0, np.inf),
    }
    return {
        name: is_lit & (speed >= low) & (speed < high)
        for name, (low, high) in ranges.items()
    }


@case(
    "module-one-minute",
    title="photovoltaic module, four days in March 2020, days and nights",
    source="PV Performance Labs, in the repository of pvlib",
    requirement="rms 3.5 K without a fit; 0.85 of Faiman's model on days left out",
    method="one cell; steps of 60 s",
)
def _one_minute() -> Iterator[Row]:
    return _module("pv_module_one_minute.csv", highest_share=0.85)


@case(
    "module-tempe",
    title="photovoltaic module in Arizona, six days of 2016",
    source="in the repository of pvlib",
    requirement="rms 3.5 K without a fit; 1.0 of Faiman's model on days left out",
    method="one cell; steps of 60 s",
)
def _tempe() -> Iterator[Row]:
    return _module("pv_module_tempe_ten_minutes.csv", highest_share=1.0)


_WALL_LIMITS = {
    "outer_surface_degC": (1.5, 1.0),
    "layer_degC": (0.2, np.inf),
    "layer_heat_flux_W_m2": (np.inf, np.inf),
    "inner_heat_flux_W_m2": (np.inf, np.inf),
}
"""Highest rms without a fit and with one, by the column of the data."""


@case(
    "wall",
    title="west wall of a test house, 41 days",
    source=_TWIN_HOUSE,
    requirement="outer surface 1.5 K rms without a fit and 1.0 K on the half of the "
    "days that it was not fitted to; layer 0.2 K",
    method="two sheets of 6 and 14 cells; steps of 10 min",
)
def _wall() -> Iterator[Row]:
    columns = data.read_table("twin_house_west_wall.csv")
    time = columns["time_s"][1:]
    is_known = np.isfinite(columns["outer_surface_degC"][1:])
    used = is_known & (time > RUNNING_IN)
    scene = wall.scene(columns)
    plain = wall.errors(columns, scene)
    problem = wall.problem(columns)
    residuals = residuals_of(problem)
    # Every second day has an answer.
    is_even = time // _DAY // 2 % 2 == 0
    halves = {"first": used & is_even, "second": used & ~is_even}
    fits = {
        name: wall.errors(
            columns, problem.parameters.insert(scene, fitted(residuals, half))
        )
        for name, half in halves.items()
    }
    for column, (highest, highest_fitted) in _WALL_LIMITS.items():
        unit = _unit(column)
        errors = plain[column][used]
        checks = [
            limited("rms without a fit", rms(errors), highest, unit),
            Check("bias without a fit", errors.mean(), unit=unit),
        ]
        for name, half in halves.items():
            words = f"rms of the other days, fitted to the {name} half"
            other = fits[name][column][used & ~half]
            checks.append(limited(words, rms(other), highest_fitted, unit))
        what = "temperatures" if unit == "K" else "heat fluxes"
        yield Row(what, _words(column), checks=tuple(checks))
    is_night = columns["global_west_W_m2"][1:] < DAYTIME
    groups = {"day": used & ~is_night, "night": used & is_night}
    yield from by_group(
        "outer surface", groups, {"without a fit": plain["outer_surface_degC"]}
    )
    names = ("absorptance", "coefficient in still air", "coefficient by wind")
    yield from _values(problem, residuals, names, used=used)


def _unit(column: str) -> str:
    return "W/m^2" if column.endswith("_W_m2") else "K"


def _words(column: str) -> str:
    """The name of a column without its unit."""
    return column.replace("_degC", "").replace("_W_m2", "").replace("_", " ")


@case(
    "soil",
    title="soil at a test house, from its surface and 2 m below it, 41 days",
    source=_TWIN_HOUSE,
    requirement="none: the soil is not known",
    method="a column of 40 voxels; steps of 10 min",
)
def _soil() -> Iterator[Row]:
    columns = data.read_table("twin_house_west_wall.csv")
    is_late = columns["time_s"][1:] > RUNNING_IN
    for name in SOILS:
        for column, errors in soil.errors(columns, name).items():
            used = errors[is_late & np.isfinite(errors)]
            checks = (
                Check("rms", rms(used), unit="K"),
                Check("bias", used.mean(), unit="K"),
            )
            label = f"{_words(name)}, {_words(column)}"
            yield Row("soils", label, checks=checks)


_SHOWN_SKIES = (
    ("Swinbank 1963", "none", 24.0),
    ("Berdahl and Martin 1984", "none", 24.0),
    ("Berdahl and Martin 1984", "Walton 1983", 24.0),
)
"""Laws that are shown beside the one that is chosen."""


@case(
    "sky",
    title="long wave of the sky from air, humidity and the diffuse share",
    source=_TWIN_HOUSE,
    requirement="40 W/m^2 rms on the days by which the law was not chosen",
)
def _sky() -> Iterator[Row]:
    columns = data.read_table("twin_house_west_wall.csv")
    errors = sky.errors(columns)
    chooses = sky.is_chosen_by(columns)

    def choice(laws: tuple[str, str, float]) -> float:
        return rms(errors[laws][chooses])

    walton = min((laws for laws in errors if laws[1] == "Walton 1983"), key=choice)
    best = min(errors, key=choice)
    measured = columns["longwave_horizontal_W_m2"]
    for laws in (*_SHOWN_SKIES, walton, best):
        highest = 40.0 if laws == best else np.inf
        clear, clouds, window = laws
        on_wall = sky.on_the_wall(columns, errors[laws] + measured)
        yield Row(
            "laws",
            f"{clear}, clouds: {clouds}, {window:g} h",
            checks=(
                Check("rms, days of choice", choice(laws), unit="W/m^2"),
                limited(
                    "rms, other days", rms(errors[laws][~chooses]), highest, "W/m^2"
                ),
                Check("bias, other days", errors[laws][~chooses].mean(), unit="W/m^2"),
                Check(_ON_WALL, rms(on_wall[~chooses]), unit="W/m^2"),
            ),
        )
    on_wall = rms(sky.on_the_wall(columns, measured)[~chooses])
    checks = (Check(_ON_WALL, on_wall, unit="W/m^2"),)
    yield Row("laws", "measured on the horizontal", checks=checks)


GROUPS = (
    Group("Photovoltaic modules", (_one_minute, _tempe)),
    Group("A wall, its sky and its soil", (_wall, _sky, _soil)),
    literature.GROUP,
)

PAGE = PageTexts(
    "Measured temperatures",
    (
        "The laws and numbers of modules, wall, sky and soil, with their sources, are "
        "in experiments/measured/laws.py; they were written down before the first "
        "comparison. The limits of convection and of the ground over a day were set "
        "after theirs.",
    ),
)


def run(folder: Path, cases: str | None = None) -> CasesResult:
    """Run the cases whose ids begin so, such as "wall,sky", or all; write the page.

    Without the folder of the measured series it says so, and runs the cases whose
    numbers are of the literature.
    """
    # A module that is loaded lazily by two cases at once has gaps for one of them.
    with suppress(ModuleNotFoundError):
        import_module("pvlib.temperature")
    groups = GROUPS
    if data.folder() is None:
        groups = (literature.GROUP,)
        sys.stdout.write(
            f"measured: {data.VARIABLE} names no folder with measured series: only "
            "cases of the literature are compared\n"
        )
    return run_cases(groups, names=cases, folder=folder, texts=PAGE, at_once=3)
