"""Numbers and laws of the measured cases, with their sources.

They were written down before any run was compared with a measurement: none is chosen by
the days that are tested.

| what | value | source |
|---|---|---|
| wind on flat faces | h = 2.8 + 3.0 v | Watmuff, Charters and Proctor 1977 |
| other winds, reported | 4 + 4 v; 5.7 + 3.8 v | EN ISO 6946, annex C; McAdams 1954 |
| flat plate, reported | horizontal wind onto the front, the upper face | `jt.Wind` |
| the same in still air | beside the wind | `jt.FreeConvection` |
| module: sky | 0.0552 T_air^1.5 | Swinbank 1963 |
| other sky, reported | by the dew point | Berdahl and Martin 1984 |
| module: absorptance | 0.9 | default of PVsyst (pvlib) |
| module: electric share, where no power is measured | 0.1 | default of PVsyst (pvlib) |
| module: area, where the power is measured | 1.45 m^2 | middle of 1.2 to 1.7 m^2 |
| module: emissivity of glass, of back sheet | 0.84, 0.85 | the table of materials |
| module: tilt | 35 degrees | near the latitude, since none is stated |
| ground | as warm as the air | |
| wall: absorptance, emissivity | 0.23, 0.9 | IEA EBC Annex 58 |
| wall: half of its view | the sky; the other half a ground as warm as the air | |
| soil | clay with 20 % of water by volume | the table of materials |
| other soil, reported | dry | the table of materials |
| nominal temperature of a module, for peers | 45 degC | usual of open racks (pvlib) |

Fitted are: of the module the absorptance, c of h = 2.8 + c v and the emissivity of both
faces, which is a factor of the exchange with the sky; of the wall the absorptance and
both numbers of h, on every second of the days with an answer.

The dew point of a day is its lowest air temperature. What the module absorbs is
released in its cells, behind the glass.
"""

from typing import NamedTuple

import jaxthermo as jt


class WindLaw(NamedTuple):
    """Heat transfer coefficient calm + by_speed v."""

    source: str
    calm: float
    """[W/(m^2 K)]"""
    by_speed: float
    """[J/(m^3 K)]"""


WATMUFF = WindLaw("Watmuff, Charters and Proctor 1977", calm=2.8, by_speed=3.0)
WIND_LAWS = (
    WATMUFF,
    WindLaw("EN ISO 6946", calm=4.0, by_speed=4.0),
    WindLaw("McAdams 1954", calm=5.7, by_speed=3.8),
)

ABSORPTANCE = 0.9
ELECTRIC_SHARE = 0.1
MODULE_AREA = 1.45  # [m^2]
TILT = 35.0  # [deg]
NOMINAL = 45.0  # [degC]

MODULE = (
    jt.Layer("car_glass", 3.2e-3),
    jt.Layer("eva", 0.5e-3),
    jt.Layer("silicon", 0.2e-3),
    jt.Layer("eva", 0.5e-3),
    jt.Layer("back_sheet", 0.3e-3),
)
"""Crystalline cells between glass and a back sheet (Armstrong and Hurley 2010; glass of
3.2 mm is common)."""

OUTER_WALL = (jt.Layer("render", 0.01), jt.Layer("render_board", 0.08))
INNER_WALL = (
    jt.Layer("plaster", 0.03),
    jt.Layer("honeycomb_brick", 0.3),
    jt.Layer("plaster", 0.01),
)
"""Layers of the wall from outside, on both sides of the heat flux sensor."""

SOILS = ("moist_soil", "dry_soil")

RUNNING_IN = 4 * 86400.0  # [s]
"""Time at the start of the runs of wall and soil that is not compared."""

DAYTIME = 10.0  # [W/m^2]
"""Irradiance above which a row of the module's data counts as day."""
