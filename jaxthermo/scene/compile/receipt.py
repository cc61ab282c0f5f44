"""The receipt of a compiled scene: what it contains, what was left out, and why."""

from collections.abc import Callable
from functools import reduce

import jax
import numpy as np

from ...arrays import is_traced
from ...extras import install_commands
from ...geometry.nested import filled_inner_surfaces
from ...material.material import Material
from ...memo.found import found
from ...physics.contact.seam_search import SeamPairs
from ...physics.surface import Omitted
from ...physics.term import AbstractExchangeTerm, AbstractSurfaceTerm
from ...sheets.sheet_grid import SheetGrid
from ...structures.kinds.full import FullVolume
from ...structures.kinds.sheet import Sheet
from ...structures.kinds.shell import SingleShell
from ...structures.structure import AbstractStructure
from ..air import bodies_around_air, bodies_with_surface
from ..body_mass import body_mass
from ..body_materials import AbstractMaterials
from ..motion import Motion
from ..receipt_model import Omission, Part, Receipt
from ..scene import Body, Scene, mechanism_names
from .program_builder import Ledger, Volumes
from .snapshots import Snapshot


# Number of voxels from which a receipt names the faster loops.
_LARGE = 1_000_000
# Why a mechanism of most scenes is not in this one, and the terms that stand for it.
_ABSENT = {
    "sun": ("the scene has no source", {"sun", "point_source", "area_source"}),
    "convection": (
        "the scene has no moving air or coefficient",
        {"convection", "wind", "free_convection", "interior_air"},
    ),
    "emission": ("the scene has no surroundings", {"emission"}),
}


def receipt_of(
    scene: Scene,
    snapshots: list[Snapshot],
    starts: tuple[float, ...],
    end: float,
    ledger: Ledger,
    volumes: Volumes,
    unheated: list[tuple[int, Omitted]],
    accuracy: tuple[str, ...],
) -> Receipt:
    """Write the receipt of a scene, without what depends on its numbers.

    Args:
        scene: bodies and terms.
        snapshots: the scene at the starts of its programs.
        starts: of the snapshots [s].
        end: of the run [s].
        ledger: mechanisms that act.
        volumes: nodes that terms heat inside.
        unheated: volume terms that do not act on a body, by their number.
        accuracy: notes on the exchange of radiation.
    """
    first = snapshots[0]
    moves = len(starts) > 1
    return Receipt(
        included=("conduction", *dict.fromkeys(ledger.values())),
        parts=_parts(scene, ledger=ledger, volumes=volumes, snapshot=first),
        left_out=_omissions(scene, snapshot=first, unheated=unheated, moves=moves),
        notes=(
            *_represented(first, off=False),
            *_counted(first, off=False),
            *_cavity_notes(scene, first),
            *_faster_loops(scene),
            *accuracy,
            *_shared_notes(first, len(starts)),
        ),
        warnings=(
            *_overlap_warnings(snapshots, starts),
            *_motion_warnings(scene, starts, end),
            *_cavity_warnings(scene, first),
            *_represented(first, off=True),
            *_counted(first, off=True),
            *_thin_warnings(first),
        ),
        structures=tuple(_described(structure) for structure in scene.structures),
        nodes=sum(structure.node_count for structure in scene.structures),
        links=sum(structure.link_count for structure in scene.structures),
        fragments=sum(first.surface.counts),
        snapshots=len(starts),
        capacity_ratios=tuple(
            structure.capacity_ratio for structure in scene.structures
        ),
        dtype=scene.dtype,
    )


def _described(structure: AbstractStructure) -> str:
    # Blocks have a factor, which the number of nodes or a size may have chosen.
    factor = getattr(structure, "factor", None)
    count = structure.node_count
    name = type(structure).__name__ + ("" if factor is None else f" x{factor}")
    return f"{name}, {count:,} node{'s' * (count != 1)}"


