"""Two cylinders in line with the wind: the heat that the second loses in the wake."""

import numpy as np

import jaxthermo as jt
from jaxthermo.geometry import shapes
from jaxthermo.report.table import Table

from ..harness.present import Rows, table_of


# Two cylinders of 10 mm in line with a wind that has Re 100 for each.
_PAIR_DIAMETER, _PAIR_SPEED, _AIR, _HOT = 0.01, 0.157, 300.0, 350.0
_GAPS = 1.0, 2.0, 5.0, 10.0, 20.0


def measure_pair() -> Rows:
    """Mean heat transfer of a cylinder behind another, over that without a wake."""
    mesh = shapes.cylinder(_PAIR_DIAMETER / 2, 4 * _PAIR_DIAMETER, 64)
    grid = jt.voxelize(mesh, _PAIR_DIAMETER / 12)
    heat = {}
    for wake in (None, jt.FittedWake()):
        wind = jt.Wind((_PAIR_SPEED, 0.0, 0.0), _AIR, wake=wake)
        for gap in _GAPS:
            shift = (gap + 1) * _PAIR_DIAMETER
            poses = jt.Pose(), jt.Pose((shift, 0.0, 0.0))
            copper = jt.materials["copper"]
            bodies = tuple(
                jt.Body(jt.FullVolume(grid), copper, temperature=_HOT, pose=pose)
                for pose in poses
            )
            scene = jt.Scene(bodies, (wind,), dtype="float64")
            cooled = jt.simulate(scene, 1e-2)
            loss = _HOT - np.asarray(cooled.mean_temperature)[-1]
            heat[wake is None, gap] = float(loss[1])
    return [{"gap": gap, "factor": heat[False, gap] / heat[True, gap]} for gap in _GAPS]


def pair_table(pairs: Rows) -> Table:
    """Heat of the second cylinder by the gap between both."""
    columns = [("gap [D]", "{gap:g}"), ("heat over that without", "{factor:.3f}")]
    return table_of(pairs, columns, "Second of two cylinders in line, Re 100")
