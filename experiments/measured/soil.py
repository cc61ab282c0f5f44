"""The soil at a test house, from the temperatures of its surface and 2 m below it."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

import jaxthermo as jt

from .data import Columns, kelvin


_STEP = 600.0  # [s]
_PITCH = 0.05  # [m]
_BOTTOM = 2.0  # [m]
_DEPTHS = {
    0.0: "ground_0cm_degC",
    0.5: "ground_50cm_degC",
    1.0: "ground_100cm_degC",
    _BOTTOM: "ground_200cm_degC",
}
"""Depths of the measured temperatures [m], and their columns."""


def errors(columns: Columns, soil: str) -> Mapping[str, Float[np.ndarray, " n"]]:
    """Computed less measured temperatures [K] by their columns, from the second row on.

    At the start the soil has the measured temperatures, linear between their depths.
    """
    depths = np.array(list(_DEPTHS))
    first = np.array([kelvin(columns[name])[0] for name in _DEPTHS.values()])
    box = jt.shapes.box((_PITCH, _PITCH, _BOTTOM))
    top = float(box.vertices[:, 2].max())

    def at_start(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        return np.interp(top - points[:, 2], depths, first)

    body = jt.Body(
        jt.FullVolume(jt.voxelize(box, pitch=_PITCH)),
        jt.materials[soil],
        temperature=at_start,
    )
    between = [depth for depth in _DEPTHS if 0 < depth < _BOTTOM]
    centre = box.vertices.mean(axis=0)
    probes = {
        _DEPTHS[depth]: (float(centre[0]), float(centre[1]), top - depth)
        for depth in between
    }
    ends = {0.0: (0.0, 0.0, 1.0), _BOTTOM: (0.0, 0.0, -1.0)}
    terms = tuple(
        jt.FixedTemperature(
            jt.Table(columns["time_s"], kelvin(columns[_DEPTHS[depth]])),
            on=jt.Side(normal),
        )
        for depth, normal in ends.items()
    )
    column = jt.Scene((body,), terms, dtype="float64", probes=probes)
    times = columns["time_s"][1:]
    solution = jt.simulate(
        column,
        float(times[-1]),
        save_at=times.tolist(),
        solver=jt.SuperTimeStepping(dt=_STEP, stages=5),
    )
    computed = np.asarray(solution.probe_temperature)
    return {
        name: computed[:, n] - kelvin(columns[name])[1:]
        for n, name in enumerate(probes)
    }
