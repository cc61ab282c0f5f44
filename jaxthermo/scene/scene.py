"""A scene: bodies in space, the terms that act on them, and surfaces for a camera."""

from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Bool, Float, Int

from ..arrays import PositionVarying, is_compiling, is_traced, precision
from ..choices import Dtype, Inside, SurfaceOutput
from ..errors import InputError, require
from ..geometry.mesh import Pose
from ..material.material import Material, Property
from ..memo.found import found
from ..physics.term import AbstractExchangeTerm, AbstractTerm
from ..physics.time_varying import check_temperature
from ..sheets.sheet_grid import SheetGrid
from ..shown import html_of
from ..structures.kinds.air import AirVolume
from ..structures.kinds.sheet import Sheet
from ..structures.structure import AbstractStructure
from ..structures.surface_map import AbstractSurfaceMap, FluxCorrectedMap
from ..voxels.abstract_grid import AbstractGrid
from ..voxels.grid import VoxelGrid
from ..voxels.selection import AbstractSelection
from .body_materials import AbstractMaterials, MaterialLabels
from .body_numbers import check_numbers, with_numbers
from .coating import Coating
from .motion import Motion
from .named import Probe, as_probes, check_names
from .surface_outputs import as_surface_outputs


class Body(Module):
    """A body: its structure, material, initial temperature and pose.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> steel = jt.materials["stainless_steel"]
        >>> body = jt.Body(jt.FullVolume(grid), steel, temperature=350.0)
    """

    structure: AbstractStructure
    material: Material | AbstractMaterials | None = None
    """Material of a solid; None for a sheet, whose layers have theirs."""
    temperature: PositionVarying = eqx.field(kw_only=True)
    """Initial T [K], a number or a function of positions [n 3] (own frame, m)."""
    pose: Pose | Motion = eqx.field(kw_only=True, default=Pose())
    surface_map: AbstractSurfaceMap = eqx.field(
        kw_only=True, default=FluxCorrectedMap()
    )
    """Rule by which surface temperatures follow from the nodes."""
    coatings: tuple[Coating, ...] = eqx.field(kw_only=True, default=())
    """Radiative properties of parts of the surface, later ones on top."""
    inside: Inside = eqx.field(static=True, kw_only=True, default="closed")
    """With "open", air, sun and surroundings act in its closed cavities as well."""
    name: str = eqx.field(static=True, kw_only=True, default="")
    """Name in receipts, summaries, frames and messages, besides its number."""

    def __check_init__(self):
        require(
            self.structure,
            classes=AbstractStructure,
            argument="Body(structure=)",
            give="a structure, such as FullVolume(grid)",
        )
        self._check_material()
        require(
            self.pose,
            classes=(Pose, Motion),
            argument="Body(pose=)",
            give="a Pose or a Motion",
        )
        require(
            self.surface_map,
            classes=AbstractSurfaceMap,
            argument="Body(surface_map=)",
            give="a surface map, such as FluxCorrectedMap()",
        )
        if self.inside not in ("closed", "open"):
            raise InputError(f"Body(inside={self.inside!r}): give 'closed' or 'open'")
        if callable(self.temperature) or is_traced(self.temperature):
            return
        is_text = isinstance(self.temperature, str)
        try:
            kelvin = np.nan if is_text else float(self.temperature)
        except (TypeError, ValueError):
            kelvin = np.nan
        if not np.isfinite(kelvin) or kelvin < 0:
            raise InputError(
                f"Body(temperature={self.temperature!r}): give kelvin, as a "
                "number or a function of positions"
            )

    def _check_material(self) -> None:
        if isinstance(self.structure, Sheet):
            if self.material is not None:
                raise InputError(
                    "Body(material=): the layers of a sheet have their materials: "
                    "leave it out"
                )
            if self.inside != "closed" and self.structure.grid.cavities is None:
                raise InputError(
                    "Body(inside=): this sheet is open and has no inside: terms reach "
                    'its back unless it is Sheet(back="adiabatic")'
                )
            return
        if isinstance(self.structure, AirVolume):
            if self.material is not None or callable(self.temperature):
                raise InputError(
                    "Body(AirVolume(..)): give a number as its temperature, and no "
                    "material"
                )
            return
        require(
            self.material,
            classes=(Material, AbstractMaterials),
            argument="Body(material=)",
            give='a material: Material(...), or materials["copper"]',
        )
        solid = self.structure.voxels.solid
        if not solid.any():
            raise InputError(
                f"Body({type(self.structure).__name__}): its grid of "
                f"{' x '.join(map(str, solid.shape))} voxels has no solid voxel; "
                "voxelize a closed mesh at a finer pitch"
            )


