"""From a scene to the smallest program that simulates it.

A term that has no effect is not bound, a body of one material gets no array of
conductivities, a scene without surface terms never evaluates its surface, bodies apart
have no contact, and what stands still has one snapshot: what is left out has no array
and no operation in the program, and the receipt says why.
"""

import jax.numpy as jnp
import numpy as np

from ...arrays import is_traced
from ...physics.term import BodySurface
from ..receipt import Omission, Receipt, omissions, on_body
from ..scene import Body, Scene
from ..solved_surface import SolvedSurface, body_geometry
from .bodies import prepare
from .limits import check_memory, max_temperature, stable_step, temperature_range
from .program import Compiled
from .program_builder import ProgramBuilder, bind_volumes, number_entries
from .snapshots import Snapshot, snapshot_times, take_snapshots


def mechanism_names(scene: Scene) -> tuple[str, ...]:
    """One name per term: its kind, numbered from the second of a kind on."""
    names: list[str] = []
    for term in scene.terms:
        count = sum(name.split("#")[0] == term.name for name in names) + 1
        names.append(term.name if count == 1 else f"{term.name}#{count}")
    return tuple(names)


def compile_scene(
    scene: Scene, saves: int = 1, end: float | int = 0.0, prune: bool = True
) -> Compiled:
    """Bind all terms to the scene, leaving out those without effect.

    Args:
        scene: bodies and terms.
        saves: number of times that are saved, for the estimate of memory.
        end: of the run [s], up to which snapshots of moving geometry are taken.
        prune: False to compute terms without effect, for comparison in tests.

    Raises:
        InputError: if the program would not fit into memory, or terms contradict each
            other.
    """
    # Memory is checked before anything large is made.
    starts, names = snapshot_times(scene, end), mechanism_names(scene)
    memory, dtype = check_memory(scene, saves, len(starts)), jnp.dtype(scene.dtype)
    prepared = tuple(prepare(body, dtype) for body in scene.bodies)
    hottest = max_temperature(scene, prepared, end)
    temperatures = temperature_range(scene, prepared, hottest, end)
    snapshots = take_snapshots(scene, prepared, names, starts, end, temperatures, prune)
    volumes, others = bind_volumes(scene, names)
    ledger = number_entries(names, snapshots, volumes, prune)
    programs = ProgramBuilder(
        scene, prepared, snapshots, volumes, ledger, temperatures
    ).programs()
    # One step for all snapshots: the smallest.
    limit = jnp.stack([stable_step(each, hottest, end) for each in programs]).min()
    first, structures = snapshots[0], [body.structure for body in scene.bodies]
    surfaces = first.surface.surface.bodies
    mechanisms = dict.fromkeys(entry.mechanism for entry in ledger.entries)
    omitted = [_omitted(scene, names, first, n) for n in range(len(scene.bodies))]
    finite = not is_traced(limit) and np.isfinite(limit)
    return Compiled(
        programs=programs,
        starts=starts,
        state=tuple(body.state for body in prepared),
        surfaces=tuple(map(_solved, scene.bodies, surfaces)),
        stable_step=limit,
        hottest=hottest,
        receipt=Receipt(
            included=("conduction", *mechanisms),
            parts=ledger.parts(first),
            left_out=omissions(
                scene, omitted, (*others, *first.omitted), len(starts) > 1
            ),
            notes=_notes(snapshots, names),
            nodes=sum(s.node_count for s in structures),
            links=sum(s.link_count for s in structures),
            fragments=sum(len(surface.area) for surface in surfaces),
            snapshots=len(starts),
            capacity_ratios=tuple(s.capacity_ratio for s in structures),
            dtype=scene.dtype,
            memory_bytes=memory,
            # JSON has no infinity.
            stable_step_s=float(limit) if finite else None,
        ),
    )


def _omitted(
    scene: Scene, names: tuple[str, ...], snapshot: Snapshot, body: int
) -> list[Omission]:
    """Surface terms that do not act on a body."""
    found = {
        number: omitted.reason
        for number, omitted in snapshot.surface.omitted
        if omitted.body in (None, body)
    }
    return [Omission(on_body(names[n], body, scene), found[n]) for n in sorted(found)]


def _notes(snapshots: list[Snapshot], names: tuple[str, ...]) -> tuple[str, ...]:
    """Notes of all bindings, each once."""
    found = {
        f"{names[number]} on body {body}: {note}": None
        for snapshot in snapshots
        for body in range(len(snapshot.surface.surface.bodies))
        for number, binding in snapshot.surface.bindings
        for on, note in binding.notes
        if on == body
    }
    return tuple(found)


def _solved(body: Body, surface: BodySurface) -> SolvedSurface:
    return SolvedSurface(
        geometry=body_geometry(surface.grid, body.pose),
        emissivity=jnp.asarray(surface.emissivity),
        absorptivity=jnp.asarray(surface.absorptivity),
    )
