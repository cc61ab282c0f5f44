"""From a scene to the smallest program that does it.

A term that can do nothing is not bound, a body of one material gets no array of
conductivities, a scene without surface terms never touches its surface, bodies apart
have no contact, what stands still is looked at once: what is left out has no array and
no operation in the program, and the receipt says why.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np

from ...arrays import is_traced
from ..omissions import omissions, parts
from ..receipt import Receipt
from ..scene import Body, Scene
from ..solved_surface import SolvedSurface, body_geometry
from .bodies import prepare
from .memory_estimate import check_memory
from .program import Compiled, Program
from .program_builder import number_entries, programs
from .snapshot_times import snapshot_times
from .snapshots import Snapshot, take_snapshots
from .stability import stable_step
from .surface_terms import Bound
from .temperature_bounds import hottest, reach
from .volume import bind_volumes


def mechanism_names(scene: Scene) -> tuple[str, ...]:
    """One name a term: its kind, numbered from the second of a kind on."""
    names: list[str] = []
    for term in scene.terms:
        count = sum(name.split("#")[0] == term.name for name in names) + 1
        names.append(term.name if count == 1 else f"{term.name}#{count}")
    return tuple(names)


def compile_scene(
    scene: Scene, saves: int = 1, end: float | int = 0.0, prune: bool = True
) -> Compiled:
    """Bind every term to every body it acts on; drop what does nothing.

    Args:
        scene: bodies and terms.
        saves: how many times will be kept, for the forecast of memory.
        end: of the run [s]; what moves is taken anew up to then.
        prune: whether to leave out what does nothing; else it is computed, to 0, which
            is what tests compare with.

    Raises:
        InputError: if the program would not fit into memory, or terms contradict each
            other.
    """
    starts, names = snapshot_times(scene, end), mechanism_names(scene)
    memory, dtype = check_memory(scene, saves, len(starts)), jnp.dtype(scene.dtype)
    prepared = tuple(prepare(body, dtype) for body in scene.bodies)
    most = hottest(scene, prepared, end)
    within = reach(scene, prepared, most, end)
    snapshots = take_snapshots(scene, prepared, names, starts, end, within, prune)
    volumes, others = bind_volumes(scene, names)
    entries = number_entries(names, snapshots, volumes)
    made = programs(scene, prepared, snapshots, volumes, entries, within)
    limit = jnp.stack([stable_step(program, most, end) for program in made]).min()
    others += snapshots[0].touching.omitted
    bounds, structures = list(snapshots[0].bounds), [b.structure for b in scene.bodies]
    reached = parts(
        entries.entries, list(entries.number), bounds, snapshots[0].touching
    )
    return Compiled(
        programs=made,
        starts=starts,
        state=tuple(one.state for one in prepared),
        surfaces=tuple(map(_solved, scene.bodies, bounds)),
        stable_step=limit,
        hottest=most,
        receipt=Receipt(
            included=("conduction", *_mechanisms(made[0])),
            parts=reached,
            left_out=omissions(scene, names, bounds, others, len(starts) > 1),
            notes=_notes(snapshots, names),
            nodes=sum(s.node_count for s in structures),
            links=sum(s.link_count for s in structures),
            fragments=sum(len(b.surface.area) for b in bounds),
            snapshots=len(starts),
            capacity_ratios=tuple(s.capacity_ratio for s in structures),
            dtype=scene.dtype,
            memory_bytes=memory,
            stable_step_s=_known(limit),
        ),
    )


def _notes(snapshots: list[Snapshot], names: tuple[str, ...]) -> tuple[str, ...]:
    """Of all bindings, each once."""
    found = {
        f"{names[each.number]} on body {bound.surface.body}: {note}": None
        for snapshot in snapshots
        for bound in snapshot.bounds
        for each in bound.everything
        for note in each.binding.notes
    }
    return tuple(found)


def _mechanisms(program: Program) -> tuple[str, ...]:
    return tuple(dict.fromkeys(entry.mechanism for entry in program.entries))


def _solved(body: Body, bound: Bound) -> SolvedSurface:
    surface = bound.surface
    return SolvedSurface(
        geometry=body_geometry(surface.grid, body.pose),
        emissivity=jnp.asarray(surface.emissivity),
        absorptivity=jnp.asarray(surface.absorptivity),
    )


def _known(limit: Any) -> float | None:
    """A number for the receipt, which JSON can hold."""
    if is_traced(limit) or not np.isfinite(limit):
        return None
    return float(limit)