class Scene(Module):
    """Bodies and the mechanisms that act on them.

    A mechanism that is not in `terms` is not computed.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> copper = jt.materials["copper"]
        >>> body = jt.Body(jt.FullVolume(grid), copper, temperature=350.0)
        >>> terms = (jt.Convection(10.0, 290.0), jt.Surroundings(280.0))
        >>> scene = jt.Scene((body,), terms)
        >>> [term.name for term in scene.terms]
        ['convection', 'emission']
    """

    bodies: tuple[Body, ...]
    terms: tuple[AbstractTerm, ...] = ()
    dtype: Dtype = eqx.field(static=True, default="float32")
    """Type of the state: "float32", or "float64" for twice the memory and digits."""
    allow_extreme_temperatures: bool = eqx.field(static=True, default=False)
    """Accept temperatures below 150 K, mostly mistaken Celsius, and above 6000 K."""
    probes: tuple[Probe, ...] = eqx.field(
        static=True, default=(), converter=as_probes, kw_only=True
    )
    """Thermocouples on or in the bodies, which move with them: points in the world at
    the start [m], as a list or by name; `probe` reads them."""
    surface_outputs: tuple[SurfaceOutput, ...] = eqx.field(
        static=True, default=(), converter=as_surface_outputs, kw_only=True
    )
    """Outputs to save for every fragment besides its temperature: `SURFACE_OUTPUTS`."""

    def __post_init__(self):
        self.terms = with_numbers(self.terms, self.bodies)

    def __check_init__(self):
        _require_all(
            self.bodies, cls=Body, field="bodies", give="a Body, as in (body,)"
        )
        terms = "a term, as in (Convection(10.0, 290.0),)"
        _require_all(self.terms, cls=AbstractTerm, field="terms", give=terms)
        for i, term in enumerate(self.terms):
            for name in ("on", "within"):
                require(
                    getattr(term, name, None),
                    classes=(AbstractSelection, type(None)),
                    argument=f"terms[{i}]({name}=)",
                    give="a selection, such as Side((0.0, 0.0, 1.0)) or Everything()",
                )
        if not self.bodies:
            raise InputError("Scene(bodies=()): give at least one body")
        check_names([body.name for body in self.bodies])
        if self.dtype not in ("float32", "float64"):
            raise InputError(
                f"Scene(dtype={self.dtype!r}): choose 'float32' or 'float64'"
            )
        # Both kinds of surroundings share this name: they emit the same heat. Where
        # they are on parts of the surface, binding checks that these do not overlap.
        emits = [term for term in self.terms if term.name == "emission"]
        if len(emits) > 1 and any(getattr(t, "on", None) is None for t in emits):
            raise InputError(
                "Scene: two Surroundings would count the emission twice; give one, "
                "whose temperature may be a function of time, or each its own `on`"
            )
        if sum(isinstance(t, AbstractExchangeTerm) for t in self.terms) > 1:
            raise InputError(
                "Scene: two RadiativeExchange would not see each other's surfaces; "
                "give one, on both parts: on=a | b"
            )
        if not self.allow_extreme_temperatures:
            self._check_temperatures()
        check_numbers(self.terms, len(self.bodies))

    def _repr_html_(self) -> str:
        return html_of(self)

    @cached_property
    def structures(self) -> tuple[AbstractStructure, ...]:
        """Structure of each body, which scenes of other numbers share."""
        return tuple(body.structure for body in self.bodies)

    @cached_property
    def device_count(self) -> int:
        """Number of devices that its bodies are spread over."""
        return max(structure.device_count for structure in self.structures)

    @cached_property
    def flattened(self) -> tuple[list[Any], Any]:
        """Its leaves, each structure as one of them, and its outline without these."""
        ids = set(map(id, self.structures))
        return jax.tree.flatten(self, is_leaf=lambda node: id(node) in ids)

    @cached_property
    def is_traced(self) -> bool:
        """True if any of its values is being differentiated, mapped or compiled."""
        return is_traced(self.flattened[0])

    @property
    def precision(self) -> AbstractContextManager:
        """Context in which arrays of the scene's type can be created.

        Raises:
            InputError: for float64 while JAX traces other code in float32.
        """
        settings: Any = jax.config
        is_wider = self.dtype == "float64" and not settings.jax_enable_x64
        if is_wider and (is_compiling() or self.is_traced):
            raise InputError(
                "Scene(dtype='float64') under jax.jit, grad or vmap: call "
                "jax.config.update('jax_enable_x64', True) at the start of the program"
            )
        return precision(self.dtype)

    def _check_temperatures(self) -> None:
        for i, body in enumerate(self.bodies):
            check_temperature(body.temperature, f"bodies[{i}]: Body(temperature=)")
            for leaf in jax.tree.leaves(
                body.material, is_leaf=lambda node: isinstance(node, Property)
            ):
                if isinstance(leaf, Property):
                    argument = f"bodies[{i}]: Property(temperatures=)"
                    check_temperature(leaf.temperatures, argument)
        for i, term in enumerate(self.terms):
            for name, value in term.temperatures.items():
                argument = f"terms[{i}]: {type(term).__name__}({name}=)"
                check_temperature(value, argument)


def _require_all(values: Any, cls: type, field: str, give: str) -> None:
    require(
        values,
        classes=(tuple, list),
        argument=f"Scene({field}=)",
        give=f"a tuple, each {give}",
    )
    for i, value in enumerate(values):
        require(value, classes=cls, argument=f"Scene({field}[{i}]=)", give=give)


