"""A photovoltaic module in measured irradiance, wind and air."""

import math
from typing import Any

import numpy as np
from jaxtyping import Float
from typing_extensions import override

import jaxthermo as jt
from calibrate.problem.parameters import Parameter, ParameterSet
from calibrate.problem.problem import Case, Problem
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.physics.convection.linear_wind import linear_in
from jaxthermo.physics.heat_source import VolumeBinding
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
from .thermocouple import thermocouple


STEP = 60.0  # [s]


class CellHeat(jt.AbstractVolumeTerm):
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


def power(columns: Columns) -> Float[np.ndarray, " t"]:
    """Electric power by area [W/m^2]."""
    if "electric_power_W" in columns:
        return columns["electric_power_W"] / MODULE_AREA
    return ELECTRIC_SHARE * columns["irradiance_plane_W_m2"]


def scene(columns: Columns, law: WindLaw = WATMUFF, sky: str = "swinbank") -> jt.Scene:
    """The module on the days of a file, at the start as warm as the air."""
    time = columns["time"]
    air = kelvin(columns["air_temperature_C"])
    sky_kelvin = swinbank_sky_temperature(air)
    if sky == "berdahl_martin":
        lowest = [air[columns["day"] == day].min() for day in columns["day"]]
        sky_kelvin = clear_sky_temperature(air, np.array(lowest), time / 3600)
    thickness = float(sum(layer.thickness for layer in MODULE))

    def table(values: Float[np.ndarray, " t"]) -> jt.Table:
        return jt.Table(time, values)

    sheet = jt.Sheet(jt.shapes.rectangle(1.0, 1.45), MODULE, pitch=2.0, cells=1)
    emissivities = {"front": 0.84, "back": 0.85}
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
    wind = jt.LinearWind(
        table(columns["wind_speed_m_s"]),
        table(air),
        calm=law.calm,
        by_speed=law.by_speed,
    )
    terms = (
        CellHeat(ABSORPTANCE, table(light)),
        jt.HeatSource(table(-power(columns) / thickness)),
        wind,
        jt.Surroundings(table(sky_kelvin), ground=table(air)),
    )
    return jt.Scene((body,), terms, dtype="float64")


def problem(columns: Columns, law: WindLaw = WATMUFF, sky: str = "swinbank") -> Problem:
    """The numbers that are fitted, and the back as data after the first row."""
    module = scene(columns, law, sky)
    saves = tuple(columns["time"][1:].tolist())
    face = module.bodies[0].structure.grid.fragment_face
    assert face is not None
    target = thermocouple(
        saves,
        kelvin(columns["module_temperature_C"])[1:],
        fragment=int(np.flatnonzero(face == 1)[0]),
        fragments=len(face),
    )
    run = ParametricRun(saves, jt.SuperTimeStepping(dt=STEP, stages=3))
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
