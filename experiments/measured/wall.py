"""The west wall of a test house, in the long wave and the sunlight on its own plane."""

import numpy as np
from jaxtyping import Float

import jaxthermo as jt
from calibrate.problem.parameters import Parameter, ParameterSet
from calibrate.problem.problem import Case, Problem
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.weather.sky import sky_temperature

from .data import Columns, kelvin
from .laws import INNER_WALL, OUTER_WALL, WATMUFF, WindLaw
from .thermocouple import thermocouple


STEP = 600.0  # [s]
_GAP = 1e-3  # [m]
_SHORTEST_TIME = 600.0  # [s]
OUTSIDE = jt.Face("front", body=0)


def scene(columns: Columns, law: WindLaw = WATMUFF) -> jt.Scene:
    """The wall in two sheets, on both sides of its heat flux sensor."""
    time = columns["time_s"]
    outside = kelvin(columns["air_degC"])
    inside = kelvin(columns["inner_surface_degC"])

    def table(values: Float[np.ndarray, " t"]) -> jt.Table:
        return jt.Table(time, values)

    bodies = tuple(
        jt.Body(
            jt.Sheet(
                jt.shapes.rectangle(1.0, 1.0),
                layers,
                pitch=2.0,
                shortest_time=_SHORTEST_TIME,
            ),
            temperature=float((outside[0] + inside[0]) / 2),
            pose=jt.Pose((0.0, 0.0, height)),
        )
        for layers, height in ((OUTER_WALL, _GAP), (INNER_WALL, 0.0))
    )
    wind = jt.LinearWind(
        table(columns["wind_m_s"]),
        table(outside),
        calm=law.calm,
        by_speed=law.by_speed,
        on=OUTSIDE,
    )
    terms = (
        jt.Sun((0.0, 0.0, -1.0), table(np.maximum(columns["global_west_W_m2"], 0.0))),
        jt.Surroundings(
            table(sky_temperature(columns["longwave_west_W_m2"])), on=OUTSIDE
        ),
        wind,
        jt.bonded,
        jt.FixedTemperature(table(inside), on=jt.Face("back", body=1)),
    )
    return jt.Scene(bodies, terms, dtype="float64")


def problem(
    columns: Columns, name: str = "outer_surface_degC", law: WindLaw = WATMUFF
) -> Problem:
    """The numbers that are fitted, and the outer surface or the layer as data."""
    wall = scene(columns, law)
    saves = tuple(columns["time_s"][1:].tolist())
    face = 0 if name == "outer_surface_degC" else 1
    of_face = np.flatnonzero(wall.bodies[0].structure.grid.fragment_face == face)
    target = thermocouple(
        saves,
        kelvin(columns[name])[1:],
        fragment=int(of_face[0]),
        fragments=sum(len(body.structure.grid.fragment_area) for body in wall.bodies),
    )
    run = ParametricRun(saves, jt.SuperTimeStepping(dt=STEP, stages=9))
    parameters = (
        Parameter("bodies.0.structure.stacks.0.0.material.absorptivity", (0.23,), 0, 1),
        Parameter("linear_wind.calm", (law.calm,), 0.0, 30.0),
        Parameter("linear_wind.by_speed", (law.by_speed,), 0.0, 20.0),
    )
    return Problem(ParameterSet(parameters), (Case("wall", wall, run, target),))
