"""Scenes drawn at random: few shapes and structures, numbers over realistic ranges.

Scenes of one form differ in numbers only, so that each form runs as few programs.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import jaxthermo as jt
from jaxthermo.integrate.solvers import AbstractSolver
from jaxthermo.physics.term import AbstractTerm
from jaxthermo.structures.structure import AbstractStructure

from ..harness.scenes import stable_step
from ..stiff.solved import Bounds


SEED = 55
PITCHES = (5e-5, 2e-4, 1e-3, 5e-3, 2e-2)
"""Edges of voxels [m]: from foil to masonry."""

# Conductivity [W/(m K)], density [kg/m^3], specific heat [J/(kg K)].
_MATERIALS = (
    (429.0, 10490.0, 235.0),  # silver
    (401.0, 8960.0, 385.0),  # copper
    (237.0, 2700.0, 900.0),  # aluminium
    (60.0, 7870.0, 450.0),  # iron
    (16.0, 8000.0, 500.0),  # stainless steel
    (3.0, 3800.0, 880.0),  # ceramic
    (1.0, 2500.0, 840.0),  # glass
    (0.2, 1150.0, 1500.0),  # plastic
    (0.15, 600.0, 1700.0),  # wood
    (0.03, 30.0, 1400.0),  # foam
)
# Largest relative change of each of their numbers.
_VARIATION = 0.2
# Longest run [stable steps].
_MAX_STABLE_STEPS = 2e7
# Longest runs of solvers that take steps of about a stable step [stable steps].
_MAX_SHORT_STEPS = 2000
# Steps of the solvers with a given step.
_STEPS = 64


class _Loads(NamedTuple):
    """Terms of a scene, and the temperatures that they can lead to."""

    terms: tuple[AbstractTerm, ...]
    temperatures: tuple[float, ...]
    """Air, surroundings, prescribed surfaces, and air plus q / h under a heat flux q
    [K]."""
    heating_rate: float = 0.0
    """Largest q''' / (rho c) of heat sources [K/s]."""


class _Draw(NamedTuple):
    """Random numbers of a scene, and what terms depend on."""

    random: np.random.Generator
    materials: tuple[jt.Material, ...]
    """Material of each body."""
    h: float
    """Heat transfer coefficient of the air, which is around all bodies [W/(m^2 K)]."""
    end: float
    """End of the run [s]."""

    def uniform(self, low: float, high: float) -> float:
        """A number of a range."""
        return float(self.random.uniform(low, high))

    def temperature(self) -> float:
        """A temperature of air, surroundings or bodies [K]."""
        return self.uniform(250.0, 400.0)

    def table(self, low: float, high: float) -> jt.Table:
        """Four values of a range: a ramp, and a nearly sudden change at half the run.

        All of its times lie between the same two save times in every scene.
        """
        sudden = self.uniform(0.5, 0.55)
        gap = 10.0 ** self.uniform(-7.0, -2.0)
        times = np.array([0.1, 0.2, sudden, sudden + gap]) * self.end
        return jt.Table(times, self.random.uniform(low, high, 4))

    def heat_source(self) -> float:
        """A heat rate density that heats the first body by 1 to 80 K alone [W/m^3]."""
        heat_capacity = float(self.materials[0].volumetric_heat_capacity)
        return heat_capacity * self.uniform(1.0, 80.0) / self.end


def _in_heat(draw: _Draw) -> _Loads:
    """A heat flux on one side, in air."""
    air = draw.temperature()
    heat_flux = draw.uniform(50.0, 1500.0)
    top = jt.Side((0.0, 0.0, 1.0))
    terms = (jt.Convection(draw.h, air), jt.HeatFlux(heat_flux, on=top))
    return _Loads(terms, (air, air + heat_flux / draw.h))


def _between_gases(draw: _Draw) -> _Loads:
    """Hot and cold gas on two sides."""
    hot = draw.uniform(400.0, 773.0)
    cold = draw.temperature()
    terms = (
        jt.Convection(draw.h, hot, on=jt.Side((0.0, 0.0, 1.0))),
        jt.Convection(2.0 * draw.h, cold, on=jt.Side((0.0, 0.0, -1.0))),
    )
    return _Loads(terms, (hot, cold))


def _in_air(draw: _Draw) -> _Loads:
    """Air."""
    air = draw.temperature()
    return _Loads((jt.Convection(draw.h, air),), (air,))


def _radiating(draw: _Draw) -> _Loads:
    """Air, and surroundings of another temperature."""
    air = draw.temperature()
    surroundings = draw.uniform(230.0, 600.0)
    terms = (jt.Convection(draw.h, air), jt.Surroundings(surroundings))
    return _Loads(terms, (air, surroundings))


def _in_sun(draw: _Draw) -> _Loads:
    """Air, surroundings and sun."""
    radiating = _radiating(draw)
    irradiance = draw.uniform(100.0, 1000.0)
    sun = jt.Sun((-1.0, -0.5, -1.0), irradiance)
    sunlit = radiating.temperatures[0] + irradiance / draw.h
    return _Loads((*radiating.terms, sun), (*radiating.temperatures, sunlit))


def _held(draw: _Draw) -> _Loads:
    """A side of prescribed temperature, in air."""
    air = draw.temperature()
    prescribed = draw.uniform(250.0, 700.0)
    side = jt.Side((1.0, 0.0, 0.0))
    terms = (jt.Convection(draw.h, air), jt.FixedTemperature(prescribed, on=side))
    return _Loads(terms, (air, prescribed))


def _with_source(draw: _Draw) -> _Loads:
    """A heat source in one half of the first body, in air."""
    air = draw.temperature()
    density = draw.heat_source()
    half = jt.Region((-1.0, -1.0, -1.0), (0.0, 1.0, 1.0))
    terms = (jt.Convection(draw.h, air), jt.HeatSource(density, within=half))
    heating_rate = density / float(draw.materials[0].volumetric_heat_capacity)
    return _Loads(terms, (air,), heating_rate)


def _in_changing_air(draw: _Draw) -> _Loads:
    """Air whose temperature changes in time."""
    air = draw.table(250.0, 400.0)
    return _Loads((jt.Convection(draw.h, air),), tuple(map(float, air.values)))


def _in_changing_heat(draw: _Draw) -> _Loads:
    """A heat flux that changes in time, in air, with surroundings."""
    radiating = _radiating(draw)
    heat_flux = draw.table(0.0, 1500.0)
    heated = radiating.temperatures[0] + float(np.max(heat_flux.values)) / draw.h
    terms = (*radiating.terms, jt.HeatFlux(heat_flux, on=jt.Side((0.0, 0.0, 1.0))))
    return _Loads(terms, (*radiating.temperatures, heated))


class _Form(NamedTuple):
    """Shapes, structure and terms, which scenes of the same programs share."""

    name: str
    shapes: tuple[tuple[int, int, int], ...]
    """Voxels of each body; the second one stands on the first one's side +x."""
    structure: Callable[[jt.VoxelGrid], AbstractStructure]
    loads: Callable[[_Draw], _Loads]


_SHEET = (10, 8, 1)
_LAYERS = (10, 8, 4)
_BLOCK = (10, 8, 6)

FORMS = (
    _Form("sheet in heat, full", (_SHEET,), jt.FullVolume, _in_heat),
    _Form("layers between gases, full", (_LAYERS,), jt.FullVolume, _between_gases),
    _Form("block radiating, full", (_BLOCK,), jt.FullVolume, _radiating),
    _Form(
        "block in air, aggregate x2",
        (_BLOCK,),
        functools.partial(jt.Aggregate, factor=2),
        _in_air,
    ),
    _Form("block in sun, octree", (_BLOCK,), jt.Octree, _in_sun),
    _Form(
        "block held, shell over core",
        (_BLOCK,),
        functools.partial(jt.ShellOverCore, factor=2),
        _held,
    ),
    _Form(
        "block with a source, multi-level",
        (_BLOCK,),
        functools.partial(jt.MultiLevel, levels=2, hollow="innermost"),
        _with_source,
    ),
    _Form("two blocks with a source, full", (_BLOCK,) * 2, jt.FullVolume, _with_source),
    _Form("block in changing heat, full", (_BLOCK,), jt.FullVolume, _in_changing_heat),
    _Form("block in changing air, shell", (_BLOCK,), jt.SingleShell, _in_changing_air),
    _Form(
        "block held, aggregate x3",
        (_BLOCK,),
        functools.partial(jt.Aggregate, factor=3),
        _held,
    ),
    _Form("two blocks radiating, octree", (_BLOCK,) * 2, jt.Octree, _radiating),
)


class Drawn(NamedTuple):
    """One scene, and how it is run."""

    form: str
    scene: jt.Scene
    save_at: tuple[float, ...]
    """Save times, the last one of which is the end [s]."""
    solver: AbstractSolver
    """A solver besides the default one."""
    solver_end: float
    """End of its run [s]."""
    bounds: Bounds
    """Lowest and highest temperature that the maximum principle allows [K]."""


@functools.cache
def _structures(form: _Form, pitch: float) -> tuple[AbstractStructure, ...]:
    structures = []
    for shape in form.shapes:
        x, y, z = (count * pitch for count in shape)
        grid = jt.voxelize(jt.shapes.box((x, y, z)), pitch)
        structures.append(form.structure(grid))
    return tuple(structures)


def draw(number: int) -> Drawn:
    """The scene of a number from 0; the same one in every process."""
    random = np.random.default_rng((SEED, number))
    form = FORMS[number % len(FORMS)]
    turn = number // len(FORMS)
    pitch = float(random.choice(PITCHES))
    structures = _structures(form, pitch)
    materials = tuple(_material(random) for _ in structures)
    h = float(10.0 ** random.uniform(0.5, 2.5))
    grid = structures[0].grid
    length = structures[0].volume / float(grid.fragment_area.sum())
    capacity_per_area = length * float(materials[0].volumetric_heat_capacity)
    end = float(10.0 ** random.uniform(-1.5, 0.5)) * capacity_per_area / h
    starts = tuple(float(random.uniform(250.0, 400.0)) for _ in structures)
    bodies = _bodies(structures, materials, starts)
    dtype = ("float32", "float64")[turn % 2]
    loads = form.loads(_Draw(random, materials, h, end))
    terms = loads.terms
    if len(bodies) > 1:
        terms = (*terms, jt.Contact(float(10.0 ** random.uniform(1.0, 5.0))))
    scene = jt.Scene(bodies, terms, dtype=dtype)
    stable = stable_step(scene)
    end = min(end, _MAX_STABLE_STEPS * stable)
    solvers = _solvers(end, stable)
    first = number % len(solvers)
    solver, solver_end = solvers[(first + 2 * (turn // 2 % 2)) % len(solvers)]
    temperatures = (*starts, *loads.temperatures)
    fractions = (random.uniform(0.25, 0.4), random.uniform(0.65, 0.9), 1.0)
    return Drawn(
        form=form.name,
        scene=scene,
        save_at=tuple(float(fraction) * end for fraction in fractions),
        solver=solver,
        solver_end=solver_end,
        bounds=(min(temperatures), max(temperatures) + loads.heating_rate * end),
    )


def _material(random: np.random.Generator) -> jt.Material:
    values = random.choice(_MATERIALS) * random.uniform(
        1 - _VARIATION, 1 + _VARIATION, 3
    )
    conductivity, density, specific_heat = map(float, values)
    emissivity = float(random.uniform(0.05, 0.98))
    return jt.Material(conductivity, density, specific_heat, emissivity=emissivity)


def _bodies(
    structures: tuple[AbstractStructure, ...],
    materials: tuple[jt.Material, ...],
    starts: tuple[float, ...],
) -> tuple[jt.Body, ...]:
    """Bodies side by side along x, each of one temperature at the start [K]."""
    bodies = []
    along_x = 0.0
    for structure, material, start in zip(structures, materials, starts, strict=True):
        pose = jt.Pose(translation=(along_x, 0.0, 0.0))
        bodies.append(jt.Body(structure, material, temperature=start, pose=pose))
        along_x += structure.grid.lattice.shape[0] * structure.grid.pitch
    return tuple(bodies)


def _solvers(end: float, stable: float) -> list[tuple[AbstractSolver, float]]:
    """The solvers besides the default one, with the ends of their runs [s]."""
    short_end = min(end, _MAX_SHORT_STEPS * stable)
    step = end / _STEPS
    return [
        (jt.SuperTimeStepping(dt=step), end),
        (jt.BackwardEuler(dt=step), end),
        (jt.TRBDF2(), end),
        (jt.ForwardEuler(), short_end),
        # Above a few stable steps the trapezoidal rule oscillates.
        (jt.CrankNicolson(dt=min(stable, short_end / _STEPS)), short_end),
    ]
