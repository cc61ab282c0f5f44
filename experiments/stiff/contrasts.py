"""Contrasts of materials (S01, S02) and sizes (S03); long steps, Biot numbers, ends."""

from collections.abc import Iterator

import numpy as np

import jaxthermo as jt
from jaxthermo.integrate.explicit import stage_count
from jaxthermo.reference.slab import decay_crank_nicolson, decay_implicit_euler

from ..harness.case import PASS, Check, Row, case, refusal
from ..harness.scenes import full, stable_step
from .bodies import (
    AEROGEL,
    AIR,
    CELLS,
    COLD,
    COPPER,
    DIAMOND,
    HOT,
    LENGTH,
    PITCH,
    START,
    STEEL,
    block,
    insulated,
    rod,
)
from .solved import (
    LIMITS,
    Method,
    Observation,
    Ran,
    adaptive,
    damping,
    every_solver,
    explicit,
    implicit,
    implicit_limits,
    judged,
    too_long,
)


_DTYPES = ("float64", "float32")
# Every temperature stays between those of the two halves at the start [K].
_BOUNDS = (COLD, HOT)
_PATTERNS = ("laminate", "checkerboard")
# Stable steps in the longest step.
_LONGEST = 1e6


def through_all(label: str, scene: jt.Scene) -> Iterator[Row]:
    """Rows of every solver, of backward Euler in the longest step, and of a refusal."""
    stable = stable_step(scene)
    backward, *_ = implicit_limits(stable, _LONGEST)
    yield from judged(
        label=label,
        scene=scene,
        methods=[*every_solver(stable), backward],
        bounds=_BOUNDS,
    )
    yield too_long(label, scene)


_RULE = "maximum principle; rounding as measured on 200 alternating cells"
_KEPT = "no overshoot beyond 1e-9 K (float64), 5e-3 K (float32); energy to 1e-12, 1e-4"


@case(
    "S01", "conductivities of 1.5e5 to 1: alternating aerogel and diamond", _RULE, _KEPT
)
def _conductivities() -> Iterator[Row]:
    for name in _PATTERNS:
        for dtype in _DTYPES:
            yield from through_all(name, insulated(name, (AEROGEL, DIAMOND), dtype))


_AIR = jt.Material(0.026, density=1.18, specific_heat=1006.0)
_CAPACITIES = {
    "air and copper, rho c 2.9e3": (_AIR, COPPER),
    "rho c 1e6": (jt.Material(1.0, 1.0, 1.0), jt.Material(1.0, 1e3, 1e3)),
}


@case("S02", "heat capacities of 2.9e3 to 1 and of 1e6 to 1", _RULE, _KEPT)
def _capacities() -> Iterator[Row]:
    for words, pair in _CAPACITIES.items():
        for name in _PATTERNS:
            for dtype in _DTYPES:
                scene = insulated(name, pair, dtype)
                yield from through_all(f"{words}, {name}", scene)


_SLOW = (
    "not run: the rounding of rates of 1e8 K/s keeps the steps so short that the run "
    "ends with step_limit after minutes; use float64"
)


@case(
    "S03",
    "voxels of 10 um and of 1 m in one scene: stable steps of 8.6e13 to 1",
    "h^2 / 6 alpha; maximum principle",
    "implicit steps of 100 s are taken; explicit Euler refuses and names its limit",
)
def _small_and_large() -> Iterator[Row]:
    for dtype in _DTYPES:
        micrometres = block(3, 3, 3, pitch=1e-5)
        metres = block(3, 3, 3, pitch=1.0)
        small = full(micrometres, DIAMOND, temperature=400.0)
        large = full(metres, AEROGEL, temperature=300.0, x=10.0)
        air = jt.Convection(10.0, 350.0)
        scene = jt.Scene((small, large), (air,), dtype=dtype)
        label = "10 um diamond, 1 m aerogel"
        stable = stable_step(scene)
        # The limit is that of the smallest voxel; convection changes it by less.
        limit = 1e-10 / (6 * float(DIAMOND.diffusivity))
        ratio = Check(
            "limit over h^2 / 6 alpha",
            computed=stable / limit,
            highest=1 + 1e-5,
            lowest=1 - 1e-5,
        )
        yield Row("the explicit limit", seen=f"{stable:.4g} s", checks=(ratio,))
        yield too_long(label, scene, ratio=1.0 / stable)
        long_steps = implicit(100.0, "100 s", steps=100)
        if dtype == "float64":
            methods = [*explicit(stable), *long_steps, adaptive(1e4)]
        else:
            # The precision changes only what a long step makes of the contrast.
            methods = [m for m in long_steps if isinstance(m.solver, jt.BackwardEuler)]
        yield from judged(
            label=label, scene=scene, methods=methods, bounds=(300.0, 400.0)
        )
        if dtype == "float32":
            yield Row(
                f"{label}, 1e4 s", solver="TRBDF2, adaptive", dtype=dtype, seen=_SLOW
            )


