"""Voxels of 10 um and 1 m in one scene (S03); Biot numbers of 1e-6 and 1e6 (S05)."""

from collections.abc import Iterator

import numpy as np

import jaxthermo as jt
from jaxthermo.integrate.explicit import stage_count

from ..harness.case import Bound, Case, Row
from .bodies import AEROGEL, DIAMOND, beside, block
from .methods import adaptive, explicit, implicit, too_long
from .solved import (
    LIMITS,
    Limits,
    Method,
    judged,
    row_of,
    run_nodes,
    stable_step,
)


def _small_and_large() -> Iterator[Row]:
    """S03."""
    for dtype in ("float64", "float32"):
        small = beside(block(3, 3, 3, 1e-5), 0.0, DIAMOND, 400.0)
        large = beside(block(3, 3, 3, 1.0), 10.0, AEROGEL, 300.0)
        scene = jt.Scene((small, large), (jt.Convection(10.0, 350.0),), dtype=dtype)
        what, stable = "10 um diamond, 1 m aerogel", stable_step(scene)
        limit = 1e-10 / (6 * float(DIAMOND.diffusivity))
        ratio = Bound("limit over h^2 / 6 alpha", stable / limit, 1 + 1e-5, 1 - 1e-5)
        yield Row("the explicit limit", seen=f"{stable:.4g} s", checks=(ratio,))
        yield too_long(what, scene, 1.0 / stable)
        methods = [*explicit(stable), *implicit(100.0, "100 s", 100), adaptive(1e4)]
        # Nothing here goes by the precision but what a long step makes of it.
        for method in methods if dtype == "float64" else methods[2:3]:
            yield judged(what, scene, method, (300.0, 400.0))
        if dtype == "float32":
            yield Row(f"{what}, 1e4 s", "TRBDF2, adaptive", dtype, seen=SLOW)


SLOW = (
    "not run: rounding of rates of 1e8 K/s keeps its steps short, and the tries it has "
    "before it says step_limit take minutes: use float64"
)

LENGTH, AIR, START = 0.1, 300.0, 400.0
MATERIAL = jt.Material(1.0, density=1000.0, specific_heat=1000.0)


def _biot_numbers() -> Iterator[Row]:
    """S05."""
    end = LENGTH**2 / float(MATERIAL.diffusivity) / 1e-6
    yield from _slab(1e-6, 8, end, float(np.exp(-1.0)), 128)
    odd = np.arange(1, 200, 2) * np.pi / 2
    fourier = 0.5
    series = float((2 / odd**2 * np.exp(-(odd**2) * fourier)).sum())
    end = fourier * LENGTH**2 / float(MATERIAL.diffusivity)
    yield from _slab(1e6, 160, end, series, 400)


def rod(cells: int, material: jt.Material, h: float) -> jt.Scene:
    """A line of voxels of one length that convects at one end.

    Args:
        cells: voxels.
        material: of them.
        h: heat transfer coefficient at the end [W/(m^2 K)].
    """
    grid = block(cells, 1, 1, LENGTH / cells)
    body = jt.Body(jt.FullVolume(grid), material, temperature=START)
    air = jt.Convection(h, AIR, on=jt.Side((1.0, 0.0, 0.0)))
    return jt.Scene((body,), (air,), dtype="float64")


def _slab(biot: float, cells: int, end: float, exact: float, steps: int):
    """A rod against a limit of its Biot number."""
    k = float(np.asarray(MATERIAL.conductivity))
    scene = rod(cells, MATERIAL, biot * k / LENGTH)
    stable, dt, note = stable_step(scene), end / steps, f"{steps} steps"
    what = f"Bi = {biot:g}"
    long = Method(f"SuperTimeStepping, {note}", jt.SuperTimeStepping(dt=dt), end)
    # Rounding of s stages grows as s^2 (Meyer et al. 2014).
    rounding = stage_count(dt, stable) ** 2 * float(np.finfo(float).eps)
    loose = Limits(LIMITS.overshoot, {"float64": max(1e-12, rounding)})
    yield _near(what, scene, long, exact, loose)
    for method in (*implicit(dt, note, steps), adaptive(end, error=1e-4)):
        yield _near(what, scene, method, exact)
    if end / stable < 1e5:
        euler = jt.ForwardEuler(dt=stable / 2)
        half = Method("ForwardEuler, half its limit", euler, end)
        yield _near(what, scene, half, exact)
    else:
        yield too_long(what, scene, dt / stable)


def _near(
    what: str, scene: jt.Scene, method: Method, exact: float, limits: Limits = LIMITS
) -> Row:
    """The mean at the end against the limit's."""
    ran = run_nodes(scene, method.solver, method.end)
    found = (float(ran.nodes[0].mean()) - AIR) / (START - AIR)
    seen = f"{found:.7f}, the limit {exact:.7f}"
    off = Bound("off the limit", abs(found - exact), 1e-5)
    if method.name.startswith("BackwardEuler"):
        off, seen = None, f"{seen}; of first order, not judged by that"
    more = () if off is None else (off,)
    row = row_of(what, scene.dtype, method, ran, (AIR, START), limits, more=more)
    return row._replace(seen=seen)


CASES = (
    Case(
        "S03",
        "voxels of 10 um and of 1 m in one scene: limits 8.6e13 to 1",
        "h^2 / 6 alpha; maximum principle",
        "implicit steps of 100 s are taken; explicit Euler refuses and names its limit",
        "",
        _small_and_large,
    ),
    Case(
        "S05",
        "Biot numbers of 1e-6 and 1e6",
        "Carslaw and Jaeger, Conduction of Heat in Solids, 3.3 and 3.11",
        "the mean of a slab agrees with exp(-t / tau), and with the series of a "
        "prescribed surface, to 1e-5 of the first excess",
        "",
        _biot_numbers,
    ),
)
