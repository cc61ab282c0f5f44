"""5.2: a hollow body as a shell of voxels, and as a sheet of its true thickness."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

import jaxthermo as jt
from jaxthermo.physics.term import AbstractTerm
from jaxthermo.reference.sheets import sunlit_sphere
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.timing import Spread, interleaved

from ...harness.meshes import SAVE_AT, START, STEEL
from ..bodies import SPHERE_RADIUS
from ..exhibit import Finding, Numbers, exhibit, judged, rms


# Thickness of the wall [m], and width of voxels and cells as multiples of it.
_THICKNESS = 2e-3
_WIDTHS = (10, 5)
# At full size also shells of voxels as wide as the wall is thick.
_TRUE_WIDTH = 1
_IRRADIANCE = 5000.0
_SUNSET = 90.0
_COEFFICIENT = 10.0
_REPEATS = 5
_WALL = jt.Layer(STEEL, _THICKNESS)
_TERMS = (
    jt.Sun((-1.0, 0.0, 0.0), jt.Until(_IRRADIANCE, _SUNSET)),
    jt.Convection(_COEFFICIENT, START),
)
_OUTSIDE = (
    jt.Sun((-1.0, 0.0, 0.0), jt.Until(_IRRADIANCE, _SUNSET)),
    jt.Convection(_COEFFICIENT, START, on=jt.Face("front", body=0)),
)


class _Run(NamedTuple):
    """A wall in one structure, ready to run."""

    simulation: jt.CompiledSimulation
    structure: AbstractStructure
    outer: Int[np.ndarray, " s"]
    """Numbers of the outer fragments."""


@exhibit("section-5.2-walls", "5.2")
def _hollow_sphere(quick: bool) -> Finding:
    """Compare shells and sheets of a hollow sphere with its series."""
    mesh = jt.shapes.sphere(SPHERE_RADIUS, subdivisions=5)
    runs: dict[str, _Run] = {}
    for width in _WIDTHS if quick else (*_WIDTHS, _TRUE_WIDTH):
        pitch = width * _THICKNESS
        grid = jt.voxelize(mesh, pitch)
        shell = jt.SingleShell(grid, capacity="own")
        body = jt.Body(shell, STEEL, temperature=START)
        runs[f"hollow shell, {1e3 * pitch:g} mm"] = _prepared(body, _TERMS)
    for width in _WIDTHS:
        pitch = width * _THICKNESS
        sheet = jt.Sheet(mesh, (_WALL,), pitch=pitch)
        body = jt.Body(sheet, temperature=START)
        runs[f"sheet, {1e3 * pitch:g} mm"] = _prepared(body, _OUTSIDE)
    errors = {name: _error_percent(run) for name, run in runs.items()}
    spans = interleaved(
        {name: run.simulation for name, run in runs.items()},
        _REPEATS,
        there_and_back=True,
    )
    rows: Numbers = {
        name: {
            "nodes": run.structure.node_count,
            "error_percent": errors[name],
            "run_ms": 1e3 * Spread.of(spans[name]).median,
        }
        for name, run in runs.items()
    }
    sheets = [error for name, error in errors.items() if name.startswith("sheet")]
    shells = [error for name, error in errors.items() if name.startswith("hollow")]
    return Finding(
        judged(max(sheets) < 1 < min(shells), different=True),
        {
            "sheet_percent": max(sheets),
            "shell_percent": min(shells),
            "rows": rows,
            "thickness_mm": 1e3 * _THICKNESS,
        },
    )


def _prepared(body: jt.Body, terms: tuple[AbstractTerm, ...]) -> _Run:
    simulation = jt.compile_simulation(
        jt.Scene((body,), terms), SAVE_AT[-1], save_at=list(SAVE_AT)
    )
    face = body.structure.grid.fragment_face
    count = len(body.structure.grid.fragment_area)
    outer = np.arange(count) if face is None else np.flatnonzero(face == 0)
    return _Run(simulation, body.structure, outer)


def _error_percent(run: _Run) -> float:
    """RMS error over the range of the exact temperature, at the worst time [%]."""
    grid = run.structure.grid
    position = grid.fragment_position[run.outer]
    cosine = position[:, 0] / np.linalg.norm(position, axis=1)
    angle = np.arccos(np.clip(cosine, -1, 1))
    temperature = np.asarray(run.simulation().surface_temperature, float)
    percent = []
    for row, time in zip(temperature[:, run.outer], SAVE_AT, strict=True):
        exact = START + _rise(angle, time) - _rise(angle, max(time - _SUNSET, 0.0))
        error = rms(row - exact, grid.fragment_area[run.outer])
        percent.append(100 * error / float(np.ptp(exact)))
    return max(percent)


def _rise(angle: np.ndarray, time: float) -> np.ndarray:
    """Rise of the wall in the sun [K]; at sunset the same is taken off."""
    return sunlit_sphere(
        angle,
        radius=SPHERE_RADIUS,
        sheet_conductance=float(_WALL.conductivity) * _THICKNESS,
        heat_transfer_coefficient=_COEFFICIENT,
        heat_flux=_IRRADIANCE,
        time=time,
        area_capacity=float(_WALL.capacity),
    )