def _parts(
    scene: Scene, ledger: Ledger, volumes: Volumes, snapshot: Snapshot
) -> tuple[Part, ...]:
    """The surface and the volume that each entry of the ledger acts on."""
    acting_parts = []
    surface = snapshot.surface
    total_area = [float(body.grid.fragment_area.sum()) for body in surface.bodies]
    acting = [(n, surface.apart(binding.acting)) for n, binding in snapshot.bindings]
    for (number, *bodies), name in ledger.items():
        reached = 0.0
        volume = 0.0
        length = 0.0
        if len(bodies) == 2:
            pairs = snapshot.pairs.get((number, bodies[0], bodies[1]))
            if isinstance(pairs, SeamPairs):
                length = float(pairs.length.sum())
            elif pairs is not None:
                reached = float(pairs.area.sum())
        elif bodies[0] < len(surface.bodies):
            # Bodies of air have no surface.
            area = surface.bodies[bodies[0]].grid.fragment_area
            if (number, bodies[0]) in volumes:
                volume = float(volumes[number, bodies[0]].volume.sum())
            masks = [by_body[bodies[0]] for n, by_body in acting if n == number]
            if masks:
                is_reached = reduce(np.logical_or, masks)
                term = scene.terms[number]
                # No other term is bound to a surface.
                assert isinstance(term, AbstractSurfaceTerm)
                fraction = term.acting_fraction(surface.bodies[bodies[0]])
                reached = float((area * fraction)[is_reached].sum())
        acting_parts.append(
            Part(
                mechanism=name,
                bodies=tuple(bodies),
                area=reached,
                volume=volume,
                surface_share=reached / total_area[bodies[0]] if reached else 0.0,
                length=length,
            )
        )
    return tuple(acting_parts)


def _omissions(
    scene: Scene,
    snapshot: Snapshot,
    unheated: list[tuple[int, Omitted]],
    moves: bool,
) -> tuple[Omission, ...]:
    """All that was left out: of surfaces, of volumes, of pairs, and of the scene."""
    several = len(bodies_with_surface(scene)) > 1
    names = mechanism_names(scene)

    def on(name: str, body: int | None) -> str:
        return f"{name} on body {body}" if several else name

    omissions = []
    for index, body in enumerate(bodies_with_surface(scene)):
        reasons = {
            n: omitted.reason
            for n, omitted in snapshot.omitted
            if omitted.body in (None, index)
        }
        for n in sorted(reasons):
            omissions.append(Omission(on(names[n], index), reasons[n]))
        if isinstance(body.material, Material):
            name = on("per-node conductivity", index)
            omissions.append(Omission(name, "the material is uniform"))
    airs = bodies_around_air(scene)
    omissions += [
        Omission(on(names[n], body), why)
        for n, (why, body) in unheated
        if body not in airs
    ]
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


# Relative uncertainty of a counted area beyond which a user is warned [-].
_MAX_UNCERTAINTY = 0.01


def _counted(snapshot: Snapshot, off: bool) -> tuple[str, ...]:
    """Bodies whose area is that of their voxels, if it is uncertain by > 1 % or not."""
    lines = []
    for surface in snapshot.surface.bodies:
        uncertainty = surface.grid.area_uncertainty
        if uncertainty and (uncertainty > _MAX_UNCERTAINTY) == off:
            advice = "; use a finer pitch" if off else ""
            lines.append(
                f"body {surface.body} has the volume that its voxels count and an area "
                f"within about {100 * uncertainty:.2g} %: "
                f"{surface.grid.unscaled_because}{advice}"
            )
    return tuple(lines)


def _thin_warnings(snapshot: Snapshot) -> tuple[str, ...]:
    """A line about each body that conducts too little along its thin parts."""
    lines = []
    for surface in snapshot.surface.bodies:
        conduction = surface.grid.thin_conduction
        if conduction is not None and conduction.is_off:
            lines.append(f"body {surface.body} {conduction.described()}")
    return tuple(lines)


def _faster_loops(scene: Scene) -> tuple[str, ...]:
    """Large bodies whose explicit steps another package would take faster."""
    if jax.default_backend() != "cpu":
        return ()
    notes = []
    for number, body in enumerate(scene.bodies):
        structure = body.structure
        material = body.material
        # The loops are for one isotropic material.
        is_simple = isinstance(material, Material) and not isinstance(
            material.conductivity, tuple
        )
        if (
            is_simple
            and isinstance(structure, FullVolume)
            and structure.kernels is None
            and structure.node_count > _LARGE
        ):
            notes.append(
                f"body {number}: explicit steps of {structure.node_count:,} voxels are "
                "some three times faster on a CPU with `kernels: numba` in its "
                f"structure, of the extra native: {install_commands('native')}"
            )
    return tuple(notes)


def _cavity_notes(scene: Scene, snapshot: Snapshot) -> tuple[str, ...]:
    """Closed cavities of each body, if a term does not act in them."""
    surface_terms = [t for t in scene.terms if isinstance(t, AbstractSurfaceTerm)]
    if not any(term.from_outside for term in surface_terms):
        return ()
    lines = []
    for number, surface in enumerate(snapshot.surface.bodies):
        grid = surface.grid
        acted_on_both = grid.is_two_sided and grid.adiabatic is None
        if acted_on_both and isinstance(grid, SheetGrid):
            lines += _open_sheet(number, grid)
        if surface.enclosing is None:
            continue
        total = grid.fragment_area.sum()
        for around in np.unique(surface.enclosing[surface.enclosing >= 0]):
            area = grid.fragment_area[surface.enclosing == around].sum()
            of_body = "" if around == number else f" of body {around}"
            lines.append(
                f"{100 * area / total:.3g} % of the surface of body {number} faces "
                f"closed cavities{of_body}: air, sun and surroundings act there only "
                "with `inside: open`"
            )
    return tuple(lines)


