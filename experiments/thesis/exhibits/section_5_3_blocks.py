"""Section 5.3: two blocks in contact, against the closed form of two half-spaces."""

from typing import Any, NamedTuple

import numpy as np
from scipy.special import erfcx

import jaxthermo as jt
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.physics.contact.search import find_contacts
from jaxthermo.report.table import Table

from ...harness.present import Rows, table_of
from ...verification.contacts import (
    CONDUCTANCE,
    COPPER,
    INTERFACE,
    STEEL,
    TwoBars,
    resisted,
    two_bars,
)
from ..exhibit import Exhibit, Finding, Plot, Row, Verdict
from ..line_chart import log_chart, point


_TIMES = (0.1, 0.3, 1.0, 3.0, 10.0)
# Voxels in a diffusion length of steel at each time.
_FINE = 20
# Edges of two blocks that overlap in a part of their faces, and the offset of the upper
# one, which is no whole number of voxels [m].
_EDGE, _PITCH, _OFFSET = 0.06, 0.005, (0.0130, 0.0172)
# Largest error [%], and difference of what is gained and lost over it [-].
_WITHIN, _SWAP = 1.0, 1e-10
_RESISTING, _BONDED = f"{CONDUCTANCE:g} W/(m² K)", "bonded"
_RATE = CONDUCTANCE * (1 / COPPER.effusivity + 1 / STEEL.effusivity)


def heat_through(time: float) -> float:
    """Heat through the contact up to a time, the integral of its flux [J/m^2]."""
    # That of w = erfcx(a sqrt(t)), a the rate: (w - 1 + 2 a sqrt(t / pi)) / a^2.
    w = erfcx(_RATE * np.sqrt(time))
    rest = w - 1 + 2 * _RATE * np.sqrt(time / np.pi)
    return float(CONDUCTANCE * 100.0 * rest / _RATE**2)


def bonded_heat_through(time: float) -> float:
    """Heat through a perfect contact up to a time, 2 sqrt(t / pi) e T_s [J/m^2]."""
    # From the steel's side, which is at 0 at first.
    return 2 * float(np.sqrt(time / np.pi) * STEEL.effusivity) * INTERFACE


def _swap(found: TwoBars) -> float:
    """Difference of the heat that one bar loses and the other gains, over it [-]."""
    copper, steel = (float(each.stored_J[-1]) for each in found.energy.bodies)
    # No closer than rounding.
    return max(abs(copper + steel) / abs(steel), float(np.finfo(float).eps))


def _off(found: float, exact: float, over: float) -> float:
    return 100 * (found - exact) / over


def _measured(name: str, time: float) -> dict[str, Any]:
    is_bonded = name == _BONDED
    contact = jt.bonded if is_bonded else jt.Contact(CONDUCTANCE)
    found = two_bars(contact, _FINE, time)
    exact = [INTERFACE, INTERFACE] if is_bonded else resisted(time)
    heat = float(found.energy.bodies[1].stored_J[-1]) / found.area
    right = bonded_heat_through(time) if is_bonded else heat_through(time)
    return {
        "contact": name,
        "time_s": time,
        "copper_C": found.copper,
        "steel_C": found.steel,
        "exact_C": exact[:2],
        "heat_J_m2": heat,
        "heat_exact_J_m2": right,
        "swap": _swap(found),
        "error_percent": {
            "copper": _off(found.copper, exact[0], 100.0),
            "steel": _off(found.steel, exact[1], 100.0),
            "heat": _off(heat, right, right),
        },
    }


class _Blocks(NamedTuple):
    """Two blocks that overlap in a part of their faces."""

    area: float
    """Area of contact over the exact one [-]."""
    elsewhere: float
    """Heat rate through texels that do not touch, over all of it [-]."""


def offset_blocks() -> _Blocks:
    """Let heat flow between two blocks that overlap in a part of their faces."""
    grid = jt.voxelize(jt.shapes.box(_EDGE), _PITCH)
    where = jt.Pose((*_OFFSET, _EDGE))
    structure = jt.FullVolume(grid)
    bodies = (
        jt.Body(structure, COPPER, temperature=400.0),
        jt.Body(structure, STEEL, temperature=300.0, pose=where),
    )
    outputs = ("heat_flux",)
    scene = jt.Scene(
        bodies, (jt.Contact(CONDUCTANCE),), dtype="float64", surface_outputs=outputs
    )
    solution = jt.simulate(scene, 1.0)
    assert solution.heat_flux is not None
    pairs = find_contacts(PlacedGrid(grid), PlacedGrid(grid, where))
    covered = np.concatenate([pairs.coverage_a, pairs.coverage_b]) > 0
    rate = np.abs(np.asarray(solution.heat_flux[-1]) * np.tile(grid.fragment_area, 2))
    exact = np.prod([_EDGE - offset for offset in _OFFSET])
    return _Blocks(
        float(pairs.area.sum() / exact), float(rate[~covered].sum() / rate.sum())
    )