@case(
    "S04",
    "steps of 1e-6 to 1e6 explicit limits",
    "Varga, Matrix Iterative Analysis, 8.2; Hosea and Shampine 1996",
    "backward Euler never overshoots; Crank-Nicolson overshoots above 2 limits only, "
    "where a step multiplies by (1 - z/2)/(1 + z/2); factors to 1e-9",
)
def _long_steps() -> Iterator[Row]:
    for dtype in _DTYPES:
        scene = insulated("uniform", (STEEL, STEEL), dtype)
        stable = stable_step(scene)
        methods: list[Method] = []
        for ratio in (1e-6, 1e-3, 1.0, 1e3, _LONGEST):
            backward, trapezoidal, _ = implicit_limits(stable, ratio)
            methods += [backward, trapezoidal]
        # All weights are positive where (1 - theta) dt <= C / sum G: up to 2 limits.
        _, trapezoidal, _ = implicit_limits(stable, 2.0)
        methods.append(trapezoidal._replace(bounds="kept"))
        yield from judged(label="a step", scene=scene, methods=methods, bounds=_BOUNDS)
    for z in (1e-6, 1.0, 1e3, 1e6):
        yield from _factors(z)


_ROOT = float(np.sqrt(2.0))
# Amplification of a mode that decays at z / dt, by one step.
_FACTORS = {
    "BackwardEuler": lambda z: decay_implicit_euler(z, 1.0, 1),
    "CrankNicolson": lambda z: decay_crank_nicolson(z, 1.0, 1),
    "TRBDF2": lambda z: (1 - (_ROOT - 1) * z) / (1 + (1 - _ROOT / 2) * z) ** 2,
}


def _factors(z: float) -> Iterator[Row]:
    """Amplification of the shortest mode by one step, against its formula."""
    cells = CELLS[0]

    def mode_at(points: np.ndarray) -> np.ndarray:
        cell = points[:, 0] / PITCH + cells / 2
        return np.cos(np.pi * (cells - 1) * cell / cells)

    def start_temperature(points: np.ndarray) -> np.ndarray:
        return 350.0 + 50.0 * mode_at(points)

    scene = insulated(
        "uniform", (STEEL, STEEL), dtype="float64", temperature=start_temperature
    )
    mode = mode_at(scene.bodies[0].structure.nodes().centre)
    # An exact mode of the cells, with their own rate of decay.
    sine = float(np.sin(np.pi * (cells - 1) / (2 * cells)))
    dt = z / (4 * float(STEEL.diffusivity) / PITCH**2 * sine**2)

    def difference_from_formula(ran: Ran) -> Observation:
        exact = _FACTORS[type(ran.method.solver).__name__](z)
        factor = float((ran.nodes[0] - 350.0) @ mode / (50.0 * mode @ mode))
        check = Check("off the formula", abs(factor - exact), 1e-9)
        return Observation(seen=f"factor {factor:.9f}", checks=(check,))

    methods = [
        method._replace(bounds="reported")
        for method in implicit(dt, f"z = {z:g}", steps=1)
    ]
    for row in judged(
        label="highest mode",
        scene=scene,
        methods=methods,
        bounds=_BOUNDS,
        observe=difference_from_formula,
    ):
        # The factor is judged by its formula, whatever the bounds are.
        yield row._replace(if_met=PASS)


@case(
    "S05",
    "Biot numbers of 1e-6 and 1e6",
    "Carslaw and Jaeger, Conduction of Heat in Solids, 3.3 and 3.11",
    "the mean of a slab agrees with exp(-t / tau), and with the series of a "
    "prescribed surface, to 1e-5 of the excess at the start",
)
def _biot_numbers() -> Iterator[Row]:
    material = jt.Material(1.0, density=1000.0, specific_heat=1000.0)
    square = LENGTH**2 / float(material.diffusivity)
    # One time constant, L^2 / (alpha Bi), of a slab of one temperature.
    yield from _slab(
        material,
        biot=1e-6,
        cells=8,
        end=square / 1e-6,
        exact=float(np.exp(-1.0)),
        steps=128,
    )
    odd = np.arange(1, 200, 2) * np.pi / 2
    fourier = 0.5
    terms = 2 / odd**2 * np.exp(-(odd**2) * fourier)
    series = float(terms.sum())
    # 160 cells: their error of second order is below 1e-5.
    yield from _slab(
        material,
        biot=1e6,
        cells=160,
        end=fourier * square,
        exact=series,
        steps=400,
    )


