"""From a scene to the smallest program that simulates it.

A term that has no effect is not bound, a body of one material gets no array of
conductivities, a scene without surface terms never evaluates its surface, bodies apart
have no contact, and what stands still has one snapshot: what is left out has no array
and no operation in the program, and the receipt says why.

Scenes that differ in their numbers alone are bound once, see `traced_scene`.
"""

import operator
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from ...arrays import is_compiling, is_traced
from ...memo.found import on_device, searches_recorded
from ...memo.once import once
from ...physics.flux_law import Forcing
from ...physics.radiation.irradiation import (
    SceneRadiation,
    SurfaceRadiation,
    surface_radiation,
)
from ...physics.surface import BodySurface, Note, Omitted
from ...physics.term import AbstractExchangeTerm
from ...structures.sheet_report import sheet_notes, sheet_warnings
from ..air import bodies_with_surface, check_airs
from ..motion import Motion
from ..scene import Scene, body_geometry, mechanism_names
from .bodies import PreparedGroup, check_bodies, check_terms, prepare
from .body_names import named_receipt, naming_bodies
from .body_program import SurfaceCoefficients
from .groups import body_groups, speed_classes
from .joint_lines import check_joints, joint_lines
from .memory import Method, check_memory
from .newton_iterations import with_iterations
from .penetration import penetration_warnings
from .program import Compiled, Program
from .program_builder import (
    Ledger,
    ProgramBuilder,
    Volumes,
    acting_terms,
    bind_volumes,
    breakpoints_of,
    ledger_entries,
)
from .receipt import filled_warnings, receipt_of, sheet_lines
from .snapshots import Snapshot, take_snapshots
from .stable_step import stable_rates_of
from .temperature_bounds import temperature_bounds
from .time_values import with_time_values
from .traced_scene import mark_untraceable, separate_numbers, trace_scene


@naming_bodies
def compile_scene(
    scene: Scene,
    saves: int = 1,
    end: float | int = 0.0,
    prune: bool = True,
    method: Method = "euler",
    save_times: tuple[float, ...] | None = None,
    duration: float | None = None,
    joins: bool = True,
) -> Compiled:
    """Bind all terms to the scene, leaving out those without effect.

    Args:
        scene: bodies and terms.
        saves: number of times that are saved, for the estimate of memory.
        end: of the run [s], up to which snapshots of moving geometry are taken.
        prune: False to compute terms without effect, for comparison in tests.
        method: kind of steps, for the estimate of memory.
        save_times: times that a run saves [s], up to which functions of time are
            integrated; None to leave them as they are.
        duration: time for which the values up to `end` act [s], infinite for a steady
            state; None for `end`.
        joins: False for a network of each body by itself.

    Raises:
        InputError: if the program would not fit into memory, or terms contradict each
            other.
    """
    # Memory is checked before anything large is made.
    starts = _snapshot_times(scene, end)
    numbers = tuple(range(len(scene.bodies)))
    classes = speed_classes(scene, float(end)) if joins else numbers
    memory = check_memory(
        scene, saves=saves, snapshots=len(starts), method=method, classes=classes
    )
    time_values = with_time_values(scene, float(end), save_times)
    scene = time_values.scene
    check_airs(scene)
    check_terms(scene, end)
    with searches_recorded() as searches:
        compiled = _bound(
            scene,
            classes=classes,
            starts=starts,
            end=float(end),
            duration=float(end if duration is None else duration),
            prune=prune,
        )
    programs = compiled.programs
    temperatures = compiled.temperatures.known()
    # How many iterations are compiled follows from numbers that must be known.
    if temperatures is not None and not is_traced(programs):
        programs = with_iterations(programs, temperatures, float(end))
    compiled = replace(
        compiled,
        programs=programs,
        breakpoints=breakpoints_of(scene, compiled.acting),
    )
    lines = [
        f"{name} on body {note.body}: {line}"
        for name, note in compiled.notes
        for line in note.lines()
    ]
    receipt = replace(
        compiled.receipt,
        notes=(
            *compiled.receipt.notes,
            *joint_lines(scene, compiled.receipt.parts),
            *sheet_lines(scene, sheet_notes),
            *dict.fromkeys(lines),
            *time_values.notes(compiled.acting),
        ),
        warnings=(
            *compiled.receipt.warnings,
            *filled_warnings(scene),
            *sheet_lines(scene, sheet_warnings),
            *penetration_warnings(scene, compiled, save_times or ()),
            *time_values.warnings(compiled.acting, compiled.receipt.parts),
        ),
        memory_bytes=memory,
        searches=tuple(dict.fromkeys(searches)),
    )
    return replace(compiled, receipt=named_receipt(receipt, scene))