def _chart(rows: Rows) -> Plot:
    curves = {_BONDED: bonded_heat_through, _RESISTING: heat_through}
    points = [
        point(f"closed form, {name}", time, exact(time) / 1e3)
        for name, exact in curves.items()
        for time in _TIMES
    ]
    points += [
        point(
            "found",
            row["time_s"],
            row["heat_J_m2"] / 1e3,
            f"{row['contact']}, {row['time_s']:g} s: {row['heat_J_m2'] / 1e3:.4g}",
            mark=True,
        )
        for row in rows
    ]
    x, y = "time [s]", "heat through the contact [kJ/m²]"
    chart = log_chart(points, x, y, "Copper at 100 °C on steel at 0 °C")
    caption = "Heat that has gone from the copper block to the steel one."
    return Plot("section-5.3-blocks", chart, caption)


def _table(rows: Rows) -> Table:
    off = lambda key: lambda row: f"{row['error_percent'][key]:+.1g} %"
    columns = [
        ("contact", "{contact}"),
        ("time", "{time_s:g} s"),
        ("copper [°C]", "{copper_C:.4f}"),
        ("exact", "{exact_C[0]:.4f}"),
        ("steel [°C]", "{steel_C:.4f}"),
        ("exact", "{exact_C[1]:.4f}"),
        ("heat", off("heat")),
        ("swap", "{swap:.0e}"),
    ]
    caption = (
        "Surfaces in contact; error of the heat through it; heat that one block loses "
        "less that which the other gains, over it."
    )
    return table_of(rows, columns, "Two blocks in contact", caption)


def _measure(_: bool) -> Finding:
    rows = [_measured(name, t) for name in (_RESISTING, _BONDED) for t in _TIMES]
    worst = {
        key: max(abs(row["error_percent"][key]) for row in rows)
        for key in ("copper", "steel", "heat")
    }
    swap, blocks = max(row["swap"] for row in rows), offset_blocks()
    right = max(worst.values()) <= _WITHIN and swap <= _SWAP
    right = right and blocks.elsewhere <= _SWAP
    reason = (
        "A block of copper at 100 °C and one of steel at 0 °C, bonded or with "
        f"{_RESISTING} between them, keep to the closed form of two half-spaces: the "
        f"surfaces to {max(worst['copper'], worst['steel']):.1g} % of 100 K and the "
        f"heat to {worst['heat']:.1g} %, from {_TIMES[0]:g} to {_TIMES[-1]:g} s. What "
        f"one loses the other gains, to {swap:.0e} of it in double precision. Of two "
        f"blocks that overlap in a part of their faces, {blocks.elsewhere:.0%} of the "
        "heat goes through texels that do not touch."
    )
    surfaces = tuple(
        Row(
            f"surface of the {metal}, {row['contact']}, {row['time_s']:g} s [°C]",
            None,
            f"{row[f'{metal}_C']:.3f}",
            f"closed form {exact:.3f}",
        )
        for row in rows
        # Bonded surfaces keep one temperature.
        if row["contact"] == _RESISTING or row["time_s"] == _TIMES[-1]
        for metal, exact in zip(("copper", "steel"), row["exact_C"], strict=True)
    )
    others = (
        Row("heat lost and gained, relative difference", None, f"{swap:.0e}"),
        Row("area of a partial overlap over the exact one", None, blocks.area),
        Row("heat through texels that do not touch", "none", blocks.elsewhere),
    )
    chosen = (
        ("blocks", "bars so long that their far ends stay as they were"),
        ("voxels", f"{_FINE} in a diffusion length of steel at each time"),
        ("contact", "bonded, as equation 4 has it, and with a resistance between"),
    )
    numbers = {"rows": rows, "worst_percent": worst, "offset": blocks._asdict()}
    verdict = Verdict.REPRODUCED if right else Verdict.CONTRADICTED
    parts = (_chart(rows), _table(rows))
    return Finding(verdict, reason, (*surfaces, *others), {}, chosen, parts, numbers)


EXHIBIT = Exhibit(
    name="section-5.3-blocks",
    title="two blocks in contact",
    place="5.3",
    claims=("C17",),
    measure=_measure,
)
