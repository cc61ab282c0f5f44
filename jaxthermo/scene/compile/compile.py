"""From a scene to the smallest program that simulates it.

A term that has no effect is not bound, a body of one material gets no array of
conductivities, a scene without surface terms never evaluates its surface, bodies apart
have no contact, and what stands still has one snapshot: what is left out has no array
and no operation in the program, and the receipt says why.
"""

from dataclasses import replace
from functools import reduce

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ...findings import digest, found, on_device, searches_recorded
from ...module import replaced
from ...physics.radiation.irradiation import (
    SceneRadiation,
    SurfaceRadiation,
    surface_radiation,
)
from ...physics.surface import BodySurface, Omitted
from ...physics.term import AbstractExchangeTerm, AbstractSurfaceTerm
from ...structures.structure import AbstractStructure
from ..scene import (
    AbstractMaterials,
    Scene,
    SolvedSurface,
    body_geometry,
)
from .bodies import check_functions, prepare, temperature_bounds
from .memory import Method, check_memory
from .program import Compiled, Omission, Part, Program, Receipt
from .program_builder import (
    Ledger,
    ProgramBuilder,
    bind_volumes,
    breakpoints_of,
    ledger_entries,
)
from .snapshots import Snapshot, take_snapshots


# Why a mechanism of most scenes is not in this one, and the terms that stand for it.
_ABSENT = {
    "sun": ("the scene has no source", {"sun", "point_source", "area_source"}),
    "convection": (
        "the scene has no moving air or coefficient",
        {"convection", "wind", "free_convection"},
    ),
    "emission": ("the scene has no surroundings", {"emission"}),
}


def mechanism_names(scene: Scene) -> tuple[str, ...]:
    """One name per term: its kind, numbered from the second of a kind on."""
    names: list[str] = []
    for term in scene.terms:
        count = sum(name.split("#")[0] == term.name for name in names) + 1
        names.append(term.name if count == 1 else f"{term.name}#{count}")
    return tuple(names)


def compile_scene(
    scene: Scene,
    saves: int = 1,
    end: float | int = 0.0,
    prune: bool = True,
    method: Method = "euler",
) -> Compiled:
    """Bind all terms to the scene, leaving out those without effect.

    Args:
        scene: bodies and terms.
        saves: number of times that are saved, for the estimate of memory.
        end: of the run [s], up to which snapshots of moving geometry are taken.
        prune: False to compute terms without effect, for comparison in tests.
        method: kind of steps, for the estimate of memory.

    Raises:
        InputError: if the program would not fit into memory, or terms contradict each
            other.
    """
    with searches_recorded() as searches:
        compiled = _compile(scene, saves=saves, end=end, prune=prune, method=method)
    receipt = replace(compiled.receipt, searches=tuple(dict.fromkeys(searches)))
    return replaced(compiled, receipt=receipt)


def _compile(
    scene: Scene, saves: int, end: float | int, prune: bool, method: Method
) -> Compiled:
    # Memory is checked before anything large is made.
    starts = _snapshot_times(scene, end)
    names = mechanism_names(scene)
    memory = check_memory(scene, saves=saves, snapshots=len(starts), method=method)
    prepared = tuple(
        prepare(n, body, jnp.dtype(scene.dtype)) for n, body in enumerate(scene.bodies)
    )
    check_functions(scene, prepared, end)
    hottest, temperatures = temperature_bounds(scene, prepared, end)
    snapshots = take_snapshots(
        scene,
        prepared=prepared,
        starts=starts,
        end=end,
        temperatures=temperatures,
        prune=prune,
    )
    volumes, unheated = bind_volumes(scene)
    ledger = ledger_entries(names, snapshots=snapshots, volumes=volumes, prune=prune)
    builder = ProgramBuilder(
        scene=scene,
        prepared=prepared,
        snapshots=snapshots,
        volumes=volumes,
        ledger=ledger,
        temperatures=temperatures,
        end=float(end),
    )
    programs, accuracy = builder.programs()
    first = snapshots[0]
    structures = [body.structure for body in scene.bodies]
    surfaces = first.surface.bodies
    radiation = SceneRadiation(starts, _radiation(scene, snapshots, programs))
    solved = _solved_surfaces(scene, surfaces)
    # All arrays of the host go to the device at once. The radiation stays on the host,
    # since few solutions are asked for it.
    programs, hottest, solved = on_device((programs, hottest, solved))
    mechanisms = dict.fromkeys(ledger.values())
    return Compiled(
        programs=programs,
        starts=starts,
        breakpoints=breakpoints_of(scene, ledger),
        start=tuple(body.state for body in prepared),
        surfaces=solved,
        radiation=radiation,
        hottest=hottest,
        end=float(end),
        receipt=Receipt(
            included=("conduction", *mechanisms),
            parts=_parts(ledger, first),
            left_out=_omissions(
                scene,
                names=names,
                snapshot=first,
                unheated=unheated,
                moves=len(starts) > 1,
            ),
            notes=(
                *_represented(first, off=False),
                *_cavity_notes(scene, first),
                *_notes(snapshots, names),
                *accuracy,
            ),
            warnings=(
                *_overlap_warnings(snapshots, starts),
                *_cavity_warnings(scene, first),
                *_represented(first, off=True),
            ),
            structures=tuple(_described(s) for s in structures),
            nodes=sum(s.node_count for s in structures),
            links=sum(s.link_count for s in structures),
            fragments=sum(len(surface.area) for surface in surfaces),
            snapshots=len(starts),
            capacity_ratios=tuple(s.capacity_ratio for s in structures),
            dtype=scene.dtype,
            memory_bytes=memory,
        ),
    )