def _bound(
    scene: Scene,
    classes: tuple[int, ...],
    starts: tuple[float, ...],
    end: float,
    duration: float,
    prune: bool,
) -> Compiled:
    """Bind a scene, or compute what was traced for other numbers of the same form."""
    bind = partial(
        _bind, classes=classes, starts=starts, end=end, duration=duration, prune=prune
    )
    # Many snapshots would be one large program.
    if len(starts) > 1 or _needs_numbers(scene) or scene.is_traced or is_compiling():
        return bind(scene)
    terms = tuple(term.by_numbers for term in scene.terms)
    if any(map(operator.is_not, terms, scene.terms)):
        scene = replace(scene, terms=terms)
    numbers = separate_numbers(scene)
    if numbers.form is None:
        return bind(scene)

    def bind_numbers(scene: Scene) -> Compiled:
        return _from_uniform_start(scene, bind(scene), classes)

    options = (classes, end, duration, prune)
    try:
        traced = trace_scene(scene, numbers, bind=bind_numbers, by=options)
    except RuntimeError:
        # As of JAX's caches after an interrupt: they say nothing about the scene.
        raise
    except Exception as error:
        # Errors that do not come from tracing are raised again, with numbers in their
        # texts.
        compiled = bind(scene)
        # Classes of a user may read their numbers, as to choose a law by them. Any
        # other error may be one that a library raised in place of an interrupt.
        if isinstance(error, jax.errors.JAXTypeError):
            mark_untraceable(numbers, by=options)
        return compiled
    return bind(scene) if traced is None else traced(numbers.values)


def _needs_numbers(scene: Scene) -> bool:
    """True if the numbers of a scene must be known where it is bound."""
    # Values of a function of positions are checked.
    has_numbers_within = any(
        callable(body.temperature) and not jax.tree_util.all_leaves([body.temperature])
        for body in scene.bodies
    )
    # Without 64 bits, tracing would round to 32 bits what the host need not.
    is_rounded = scene.dtype == "float64" and jnp.result_type(float) != jnp.float64
    chooses_laws = any(term.chooses_law for term in scene.terms)
    # Devices place known arrays.
    is_spread = scene.device_count > 1
    return is_spread or has_numbers_within or is_rounded or chooses_laws


def _from_uniform_start(
    scene: Scene, compiled: Compiled, classes: tuple[int, ...]
) -> Compiled:
    """Return a scene whose numbers have no derivatives, with 0 for a uniform start."""
    dtype = jnp.dtype(scene.dtype)
    start = tuple(
        values
        if any(callable(body.temperature) for body in group.bodies)
        else np.zeros((), dtype)
        for group, values in zip(
            body_groups(scene, classes), compiled.start, strict=True
        )
    )
    return replace(compiled, start=start)


class _BoundPrograms(NamedTuple):
    """Programs of a scene, with what they were made from."""

    programs: tuple[Program, ...]
    snapshots: list[Snapshot]
    ledger: Ledger
    volumes: Volumes
    unheated: list[tuple[int, Omitted]]
    """Terms that heat no inside, by number."""
    accuracy: tuple[str, ...]
    """Notes on the accuracy of an exchange."""


def _bound_programs(
    scene: Scene,
    prepared: tuple[PreparedGroup, ...],
    starts: tuple[float, ...],
    end: float,
    prune: bool,
    temperatures: Forcing | None,
) -> _BoundPrograms:
    """Bind the terms of a scene; some choose their laws by bounds of temperatures."""
    snapshots = take_snapshots(
        scene,
        prepared=prepared,
        starts=starts,
        end=end,
        temperatures=temperatures,
        prune=prune,
    )
    check_joints(scene, snapshots)
    volumes, unheated = bind_volumes(scene)
    ledger = ledger_entries(scene, snapshots=snapshots, volumes=volumes, prune=prune)
    builder = ProgramBuilder(
        scene=scene,
        prepared=prepared,
        snapshots=snapshots,
        volumes=volumes,
        ledger=ledger,
    )
    programs, accuracy = builder.programs()
    return _BoundPrograms(
        # All arrays of the host go to the device at once.
        programs=on_device(programs),
        snapshots=snapshots,
        ledger=ledger,
        volumes=volumes,
        unheated=unheated,
        accuracy=accuracy,
    )


