"""Models of the temperature of photovoltaic modules that others use."""

import numpy as np
from jaxtyping import Float

from .data import Columns
from .folds import Residuals


def faiman_with_lag(columns: Columns) -> Residuals:
    """Faiman's model with a fitted lag: u_0 [W/(m^2 K)], u_1 [J/(m^3 K)], ln(lag / s).

    T = T_air + E / (u_0 + u_1 v), smoothed within each day by an exponential. The
    coordinates count from 25, 6.84 and 600 s.
    """
    irradiance = np.maximum(columns["irradiance_plane_W_m2"], 0.0)
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
        return (columns["air_temperature_C"] + smooth - module)[1:]

    def slope(z: np.ndarray) -> Float[np.ndarray, "t p"]:
        rises = [at(z + row) - at(z - row) for row in 1e-4 * np.eye(3)]
        return np.stack(rises, axis=1) / 2e-4

    return Residuals(at, slope, 3)
