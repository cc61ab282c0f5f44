"""Models of the temperature of photovoltaic modules that others use."""

from collections.abc import Callable, Mapping
from typing import Any

import lazy_loader
import numpy as np
from jaxtyping import Float

from .data import Columns
from .folds import Residuals
from .laws import NOMINAL, TILT


_pandas: Any = lazy_loader.load("pandas")
_pvlib: Any = lazy_loader.load("pvlib")

_Model = Callable[[Columns], Float[np.ndarray, " t"]]


def _irradiance(columns: Columns) -> Float[np.ndarray, " t"]:
    return np.maximum(columns["irradiance_plane_W_m2"], 0.0)


def _air(columns: Columns) -> Float[np.ndarray, " t"]:
    return columns["air_temperature_C"]


def _faiman(columns: Columns) -> Float[np.ndarray, " t"]:
    speed = columns["wind_speed_m_s"]
    return _pvlib.temperature.faiman(_irradiance(columns), _air(columns), speed)


def _sandia(columns: Columns) -> Float[np.ndarray, " t"]:
    numbers = _pvlib.temperature.TEMPERATURE_MODEL_PARAMETERS["sapm"]
    rack = numbers["open_rack_glass_polymer"]
    speed = columns["wind_speed_m_s"]
    light = _irradiance(columns)
    return _pvlib.temperature.sapm_module(
        light, _air(columns), speed, rack["a"], rack["b"]
    )


def _ross(columns: Columns) -> Float[np.ndarray, " t"]:
    return _pvlib.temperature.ross(_irradiance(columns), _air(columns), noct=NOMINAL)


def _fuentes(columns: Columns) -> Float[np.ndarray, " t"]:
    # Its steps follow from the dates of the series.
    dates = _pandas.to_datetime(columns["time"], unit="s")
    series = [
        _pandas.Series(values, index=dates)
        for values in (_irradiance(columns), _air(columns), columns["wind_speed_m_s"])
    ]
    return _pvlib.temperature.fuentes(
        *series, noct_installed=NOMINAL, surface_tilt=TILT
    ).values


MODELS: Mapping[str, _Model] = {
    "air temperature": _air,
    "Faiman, default numbers (pvlib)": _faiman,
    "Sandia, open rack, glass and polymer (pvlib)": _sandia,
    "Ross (pvlib)": _ross,
    "Fuentes (pvlib)": _fuentes,
}
"""Temperature of the module [degC] without a fit, by the name of the model."""


def faiman_with_lag(columns: Columns) -> Residuals:
    """Faiman's model with a fitted lag: u_0 [W/(m^2 K)], u_1 [J/(m^3 K)], ln(lag / s).

    T = T_air + E / (u_0 + u_1 v), smoothed within each day by an exponential. The
    coordinates count from 25, 6.84 and 600 s.
    """
    irradiance = _irradiance(columns)
    speed = columns["wind_speed_m_s"]
    steps = np.diff(columns["time"], prepend=columns["time"][0])
    is_first = np.diff(columns["day"], prepend=-1.0) != 0

    def at(z: np.ndarray) -> Float[np.ndarray, " t"]:
        excess = irradiance / np.maximum(25.0 + z[0] + (6.84 + z[1]) * speed, 1.0)
        keeps = np.exp(-steps / (600.0 * np.exp(np.clip(z[2], -6.0, 4.0))))
        keeps[is_first] = 0.0
        smooth = np.empty_like(excess)
        last = 0.0
        for n, (value, kept) in enumerate(zip(excess, keeps, strict=True)):
            last = kept * last + (1.0 - kept) * value
            smooth[n] = last
        module = columns["module_temperature_C"]
        return (_air(columns) + smooth - module)[1:]

    def slope(z: np.ndarray) -> Float[np.ndarray, "t p"]:
        rises = [at(z + row) - at(z - row) for row in 1e-4 * np.eye(3)]
        return np.stack(rises, axis=1) / 2e-4

    return Residuals(at, slope, 3)