def _open_sheet(number: int, grid: SheetGrid) -> list[str]:
    """Why pieces of a sheet have no inside; none where all are closed."""
    cells = grid.cells
    reasons = []
    if cells.border:
        reasons.append(f"a border of {cells.border:.3g} m: what has a border")
    if cells.partitions:
        reasons.append(
            f"partitions joined along {cells.partitions:.3g} m: what they are joined to"
        )
    return [
        f"body {number} is a sheet with {reason} has no inside, and all terms act on "
        "both of its faces"
        for reason in reasons
    ]


def _cavity_warnings(scene: Scene, snapshot: Snapshot) -> tuple[str, ...]:
    """A line about each body whose voxels leave open what its mesh encloses."""
    surface_terms = [t for t in scene.terms if isinstance(t, AbstractSurfaceTerm)]
    exchange = any(isinstance(term, AbstractExchangeTerm) for term in surface_terms)
    if not exchange and not any(term.from_outside for term in surface_terms):
        return ()
    lines = []
    bodies = bodies_with_surface(scene)
    for body, surface in zip(bodies, snapshot.surface.bodies, strict=True):
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


def sheet_lines(
    scene: Scene, describe: Callable[[Sheet], list[str]]
) -> tuple[str, ...]:
    """Lines about each body that is a sheet."""
    return tuple(
        f"body {number}: {line}"
        for number, structure in enumerate(scene.structures)
        if isinstance(structure, Sheet)
        for line in describe(structure)
    )


def filled_warnings(scene: Scene) -> tuple[str, ...]:
    """A line about each body that is solid where its mesh leaves that open."""
    lines = []
    for number, structure in enumerate(scene.structures):
        # A shell with a volume of its own is hollow.
        is_hollow = isinstance(structure, SingleShell) and structure.capacity == "own"
        if is_hollow or not structure.grid.unscaled_because:
            continue
        body = scene.bodies[number]
        reason = _filled_because(body)
        if not reason:
            continue
        solid = f"a solid of {structure.volume:.4g} m^3"
        # Within a transformation the density has no value yet.
        if not is_traced(body.material):
            solid += f" and {body_mass(body):.4g} kg"
        lines.append(f"body {number} {reason}; it is filled: {solid}")
    return tuple(lines)


def _filled_because(body: Body) -> str:
    """Why the inside of a mesh may not be what its voxels fill; empty if it is."""
    mesh = body.structure.grid.mesh
    edges = found((mesh,), "open_edges", lambda: mesh.open_edges)
    if edges:
        return (
            f"has an open mesh ({edges:,} open edges), whose walls have no thickness: "
            "close it, or draw both sides of its walls"
        )
    # Parts of several materials lie in each other on purpose.
    if isinstance(body.material, AbstractMaterials):
        return ""
    inner = found((mesh,), "filled_inner_surfaces", lambda: filled_inner_surfaces(mesh))
    if not inner:
        return ""
    surfaces = "a closed surface" if inner == 1 else f"{inner} closed surfaces"
    return (
        f"has {surfaces} inside another, facing outward like it: turn the faces of a "
        "cavity inward"
    )


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


def _shared_notes(first: Snapshot, count: int) -> tuple[str, ...]:
    """A line about the snapshots of a motion, and what they share."""
    if count == 1:
        return ()
    sizes = [len(group.shapes) for group in first.surface.bodies[0].occluders]
    if len(sizes) == 1:
        shared = "all bodies keep their places, and only sources are searched for again"
    else:
        shared = (
            f"{sum(sizes)} bodies move as {len(sizes)}, of "
            f"{', '.join(map(str, sizes))}; within each of these, contacts are "
            "searched for once, and shadows and views of the sky unless it turns"
        )
    return (f"{count} snapshots of the geometry: {shared}",)


def _motion_warnings(
    scene: Scene, starts: tuple[float, ...], end: float
) -> tuple[str, ...]:
    """A line about each body whose way between poses or snapshots is open."""
    return tuple(
        f"body {number}: {warning}"
        for number, body in enumerate(scene.bodies)
        if isinstance(body.pose, Motion)
        for warning in body.pose.warnings(starts, end)
    )
