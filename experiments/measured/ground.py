"""The ground of a high desert over a clear day in winter.

Alamosa, Colorado, 1 January 2016: one of the days of the network SURFRAD of the NOAA,
from the repository of pvlib (commit 6382338a), here as half-hourly means. Sunlight down
and up, the long wave of the sky, air and wind are given; the long wave that the ground
emits and reflects is measured, from which follows its temperature. Radiometers side by
side differ by 3 to 5 W/m^2 of long wave (AMS 2010, paper 160868), 1 K.

The soil is not known: the case takes the stack `soil` of the package. The day is
repeated until the ground follows it.
"""

import io

import numpy as np
from jaxtyping import Float

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN, ZERO_CELSIUS
from jaxthermo.weather.sky import sky_temperature

from .thermocouple import fragment_of


_REPEATS = 4
_SHORTEST_TIME = 300.0  # [s]
_EMISSIVITY = 0.95
_STEP = 900.0  # [s]
_TIME = np.arange(_REPEATS * 48) * 1800.0 + 900.0
"""Middles of the half hours [s]."""

_NOON = 38
"""Half hours from 0 h UTC to noon."""

# Sunlight down less up, and long wave down [W/m^2], air [degC], wind [m/s], and long
# wave up [W/m^2], from 0 h UTC on.
_ROWS = """
   0.0   185.4    -9.0     3.4   272.3
   0.0   186.7   -10.7     3.5   267.3
   0.0   188.1   -11.7     3.1   263.6
   0.0   185.0   -13.0     2.3   259.0
   0.0   192.7   -14.2     2.3   256.7
   0.0   232.3   -12.4     0.8   264.6
   0.0   224.0   -12.2     0.8   264.7
   0.0   188.0   -12.8     3.0   258.7
   0.0   179.6   -14.5     2.1   252.4
   0.0   178.5   -15.0     2.6   251.2
   0.0   176.0   -14.7     3.1   250.6
   0.0   174.2   -15.7     1.8   247.1
   0.0   173.9   -15.8     0.7   243.1
   0.0   172.6   -17.3     0.3   241.0
   0.0   172.4   -17.2     0.8   240.0
   0.0   171.7   -16.6     0.0   238.2
   0.0   171.2   -17.4     0.0   236.2
   0.0   170.4   -18.3     0.0   236.6
   0.0   169.1   -19.2     0.0   234.2
   0.0   167.1   -20.2     0.0   233.1
   0.0   166.7   -20.3     0.4   232.7
   0.0   165.8   -21.0     0.0   229.7
   0.0   166.4   -21.5     0.2   229.2
   0.0   166.4   -21.5     2.1   230.1
   0.0   165.3   -22.6     1.5   227.0
   0.0   165.8   -22.7     2.1   226.9
   0.0   165.0   -22.6     2.0   226.7
   0.0   166.0   -22.2     2.4   227.4
   0.0   165.8   -22.5     1.8   226.7
  29.6   165.5   -21.8     1.8   231.2
  98.9   167.3   -18.8     0.8   242.0
 175.6   169.6   -15.8     1.8   256.4
 244.4   171.3   -13.7     0.7   271.0
 312.3   173.6   -11.7     0.0   286.0
 370.8   175.6   -10.0     0.0   298.9
 419.5   177.6    -9.0     0.3   309.2
 454.2   179.9    -8.0     0.3   319.0
 473.4   182.0    -6.9     0.4   326.5
 478.0   183.7    -6.1     0.2   331.8
 469.0   186.0    -5.4     0.7   334.9
 446.7   187.2    -4.6     0.4   335.7
 407.2   188.8    -4.2     0.5   333.9
 357.1   189.8    -3.7     0.2   330.6
 297.5   190.8    -3.4     0.5   324.4
 226.0   191.2    -3.5     1.9   313.5
 150.8   189.8    -4.6     3.6   300.2
  73.7   188.7    -5.6     2.8   290.3
  11.8   187.2    -7.2     2.1   278.9
"""
_ABSORBED, _SKY, _AIR, _WIND, _GROUND = np.loadtxt(io.StringIO(_ROWS), unpack=True)


def _scene(stack: str) -> jt.Scene:
    """Level ground of a stack, whose days are all alike."""

    def table(values: Float[np.ndarray, " t"]) -> jt.Table:
        return jt.Table(_TIME, np.tile(values, _REPEATS))

    air = table(_AIR + ZERO_CELSIUS)
    sheet = jt.Sheet(
        jt.shapes.rectangle(1.0, 1.0),
        jt.stacks[stack],
        pitch=2.0,
        back="adiabatic",
        shortest_time=_SHORTEST_TIME,
    )
    body = jt.Body(
        sheet,
        temperature=float(_AIR.mean()) + ZERO_CELSIUS,
        coatings=(jt.Coating(_EMISSIVITY, absorptivity=1.0),),
    )
    terms = (
        jt.Sun((0.0, 0.0, -1.0), table(_ABSORBED)),
        jt.Surroundings(table(sky_temperature(_SKY))),
        jt.LinearWind(table(_WIND), air),
    )
    return jt.Scene((body,), terms, dtype="float64")


def measured() -> Float[np.ndarray, " t"]:
    """Temperature of the ground, every half hour from 0:15 UTC on [K]."""
    reflected = (1 - _EMISSIVITY) * _SKY
    emitted = _GROUND - reflected
    return (emitted / (_EMISSIVITY * STEFAN_BOLTZMANN)) ** 0.25


def errors(stack: str) -> Float[np.ndarray, " t"]:
    """Computed less measured temperatures of the ground on the last day [K]."""
    ground = _scene(stack)
    saves = _TIME[-len(_AIR) :]
    solver = jt.SuperTimeStepping(dt=_STEP)
    solution = jt.simulate(ground, float(saves[-1]), saves.tolist(), solver=solver)
    computed = np.asarray(solution.surface_temperature)
    return computed[:, fragment_of(ground, "front")] - measured()