def mechanism_names(scene: Scene) -> tuple[str, ...]:
    """One name per term: its kind, numbered from the second of a kind on."""
    names = [term.name for term in scene.terms]
    counts = [names[: n + 1].count(name) for n, name in enumerate(names)]
    counted = zip(names, counts, strict=True)
    names = [name if count == 1 else f"{name}#{count}" for name, count in counted]
    return tuple(names)


@jax.tree_util.register_static
@dataclass(frozen=True, eq=False)
class BodyGeometry:
    """Shape and fragments in the body's own frame [m], and its pose."""

    # Not the grid: its voxels need far more memory than its surface.
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    fragment_position: Float[np.ndarray, "s 3"]
    fragment_normal: Float[np.ndarray, "s 3"]
    fragment_area: Float[np.ndarray, " s"]
    pitch: float
    pose: Pose | Motion
    fragment_part: Int[np.ndarray, " s"] | None = None
    """Number of the named part of each fragment; None for a body without parts."""
    part_names: tuple[str, ...] = ()
    is_two_sided: bool = False
    """True if both sides of every triangle are surfaces: those of a thin wall.

    The fragments of its back follow those of its front, with opposite normals.
    """
    is_enclosed: Bool[np.ndarray, " s"] | None = None
    """Fragments that nothing from outside reaches at the start; None for none."""
    name: str = ""
    """Name of the body; empty for none."""

    @property
    def placed(self) -> Pose:
        """The pose; of a body that moves, at the start."""
        pose = self.pose
        # A method of a module takes a pass over its leaves, for each of many bodies.
        return pose if isinstance(pose, Pose) else pose.at(0.0)

    @property
    def triangles(self) -> Float[np.ndarray, "f 3 3"]:
        """Triangles in the world [m]."""
        return self.placed.to_world(self.vertices)[self.faces]

    @property
    def surface_faces(self) -> Int[np.ndarray, "g 3"]:
        """Triangles of all surfaces, wound counter-clockwise seen from outside.

        Those of the back of a thin wall follow those of its front in the same order.
        """
        if not self.is_two_sided:
            return self.faces
        # The same triangles wound the other way round.
        sides = [self.faces, self.faces[:, ::-1]]
        return found((self.faces,), "both sides", lambda: np.concatenate(sides))


def body_geometry(
    grid: AbstractGrid,
    pose: Pose | Motion,
    material: Material | AbstractMaterials | None = None,
    is_enclosed: Bool[np.ndarray, " s"] | None = None,
    name: str = "",
) -> BodyGeometry:
    """The part of a body's surface that a camera needs after the run."""
    fragment_part = None
    names = ()
    if isinstance(material, MaterialLabels):
        assert isinstance(grid, VoxelGrid)
        fragment_part = np.asarray(material.of_fragments(grid), np.int32)
        names = material.names or tuple(map(str, range(len(material.given))))
    if isinstance(grid, SheetGrid) and grid.part_names:
        fragment_part = grid.fragment_part.astype(np.int32)
        names = grid.part_names
    return BodyGeometry(
        vertices=grid.mesh.vertices,
        faces=grid.mesh.faces,
        fragment_position=grid.fragment_foot,
        fragment_normal=grid.fragment_normal,
        fragment_area=grid.fragment_area,
        pitch=grid.pitch,
        pose=pose,
        fragment_part=fragment_part,
        part_names=names,
        is_two_sided=grid.is_two_sided,
        is_enclosed=is_enclosed,
        name=name,
    )


class SolvedSurface(NamedTuple):
    """A body's geometry with the radiative properties of its surface."""

    geometry: BodyGeometry
    emissivity: Float[Any, "*#s"]
    """One number for one material [-]."""
    absorptivity: Float[Any, "*#s"]
    """One number for one material [-]."""

    def __repr__(self) -> str:
        # Arrays by their shapes, as within a solution.
        return eqx.tree_pformat(self)

    @property
    def moves(self) -> bool:
        """True if the pose changes with time."""
        pose = self.geometry.pose
        return isinstance(pose, Motion) and not pose.is_still

    def at(self, time: float) -> "SolvedSurface":
        """The surface at the pose of a moment [s]; itself if it does not move."""
        if not self.moves:
            return self
        pose = self.geometry.pose.at(time)
        return self._replace(geometry=replace(self.geometry, pose=pose))


def per_fragment(
    surfaces: tuple[SolvedSurface, ...], field: str, xp: Any = jnp
) -> Float[Any, " s"]:
    """A property of surfaces, "emissivity" or "absorptivity", at each fragment.

    An array of JAX, or of numpy with `xp` numpy.
    """
    values = []
    for surface in surfaces:
        # A body of one material has one number for all fragments.
        value = xp.asarray(getattr(surface, field))
        values.append(xp.broadcast_to(value, surface.geometry.fragment_area.shape))
    return xp.concatenate(values)