def _slab(
    material: jt.Material, biot: float, cells: int, end: float, exact: float, steps: int
) -> Iterator[Row]:
    """A rod against a limit of its Biot number."""
    k = float(np.asarray(material.conductivity))
    scene = rod(cells, material, biot * k / LENGTH)
    stable = stable_step(scene)
    dt = end / steps
    note = f"{steps} steps"
    label = f"Bi = {biot:g}"

    def mean_excess(ran: Ran) -> Observation:
        mean = float(ran.nodes[0].mean())
        excess = (mean - AIR) / (START - AIR)
        seen = f"{excess:.7f}, the limit {exact:.7f}"
        if isinstance(ran.method.solver, jt.BackwardEuler):
            return Observation(f"{seen}; not judged: its error is of first order")
        check = Check("off the limit", abs(excess - exact), 1e-5)
        return Observation(seen, checks=(check,))

    super_time_stepping = Method(
        f"SuperTimeStepping, {note}", solver=jt.SuperTimeStepping(dt=dt), end=end
    )
    # Rounding of s stages grows as s^2 (Meyer et al. 2014).
    rounding = stage_count(dt, stable) ** 2 * float(np.finfo(float).eps)
    limits = LIMITS._replace(energy={"float64": max(1e-12, rounding)})
    bounds = (AIR, START)
    yield from judged(
        label=label,
        scene=scene,
        methods=[super_time_stepping],
        bounds=bounds,
        observe=mean_excess,
        limits=limits,
    )
    methods = [*implicit(dt, note, steps), adaptive(end, error=1e-4)]
    # Beyond 1e5 steps explicit Euler would take longer than all others together.
    is_feasible = end / stable < 1e5
    if is_feasible:
        euler = jt.ForwardEuler(dt=stable / 2)
        methods.append(Method("ForwardEuler, half its limit", euler, end))
    yield from judged(
        label=label, scene=scene, methods=methods, bounds=bounds, observe=mean_excess
    )
    if not is_feasible:
        yield too_long(label, scene, ratio=dt / stable)


@case(
    "S22",
    "an end that is no multiple of the step, and an end at 0",
    "equal steps between save times",
    "every save time is met exactly; a run of 0 s changes no bit; dt = 0 is refused",
)
def _save_times() -> Iterator[Row]:
    scene = insulated("laminate", (AEROGEL, DIAMOND), "float64")
    for method in damping(scene):
        yield from _landed(scene, method)
        yield _no_time(scene, method)
    fixed_step_solvers = (
        jt.ForwardEuler,
        jt.SuperTimeStepping,
        jt.BackwardEuler,
        jt.CrankNicolson,
        jt.TRBDF2,
    )
    for solver_type in fixed_step_solvers:

        def run_without_step(solver_type=solver_type) -> object:
            return jt.simulate(scene, 1.0, solver=solver_type(dt=0.0))

        yield refusal(
            "dt = 0",
            run_without_step,
            reason="is no step",
            solver=solver_type.__name__,
            dtype=scene.dtype,
        )


def _landed(scene: jt.Scene, method: Method) -> Iterator[Row]:
    """Three save times, none of them a multiple of the step."""
    end = method.end * float(np.sqrt(2.0)) / 1.5
    saves = [end / np.pi, end / 2, end]

    def saved_times(ran: Ran) -> Observation:
        run = ran.solution.run
        times = np.asarray(ran.solution.times)
        lateness = float(np.abs(times / saves - 1).max())
        checks = [Check("off the save times", lateness, float(np.finfo(float).eps))]
        # Equal steps between save times are at most as long as the solver's step.
        longest_step = method.solver.dt
        if longest_step is not None:
            step_ratio = (run.dt or 0.0) / longest_step
            checks.append(Check("step over its own", step_ratio, 1 + 1e-9))
        return Observation(f"{run.steps} steps to 3 save times", tuple(checks))

    return judged(
        label="end no multiple of dt",
        scene=scene,
        methods=[method._replace(end=end)],
        bounds=_BOUNDS,
        observe=saved_times,
        save_at=saves,
    )


def _no_time(scene: jt.Scene, method: Method) -> Row:
    run = jt.simulate(scene, 0.0, solver=method.solver)
    surface = np.asarray(run.surface_temperature, float)[0]
    grid = scene.bodies[0].structure.voxels
    x = grid.lattice.centres(grid.fragment_voxel)[:, 0]
    start_temperature = np.where(x < 0, HOT, COLD)
    change = float(np.abs(surface - start_temperature).max())
    return Row(
        "t1 = 0",
        solver=method.name,
        dtype=scene.dtype,
        checks=(Check("moved", change, 0.0),),
    )


CASES = (
    _conductivities,
    _capacities,
    _small_and_large,
    _long_steps,
    _biot_numbers,
    _save_times,
)