def _bind(
    scene: Scene,
    classes: tuple[int, ...],
    starts: tuple[float, ...],
    end: float,
    duration: float,
    prune: bool,
) -> Compiled:
    """Bind a scene, whose numbers may be traced."""
    dtype = jnp.dtype(scene.dtype)
    prepared = tuple(
        prepare(number, group, dtype)
        for number, group in enumerate(body_groups(scene, classes))
    )
    check_bodies(scene, prepared)
    bind = partial(
        _bound_programs, scene, prepared=prepared, starts=starts, end=end, prune=prune
    )
    bound = bind(temperatures=None)
    temperatures = temperature_bounds(
        scene,
        prepared=prepared,
        programs=bound.programs,
        end=end,
        duration=duration,
    )
    if any(term.chooses_law for term in scene.terms):
        bound = bind(temperatures=temperatures.known())
    programs = bound.programs
    snapshots = bound.snapshots
    # The radiation stays on the host, since few solutions are asked for it.
    radiation = SceneRadiation(starts, _radiation(scene, snapshots, programs))
    surfaces = snapshots[0].surface.bodies
    coefficients = tuple(
        SurfaceCoefficients.of_bodies([getattr(body, name) for body in surfaces])
        for name in ("emissivity", "absorptivity")
    )
    temperatures, coefficients = on_device((temperatures, coefficients))
    # One step for all snapshots: the smallest.
    stable_rates = stable_rates_of(programs, temperatures.highest, end)
    return Compiled(
        programs=programs,
        starts=starts,
        acting=acting_terms(bound.ledger),
        classes=classes,
        start=tuple(body.state for body in prepared),
        state_shapes=tuple(body.structure.state_shape for body in prepared),
        geometries=tuple(
            body_geometry(
                surface.grid,
                pose=body.pose,
                material=body.material,
                is_enclosed=_unreached(surface),
                name=body.name,
            )
            for body, surface in zip(bodies_with_surface(scene), surfaces, strict=True)
        ),
        emissivity=coefficients[0],
        absorptivity=coefficients[1],
        radiation=radiation,
        temperatures=temperatures,
        stable_rates=stable_rates,
        stable_step=stable_rates.step(tuple(range(len(prepared)))),
        notes=tuple(_notes(snapshots, mechanism_names(scene))),
        receipt=receipt_of(
            scene,
            snapshots=snapshots,
            starts=starts,
            end=end,
            ledger=bound.ledger,
            volumes=bound.volumes,
            unheated=bound.unheated,
            accuracy=bound.accuracy,
        ),
    )


def _notes(
    snapshots: list[Snapshot], names: tuple[str, ...]
) -> Iterator[tuple[str, Note]]:
    """Notes of all bindings, by body, with their mechanisms."""
    for snapshot in snapshots:
        for body in range(len(snapshot.surface.bodies)):
            for number, binding in snapshot.bindings:
                for note in binding.notes:
                    if note.body == body:
                        yield names[number], note


def _unreached(surface: BodySurface) -> Bool[np.ndarray, " s"] | None:
    """Fragments in closed cavities and on adiabatic backs; None for none."""
    masks = (surface.enclosed, surface.grid.adiabatic)
    unreached = [mask for mask in masks if mask is not None]
    return np.logical_or.reduce(unreached) if unreached else None


def _snapshot_times(scene: Scene, end: float) -> tuple[float, ...]:
    """Increasing times from 0, each the start of a time in which nothing moves [s]."""
    times = {0.0}
    for body in scene.bodies:
        if isinstance(body.pose, Motion):
            times |= {t for t in body.pose.snapshot_times(end) if 0 < t < end}
    for term in scene.terms:
        if term.moves:
            times |= {t for t in term.snapshot_times(end) if 0 < t < end}
    return tuple(sorted(times))


def _radiation(
    scene: Scene, snapshots: list[Snapshot], programs: tuple[Program, ...]
) -> tuple[SurfaceRadiation, ...]:
    """Irradiation of the surface at each snapshot, in arrays of the programs if any."""
    exchange = [t for t in scene.terms if isinstance(t, AbstractExchangeTerm)]
    enclosure_on = once(exchange[0].enclosure) if exchange else None
    reaching = []
    for snapshot, program in zip(snapshots, programs, strict=True):
        enclosure = program.fine_enclosure
        # Surfaces that only reflect, or are held at a temperature, take no heat.
        if enclosure is None and enclosure_on is not None:
            enclosure, _ = enclosure_on(snapshot.surface)
        reaching.append(
            surface_radiation(snapshot.surface, snapshot.irradiation, enclosure)
        )
    return tuple(reaching)
