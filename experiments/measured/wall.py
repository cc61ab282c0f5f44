"""The west wall of a test house, in the long wave and the sunlight on its own plane."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

import jaxthermo as jt
from calibrate.problem.parameters import Parameter, ParameterSet
from calibrate.problem.problem import Case, Problem
from jaxthermo.integrate.run.parametric_run import ParametricRun
from jaxthermo.weather.sky import sky_temperature

from .data import Columns, kelvin
from .laws import INNER_WALL, OUTER_WALL, WATMUFF, WindLaw
from .thermocouple import fragment_of, thermocouple


_STEP = 600.0  # [s]
# The same stages for all numbers, so that they share a program.
_SOLVER = jt.SuperTimeStepping(dt=_STEP, stages=9)
_GAP = 1e-3  # [m]
OUTSIDE = jt.Face("front", body=0)


def scene(columns: Columns, law: WindLaw = WATMUFF) -> jt.Scene:
    """The wall, 1 m x 1 m, in two sheets on both sides of its heat flux sensor."""
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
                cells=cells,
            ),
            temperature=float((outside[0] + inside[0]) / 2),
            pose=jt.Pose((0.0, 0.0, height)),
        )
        for layers, height, cells in ((OUTER_WALL, _GAP, 6), (INNER_WALL, 0.0, 14))
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


def errors(columns: Columns, wall: jt.Scene) -> Mapping[str, Float[np.ndarray, " n"]]:
    """Computed less measured temperatures [K] and fluxes [W/m^2] by their columns.

    From the second row on; NaN where nothing is measured. A flux is the mean since the
    row before, and positive outward.
    """
    times = columns["time_s"][1:]
    solution = jt.simulate(
        wall,
        float(times[-1]),
        save_at=times.tolist(),
        solver=_SOLVER,
    )
    surface = np.asarray(solution.surface_temperature)
    (inward,) = solution.energy.contacts.values()
    from_inside = solution.energy.mechanisms["fixed_temperature"]
    computed = {
        "outer_surface_degC": surface[:, fragment_of(wall, "front")],
        "layer_degC": surface[:, fragment_of(wall, "back")],
        "layer_heat_flux_W_m2": -np.diff(inward, prepend=0.0) / _STEP,
        "inner_heat_flux_W_m2": np.diff(from_inside, prepend=0.0) / _STEP,
    }
    return {
        name: values
        - (kelvin(columns[name]) if name.endswith("degC") else columns[name])[1:]
        for name, values in computed.items()
    }


def problem(columns: Columns, law: WindLaw = WATMUFF) -> Problem:
    """The numbers that are fitted, and the outer surface as data."""
    wall = scene(columns, law)
    saves = tuple(columns["time_s"][1:].tolist())
    target = thermocouple(
        saves,
        kelvin(columns["outer_surface_degC"])[1:],
        fragment=fragment_of(wall, "front"),
        fragments=sum(len(body.structure.grid.fragment_area) for body in wall.bodies),
    )
    run = ParametricRun(saves, _SOLVER)
    parameters = (
        Parameter("bodies.0.structure.stacks.0.0.material.absorptivity", (0.23,), 0, 1),
        Parameter("linear_wind.calm", (law.calm,), 0.0, 30.0),
        Parameter("linear_wind.by_speed", (law.by_speed,), 0.0, 20.0),
    )
    return Problem(ParameterSet(parameters), (Case("wall", wall, run, target),))
