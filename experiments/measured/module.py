"""A photovoltaic module in measured irradiance, wind and air."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from typing_extensions import override

import jaxthermo as jt
from calibrate.problem.parameters import Parameter, ParameterSet
from calibrate.problem.problem import Case, Problem
from jaxthermo.choices import FaceName
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.physics.convection.linear_wind import linear_in
from jaxthermo.physics.heat_source import VolumeBinding
from jaxthermo.physics.term import AbstractTerm
from jaxthermo.weather.sky import clear_sky_temperature, swinbank_sky_temperature

from .data import Columns, kelvin
from .laws import (
    ABSORPTANCE,
    ELECTRIC_SHARE,
    MODULE,
    MODULE_AREA,
    TILT,
    WATMUFF,
    WindLaw,
)
from .thermocouple import fragment_of, thermocouple


# More stages than all laws need, so that they share a program.
_SOLVER = jt.SuperTimeStepping(dt=60.0, stages=5)


class _CellHeat(jt.AbstractVolumeTerm):
    """Sunlight that the cells of a module absorb, a E over its thickness [W/m^3]."""

    name = "cell_heat"

    absorptance: Any
    """a of the module [-]."""
    irradiance: Any
    """E in its plane over its thickness [W/m^3]."""

    @override
    def bind(self, structure: Any, body: int) -> VolumeBinding:
        density = linear_in(self.irradiance, 0.0, slope=self.absorptance)
        return VolumeBinding(np.asarray(structure.nodes().volume), density)


def _power(columns: Columns) -> Float[np.ndarray, " t"]:
    """Electric power by area [W/m^2]."""
    if "electric_power_W" in columns:
        return columns["electric_power_W"] / MODULE_AREA
    return ELECTRIC_SHARE * columns["irradiance_plane_W_m2"]


def linear_wind(columns: Columns, law: WindLaw = WATMUFF) -> tuple[AbstractTerm, ...]:
    """Wind by a law that is linear in its speed."""
    speed = _table(columns, np.maximum(columns["wind_speed_m_s"], 0.0))
    air = _table(columns, kelvin(columns["air_temperature_C"]))
    return (jt.LinearWind(speed, air, calm=law.calm, by_speed=law.by_speed),)


def flat_plate(columns: Columns, is_buoyant: bool) -> tuple[AbstractTerm, ...]:
    """Wind onto the front by the laws of plates, with or without free convection."""
    speed = _table(columns, np.maximum(columns["wind_speed_m_s"], 0.0))
    air = _table(columns, kelvin(columns["air_temperature_C"]))
    # The front faces up and to -y.
    wind = jt.Wind((0.0, 1.0, 0.0), air, speed=speed, body_shape="plate")
    still = jt.FreeConvection(air, body_shape="plate")
    return (wind, still) if is_buoyant else (wind,)


def _sky_kelvin(columns: Columns, law: str) -> Float[np.ndarray, " t"]:
    """Temperature of the sky by `swinbank` or `berdahl_martin` [K]."""
    air = kelvin(columns["air_temperature_C"])
    if law == "swinbank":
        return swinbank_sky_temperature(air)
    dew_point = np.array([air[columns["day"] == day].min() for day in columns["day"]])
    return clear_sky_temperature(air, dew_point, columns["hour"])


def scene(
    columns: Columns, wind: Sequence[AbstractTerm], sky: str = "swinbank"
) -> jt.Scene:
    """The module on the days of a file, at the start as warm as the air."""
    air = kelvin(columns["air_temperature_C"])
    thickness = float(sum(layer.thickness for layer in MODULE))
    sheet = jt.Sheet(jt.shapes.rectangle(1.0, 1.45), MODULE, pitch=2.0, cells=1)
    emissivities: Mapping[FaceName, float] = {"front": 0.84, "back": 0.85}
    body = jt.Body(
        sheet,
        temperature=float(air[0]),
        pose=jt.Pose.about((1.0, 0.0, 0.0), math.radians(TILT)),
        coatings=tuple(
            jt.Coating(emissivity, on=jt.Face(face))
            for face, emissivity in emissivities.items()
        ),
    )
    light = np.maximum(columns["irradiance_plane_W_m2"], 0.0) / thickness
    terms = (
        _CellHeat(ABSORPTANCE, _table(columns, light)),
        jt.HeatSource(_table(columns, -_power(columns) / thickness)),
        *wind,
        jt.Surroundings(
            _table(columns, _sky_kelvin(columns, sky)), ground=_table(columns, air)
        ),
    )
    return jt.Scene((body,), terms, dtype="float64")


def errors(columns: Columns, module: jt.Scene) -> Float[np.ndarray, " n"]:
    """Computed less measured temperature of the back, from the second row on [K]."""
    times = columns["time"][1:]
    solution = jt.simulate(
        module,
        float(times[-1]),
        save_at=times.tolist(),
        solver=_SOLVER,
    )
    computed = np.asarray(solution.surface_temperature)[:, fragment_of(module, "back")]
    return computed - kelvin(columns["module_temperature_C"])[1:]


def problem(columns: Columns) -> Problem:
    """The numbers that are fitted, and the back as data after the first row."""
    module = scene(columns, linear_wind(columns))
    saves = tuple(columns["time"][1:].tolist())
    target = thermocouple(
        saves,
        kelvin(columns["module_temperature_C"])[1:],
        fragment=fragment_of(module, "back"),
        fragments=len(module.bodies[0].structure.grid.fragment_area),
    )
    run = ParametricRun(saves, _SOLVER)
    return Problem(_parameters(), (Case("module", module, run, target),))


def _parameters() -> ParameterSet:
    """The numbers that are fitted."""
    emissivity = Parameter(
        "bodies.0.coatings.0.emissivity",
        (0.84,),
        lower=0.0,
        upper=1.0,
        tied=("bodies.0.coatings.1.emissivity",),
    )
    by_speed = Parameter("linear_wind.by_speed", (WATMUFF.by_speed,), 0.0, 20.0)
    absorptance = Parameter("cell_heat.absorptance", (ABSORPTANCE,), 0.5, 1.0)
    return ParameterSet((absorptance, by_speed, emissivity))


def _table(columns: Columns, values: Float[np.ndarray, " t"]) -> jt.Table:
    return jt.Table(columns["time"], values)