def _solved_surfaces(
    scene: Scene, surfaces: tuple[BodySurface, ...]
) -> tuple[SolvedSurface, ...]:
    return tuple(
        SolvedSurface(
            geometry=body_geometry(surface.grid, body.pose, body.material),
            emissivity=surface.emissivity,
            absorptivity=surface.absorptivity,
        )
        for body, surface in zip(scene.bodies, surfaces, strict=True)
    )


def _described(structure: AbstractStructure) -> str:
    # Blocks have a factor, which the number of nodes or a size may have chosen.
    factor = getattr(structure, "factor", None)
    count = structure.node_count
    name = type(structure).__name__ + ("" if factor is None else f" x{factor}")
    return f"{name}, {count:,} node{'s' * (count != 1)}"


def _snapshot_times(scene: Scene, end: float) -> tuple[float, ...]:
    """Increasing times from 0, each the start of a time in which nothing moves [s]."""
    times = {0.0}
    for body in scene.bodies:
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
    reaching = []
    for snapshot, program in zip(snapshots, programs, strict=True):
        enclosure = program.fine_enclosure
        # Surfaces that only reflect, or are held at a temperature, take no heat.
        if enclosure is None and exchange:
            enclosure = exchange[0].enclosure(snapshot.surface)[0]
        reaching.append(
            surface_radiation(snapshot.surface, snapshot.irradiation, enclosure)
        )
    return tuple(reaching)


def _parts(ledger: Ledger, snapshot: Snapshot) -> tuple[Part, ...]:
    """The surface that each entry of the ledger acts on."""
    acting_parts = []
    surface = snapshot.surface
    total_area = [float(body.grid.fragment_area.sum()) for body in surface.bodies]
    acting = [(n, surface.apart(binding.acting)) for n, binding in snapshot.bindings]
    for (number, *bodies), name in ledger.items():
        area = surface.bodies[bodies[0]].grid.fragment_area
        reached = 0.0
        if len(bodies) == 2:
            pairs = snapshot.pairs.get((number, bodies[0], bodies[1]))
            if pairs is not None:
                reached = float(pairs.area.sum())
        else:
            masks = [by_body[bodies[0]] for n, by_body in acting if n == number]
            if masks:
                reached = _acting_area(area, reduce(np.logical_or, masks))
        fraction = reached / total_area[bodies[0]]
        acting_parts.append(
            Part(
                mechanism=name,
                bodies=tuple(bodies),
                area=reached,
                surface_share=fraction,
            )
        )
    return tuple(acting_parts)


def _acting_area(
    area: Float[np.ndarray, " s"], is_acting: Bool[np.ndarray, " s"]
) -> float:
    return found(
        (area,), ("area", digest(is_acting)), lambda: float(area[is_acting].sum())
    )


