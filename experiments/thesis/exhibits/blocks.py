"""5.3: two blocks in contact, against the closed form of two half-spaces."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import erfcx

import jaxthermo as jt
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.physics.contact.search import find_contacts
from jaxthermo.report.chart import Chart

from ...harness.line_chart import ALONE, curve, log_chart
from ...verification.contacts import (
    CONDUCTANCE,
    COPPER,
    INTERFACE,
    STEEL,
    resisted,
    two_bars,
)
from ..exhibit import Finding, Numbers, exhibit, imbalance, judged


_TIMES = (0.1, 0.3, 1.0, 3.0, 10.0)
# Voxels in a diffusion length of steel at each time.
_FINE = 20
# Edges of two blocks that overlap in a part of their faces, and the offset of the upper
# one, which is no whole number of voxels [m].
_EDGE = 0.06
_PITCH = 0.005
_OFFSET = (0.0130, 0.0172)
# Largest error [%], and relative difference of what is gained and lost [-].
_MAX_ERROR_PERCENT = 1.0
_MAX_IMBALANCE = 1e-10
_RESISTING = f"{CONDUCTANCE:g} W/(m² K)"
_BONDED = "bonded"
_RATE = CONDUCTANCE * (1 / COPPER.effusivity + 1 / STEEL.effusivity)


@exhibit("section-5.3-blocks", "5.3")
def _blocks_in_contact(_: bool) -> Finding:
    """Let heat flow from a block of copper to one of steel."""
    rows = [
        _contact_row(name, time) for name in (_RESISTING, _BONDED) for time in _TIMES
    ]
    worst = {
        name: max(abs(row["error_percent"][name]) for row in rows)
        for name in ("copper", "steel", "heat")
    }
    swap = max(row["swap"] for row in rows)
    overlap = offset_blocks()
    is_right = (
        max(worst.values()) <= _MAX_ERROR_PERCENT
        and swap <= _MAX_IMBALANCE
        and overlap.elsewhere <= _MAX_IMBALANCE
    )
    return Finding(
        judged(is_right),
        {
            "rows": rows,
            "worst_percent": worst,
            "worst_surface_percent": max(worst["copper"], worst["steel"]),
            "swap": swap,
            "offset": overlap,
        },
        {"section-5.3-blocks": _chart(rows)},
    )


def heat_through(time: float) -> float:
    """Heat through the contact up to a time, the integral of its flux [J/m^2]."""
    # The integral of w = erfcx(a sqrt(t)), a the rate: (w - 1 + 2 a sqrt(t / pi)) / a^2
    w = erfcx(_RATE * np.sqrt(time))
    integral = (w - 1 + 2 * _RATE * np.sqrt(time / np.pi)) / _RATE**2
    return float(CONDUCTANCE * 100.0 * integral)


def bonded_heat_through(time: float) -> float:
    """Heat through a perfect contact up to a time, 2 sqrt(t / pi) e T_s [J/m^2]."""
    # From the steel's side, which is at 0 at first.
    return 2 * float(np.sqrt(time / np.pi) * STEEL.effusivity) * INTERFACE


def _contact_row(name: str, time: float) -> Numbers:
    is_bonded = name == _BONDED
    contact = jt.bonded if is_bonded else jt.Contact(CONDUCTANCE)
    bars = two_bars(contact, _FINE, time)
    if is_bonded:
        exact_surfaces = [INTERFACE, INTERFACE]
        exact_heat = bonded_heat_through(time)
    else:
        exact_surfaces = list(resisted(time)[:2])
        exact_heat = heat_through(time)
    copper, steel = (float(energy.stored_J[-1]) for energy in bars.energy.bodies)
    heat = steel / bars.area
    return {
        "contact": name,
        "time_s": time,
        "copper_C": bars.copper,
        "steel_C": bars.steel,
        "exact_C": exact_surfaces,
        "heat_J_m2": heat,
        "heat_exact_J_m2": exact_heat,
        "swap": imbalance(steel, copper),
        "error_percent": {
            # Of the difference of 100 K.
            "copper": bars.copper - exact_surfaces[0],
            "steel": bars.steel - exact_surfaces[1],
            "heat": 100 * (heat / exact_heat - 1),
        },
    }


class _Overlap(NamedTuple):
    """Two blocks that overlap in a part of their faces."""

    area: float
    """Area of contact over the exact one [-]."""
    elsewhere: float
    """Heat rate through texels that do not touch, over all of it [-]."""


def offset_blocks() -> _Overlap:
    """Let heat flow between two blocks that overlap in a part of their faces."""
    grid = jt.voxelize(jt.shapes.box(_EDGE), _PITCH)
    pose = jt.Pose((*_OFFSET, _EDGE))
    structure = jt.FullVolume(grid)
    bodies = (
        jt.Body(structure, COPPER, temperature=400.0),
        jt.Body(structure, STEEL, temperature=300.0, pose=pose),
    )
    scene = jt.Scene(
        bodies,
        (jt.Contact(CONDUCTANCE),),
        dtype="float64",
        surface_outputs=("heat_flux",),
    )
    solution = jt.simulate(scene, 1.0)
    assert solution.heat_flux is not None
    pairs = find_contacts(PlacedGrid(grid), PlacedGrid(grid, pose))
    is_touching = np.concatenate([pairs.coverage_a, pairs.coverage_b]) > 0
    area = np.tile(grid.fragment_area, 2)
    rate = np.abs(np.asarray(solution.heat_flux[-1]) * area)
    exact = np.prod([_EDGE - offset for offset in _OFFSET])
    return _Overlap(
        area=float(pairs.area.sum() / exact),
        elsewhere=float(rate[~is_touching].sum() / rate.sum()),
    )


def _chart(rows: Sequence[Numbers]) -> Chart:
    points = []
    for name in (_BONDED, _RESISTING):
        of_contact = [row for row in rows if row["contact"] == name]
        exact = [row["heat_exact_J_m2"] / 1e3 for row in of_contact]
        points += curve(f"closed form, {name}", _TIMES, exact)
        heat = [row["heat_J_m2"] / 1e3 for row in of_contact]
        points += curve("found", _TIMES, heat, marks=ALONE)
    return log_chart(
        points=points,
        x_title="time [s]",
        y_title="heat through the contact [kJ/m²]",
        title="Copper at 100 °C on steel at 0 °C",
    )