def _omissions(
    scene: Scene,
    names: tuple[str, ...],
    snapshot: Snapshot,
    unheated: list[tuple[int, Omitted]],
    moves: bool,
) -> tuple[Omission, ...]:
    """All that was left out: of surfaces, of volumes, of pairs, and of the scene."""
    several = len(scene.bodies) > 1

    def on(name: str, body: int | None) -> str:
        return f"{name} on body {body}" if several else name

    omissions = []
    for index, body in enumerate(scene.bodies):
        reasons = {
            n: omitted.reason
            for n, omitted in snapshot.omitted
            if omitted.body in (None, index)
        }
        for n in sorted(reasons):
            omissions.append(Omission(on(names[n], index), reasons[n]))
        if not isinstance(body.material, AbstractMaterials):
            name = on("per-node conductivity", index)
            omissions.append(Omission(name, "the material is uniform"))
    omissions += [Omission(on(names[n], body), why) for n, (why, body) in unheated]
    omissions += [Omission(names[n], why) for n, why in snapshot.unpaired]
    # Usual mechanisms that no term of the scene stands for.
    present = {term.name for term in scene.terms}
    omissions += [
        Omission(name, why)
        for name, (why, stand_ins) in _ABSENT.items()
        if not present & stand_ins
    ]
    if "contact" not in present:
        why = "no term joins the bodies" if several else "there is one body"
        omissions.append(Omission("contact", why))
    if not moves:
        omissions.append(Omission("motion", "nothing moves: one snapshot"))
    return tuple(omissions)


def _represented(snapshot: Snapshot, off: bool) -> tuple[str, ...]:
    """True and represented volume, area and section of the bodies that are `off`."""
    lines = []
    for surface in snapshot.surface.bodies:
        represented = surface.grid.represented
        if represented is not None and represented.is_off == off:
            advice = "; use a finer pitch" if off else ""
            lines.append(f"body {surface.body} {represented.described()}{advice}")
    return tuple(lines)


def _cavity_notes(scene: Scene, snapshot: Snapshot) -> tuple[str, ...]:
    """Closed cavities of each body, if a term does not act in them."""
    surface_terms = [t for t in scene.terms if isinstance(t, AbstractSurfaceTerm)]
    if not any(term.from_outside for term in surface_terms):
        return ()
    lines = []
    for body, surface in zip(scene.bodies, snapshot.surface.bodies, strict=True):
        grid = surface.grid
        if body.inside == "open" or not grid.cavity_area:
            continue
        fraction = 100 * grid.cavity_area / grid.fragment_area.sum()
        lines.append(
            f"{fraction:.2g} % of the surface of body {surface.body} faces closed "
            "cavities: air, sun and surroundings act there only with `inside: open`"
        )
    return tuple(lines)


def _cavity_warnings(scene: Scene, snapshot: Snapshot) -> tuple[str, ...]:
    """A line about each body whose voxels leave open what its mesh encloses."""
    surface_terms = [t for t in scene.terms if isinstance(t, AbstractSurfaceTerm)]
    exchange = any(isinstance(term, AbstractExchangeTerm) for term in surface_terms)
    if not exchange and not any(term.from_outside for term in surface_terms):
        return ()
    lines = []
    for body, surface in zip(scene.bodies, snapshot.surface.bodies, strict=True):
        opened = surface.grid.opened_area
        if body.inside == "open" or not opened:
            continue
        # Relative to the mesh: the voxels of thin walls have less area than it.
        fraction = 100 * opened / surface.grid.mesh.area
        lines.append(
            f"{fraction:.2g} % of the surface of body {surface.body} faces cavities "
            "that are closed in its mesh and open in its voxels: walls thinner than a "
            "voxel let air and radiation through; use a finer pitch"
        )
    return tuple(lines)


def _notes(snapshots: list[Snapshot], names: tuple[str, ...]) -> tuple[str, ...]:
    """Notes of all bindings, each once."""
    lines = (
        f"{names[number]} on body {body}: {note}"
        for snapshot in snapshots
        for body in range(len(snapshot.surface.bodies))
        for number, binding in snapshot.bindings
        for on, note in binding.notes
        if on == body
    )
    return tuple(dict.fromkeys(lines))


def _overlap_warnings(
    snapshots: list[Snapshot], starts: tuple[float, ...]
) -> tuple[str, ...]:
    """A line about each pair of bodies that overlap, where they do so most deeply."""
    deepest = {}
    for snapshot, start in zip(snapshots, starts, strict=True):
        for pair, overlap in snapshot.overlaps.items():
            if pair not in deepest or overlap.depth > deepest[pair][0].depth:
                deepest[pair] = overlap, start
    moves = len(starts) > 1
    return tuple(
        (f"at {start:g} s " if moves else "") + overlap.described(pair)
        for pair, (overlap, start) in sorted(deepest.items())
    )
