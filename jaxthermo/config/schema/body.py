"""Bodies: geometry, its voxels, structure, material, temperature and pose."""

import json
import re
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, Discriminator, Field, Tag
from typing_extensions import override

import jaxthermo

from ...archive import file_hash, text_hash
from ...errors import InputError, located
from ..types import quantities as si
from ..types.files import FoundPath, read_solid
from ..types.model import Data, Mistake, Model, Short, build, require_nothing
from ..types.varying import AnyFraction, not_increasing, unequal
from .geometry import MeshConfig, PartsShape, PoseConfig, ShapeConfig
from .interior import AirConfig, InteriorConfig
from .material import (
    BodyMaterial,
    FinishName,
    LabelledConfig,
    Material,
    PartsConfig,
    finish_names,
)
from .selection import WhereConfig, empty_box
from .sheet import GroundShape, SheetConfig
from .structure import (
    FluxCorrectedMap,
    FullVolume,
    SkinConfig,
    StructureConfig,
    SurfaceMapConfig,
)


_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_NOT_IN_FILE_NAMES = re.compile(r"[^\w.-]+")

# Temperature at which the search of a steady state begins [K].
_ROOM = 293.15
_STRUCTURE_FIELDS = {
    "mesh",
    "shape",
    "solid",
    "pitch",
    "voxels_high",
    "surface_cells",
    "sheet",
    "structure",
    "skin",
}
"""Fields from which the structure of a body follows."""


class _PaintConfig(Model):
    """A box of the body [m] that is made of another material."""

    lower: si.Position
    upper: si.Position
    material: Material

    def build(self, *args: Any) -> Any:
        box = jaxthermo.Region(lower=self.lower, upper=self.upper)
        return box, self.material.build()

    def mistakes(self) -> list[Mistake]:
        return empty_box(self.lower, self.upper)


class _CoatingConfig(Model, builds="Coating"):
    """Radiative properties of a part of the surface: of a finish, by numbers, or both.

    One word stands for a finish on all of the surface.
    """

    finish: FinishName | None = None
    """Name of a finish; `jaxthermo materials --emissivity` lists them."""
    emissivity: AnyFraction | None = None
    absorptivity: AnyFraction | None = None
    on: WhereConfig | None = None

    @override
    def arguments(self) -> dict[str, Any]:
        arguments = super().arguments()
        finish = arguments.pop("finish", None)
        if finish is None:
            return arguments
        coating = jaxthermo.Coating.of_finish(finish)
        table = {"emissivity": coating.emissivity}
        # An absorptivity that the table leaves open follows a changed emissivity.
        if coating.given_absorptivity is not None:
            table["absorptivity"] = coating.given_absorptivity
        return table | arguments

    def mistakes(self) -> list[Mistake]:
        values = (self.finish, self.emissivity, self.absorptivity)
        if any(value is not None for value in values):
            return []
        message = "missing `finish`, `emissivity` or `absorptivity`: give one of them"
        return [((), message)]


_AnyCoating = Annotated[_CoatingConfig, Short("finish", words=finish_names())]


class _MotionConfig(Model, builds="Motion"):
    """Poses at several times; the body moves between them."""

    times: Annotated[tuple[si.Time, ...], si.NotEmpty]
    poses: tuple[PoseConfig, ...]
    every: si.PositiveTime | None = None
    """Interval after which shadows, views and contacts are recomputed."""

    def build(self, *args: Any) -> Any:
        poses = tuple(pose.build() for pose in self.poses)
        return self.target()(jaxthermo.PoseTable(self.times, poses), every=self.every)

    def mistakes(self) -> list[Mistake]:
        return [
            *not_increasing(self.times, key="times", unit="s"),
            *unequal(
                self.poses, key="poses", arguments=self.times, argument_key="times"
            ),
        ]


def _rests_or_moves(value: Any) -> str:
    if isinstance(value, dict):
        # One key is enough: the error for a motion then names the missing ones.
        moves = not value.keys().isdisjoint(("times", "poses", "every"))
    else:
        moves = isinstance(value, _MotionConfig)
    return "<moves>" if moves else "<rests>"


_AnyPose = Annotated[
    Annotated[PoseConfig, Tag("<rests>")] | Annotated[_MotionConfig, Tag("<moves>")],
    Discriminator(_rests_or_moves),
]


class _GeometryConfig(Model):
    """Name of a body, and the source of its surface."""

    name: Annotated[str, Field(min_length=1)] | None = None
    """Name of the body in selections, receipts, results and frames."""
    mesh: MeshConfig | None = None
    """Mesh file of the body: a closed surface, or any surface for a sheet."""
    shape: ShapeConfig | None = None
    """Shape that needs no file, instead of a mesh."""
    solid: FoundPath | None = None
    """File of a boolean array [x, y, z], the voxels of the body, instead of a mesh;
    its lowest corner is the body's origin."""


class BodyOptions(Model):
    """All that a body is besides its surface: a solid or a sheet, its materials."""

    pitch: si.PositiveLength | None = None
    """Edge of a voxel [m]."""
    voxels_high: Annotated[si.Whole, Field(ge=1, le=4096)] | None = None
    """Number of voxels along z, instead of the pitch."""
    surface_cells: Literal["crossings", "dominant_axis"] | None = None
    """Surface of a mesh by all crossings with true volumes of the voxels that it cuts,
    of second order in the pitch (as without this), or by fragments along the dominant
    axis of its normal, of first order."""
    sheet: SheetConfig | None = None
    """A thin wall on the surface, with a `pitch` and materials of its own, instead of
    a solid body."""
    structure: StructureConfig = FullVolume()
    """Nodes and links that represent the body's heat."""
    skin: SkinConfig | None = None
    """Cells that divide the structure's nodes at the surface by depth, for loads that
    have gone less than a voxel deep."""
    surface_map: SurfaceMapConfig = FluxCorrectedMap()
    material: BodyMaterial | None = None
    """Material of a solid: by name or properties, or several by labels or parts of the
    mesh."""
    regions: tuple[_PaintConfig, ...] = ()
    """Boxes of other materials, later ones on top."""
    coatings: tuple[_AnyCoating, ...] = ()
    """Emissivity and absorptivity of parts of the surface, later ones on top."""
    pose: _AnyPose = PoseConfig()
    """Position in the scene, or a table of positions by time."""
    inside: Literal["closed", "open"] = "closed"
    """If open, air, sun and surroundings act in its closed cavities as well."""
    interior: InteriorConfig | None = None
    """Air in its closed cavities: inside a closed sheet, or a hollow solid."""

    @classmethod
    @override
    def completed(cls, data: Data, context: Any) -> Data:
        """The data with a mapping for the number of cells of a skin."""
        is_number = isinstance(data.get("skin"), int)
        return {**data, "skin": {"cells": data["skin"]}} if is_number else data


class BodyConfig(BodyOptions, _GeometryConfig, builds="Body"):
    """One body of the scene."""

    temperature: si.StartTemperature
    """Temperature at the start [K]; `steady` for that of the steady state of the whole
    scene with the values of its start. That of the scene if not given."""

    # The scene gives bodies its temperature before they are checked.
    model_config = ConfigDict(json_schema_extra=require_nothing)

    exactly_one: ClassVar = (
        ("mesh", "shape", "solid"),
        ("pitch", "voxels_high", "sheet", "shape.layers"),
    )

    def build(self, *args: Any) -> Any:
        """The body on its voxel grid; without a grid it is voxelized first.

        Raises:
            InputError: for a mesh, labels or a fit card that cannot be used.
        """
        return self._with_structure(self._build_structure(*args))

    def build_sharing(self, structures: dict[str, object], number: int) -> Any:
        """The body, with a structure of the same geometry and options if there is one.

        Args:
            structures: structures by all that they follow from; a new one is added.
            number: of the body, for messages.

        Raises:
            InputError: as `build`.
        """
        name = f" ({self.name})" if self.name else ""
        with located(f"bodies.{number}{name}"):
            key = self._structure_key()
            if key not in structures:
                structures[key] = self._build_structure()
            return self._with_structure(structures[key])

    def _build_structure(self, *args: Any) -> Any:
        if self.wall is not None:
            return self._build_sheet(self.wall)
        (grid,) = args or (self.build_grid(),)
        structure = self.structure.build(grid)
        if self.skin is None:
            return structure
        material = self.build_materials(grid)
        diffusivity = _lowest_diffusivity(material, self.start)
        return self.skin.build(structure, diffusivity)

    def _structure_key(self) -> str:
        """Text that is equal for bodies with equal structures."""
        plain = self.model_dump(include=_STRUCTURE_FIELDS, exclude_none=True)
        placed = self._placed_part()
        if placed is not None:
            plain["mesh"]["part"] = placed.mesh.name
        # The material and temperature say how deep the skin is.
        if self.skin is not None:
            plain |= self.model_dump(include={"material", "regions", "temperature"})
        return json.dumps(plain, sort_keys=True, default=_file_stamp)

    def _with_structure(self, structure: Any) -> Any:
        material = None if self.wall else self.build_materials(structure.grid)
        return self.target()(
            structure,
            material,
            temperature=self.start,
            pose=self.build_pose(),
            surface_map=self.surface_map.build(),
            coatings=build(self.coatings),
            inside=self.inside,
            name=self.name or "",
        )

    @property
    def starts_steady(self) -> bool:
        """True if the body starts at the steady state of the scene."""
        return self.temperature == "steady"

    @property
    def start(self) -> float:
        """Temperature at the start [K]; where it is to be found, one to begin with."""
        return self.temperature if isinstance(self.temperature, float) else _ROOM

    def build_pose(self) -> Any:
        """The pose, or the motion; after that of a part of a file in its own frame."""
        pose = self.pose.build()
        placed = self._placed_part()
        return pose if placed is None else pose.after(placed.pose)

    def _placed_part(self) -> "jaxthermo.PlacedPart | None":
        """The part of a file that the body is; None for any other, or one that moves.

        Between the poses of a motion a body turns about the origin of its own frame,
        which then is that of the file.
        """
        if self.mesh is None or self.mesh.part is None:
            return None
        moves = isinstance(self.pose, _MotionConfig)
        return None if moves else self.mesh.build_placed_part()

    @property
    def wall(self) -> SheetConfig | None:
        """The sheet that the body is; None for a solid."""
        sheet = self.sheet
        if not isinstance(self.shape, GroundShape):
            return sheet
        if sheet is None and self.shape.layers is not None:
            sheet = SheetConfig(layers=self.shape.layers)
        if sheet is None or not self._is_held_at_start:
            return sheet
        return sheet.model_copy(update={"back": self.start})

    @property
    def _is_held_at_start(self) -> bool:
        """True for ground whose back is held at the temperature of its start."""
        is_ground = isinstance(self.shape, GroundShape)
        return is_ground and (self.sheet is None or self.sheet.back is None)

    @property
    def air(self) -> AirConfig | None:
        """The volume of air in the body whose temperature is computed; None if none."""
        return None if self.interior is None else self.interior.air

    def build_terms(
        self, number: int, air: int | None = None, outdoors: Any = None
    ) -> tuple[Any, ...]:
        """Terms of the body with this number: its air, and a back that is held.

        The air has a number, too, and exchanges with air outdoors of a temperature.
        """
        terms = []
        if self.interior is not None:
            terms.append(self.interior.build(number, air, outdoors))
        if self.wall is not None and self.wall.held is not None:
            back = jaxthermo.Face("back", body=number)
            terms.append(jaxthermo.FixedTemperature(self.wall.held, on=back))
        return tuple(terms)

    def _build_sheet(self, wall: SheetConfig) -> Any:
        return wall.build(self._build_parts())

    def _build_parts(self) -> "dict[str, jaxthermo.Mesh]":
        """The named parts of the geometry; a single one without a name."""
        with_parts = self._with_parts()
        if with_parts is None or self._placed_part() is not None:
            return {"": self.build_mesh()}
        return with_parts.build_parts()

    @property
    def label(self) -> str:
        """The name, or that of the file or shape, as a part of the name of a file."""
        if self.name is not None:
            return _NOT_IN_FILE_NAMES.sub("_", self.name)
        path = self.mesh.path if self.mesh is not None else self.solid
        if path is not None:
            return path.stem
        return self.shape.kind if self.shape is not None else "body"

    @property
    def geometry(self) -> tuple[str, str]:
        """Name of the file or shape, and a hash of its content [16 hex digits].

        The hash of a shape does not depend on its scale.
        """
        path = self.mesh.path if self.mesh is not None else self.solid
        if path is not None and self.mesh is not None and self.mesh.part is not None:
            content = text_hash(f"{file_hash(path)} {self.mesh.part}")
            return f"{path.name}/{self.mesh.part}", content
        if path is not None:
            return path.name, file_hash(path)[:16]
        assert self.shape is not None
        plain = self.shape.model_dump(mode="json", exclude_none=True)
        text = _without_scale(json.dumps(plain, sort_keys=True))
        return self.shape.kind, text_hash(text)

    def build_grid(self) -> Any:
        """The voxels of the body, or the cells of its surface, by the config."""
        if self.wall is not None:
            return self._build_sheet(self.wall).grid
        pitch = self.pitch
        if self.solid is not None:
            assert pitch is not None
            return jaxthermo.grid_from_voxels(read_solid(self.solid), pitch)
        mesh = self.build_mesh()
        if pitch is None:
            height = float(np.ptp(mesh.bounds[:, 2]))
            pitch = height / float(self.voxels_high or 1)
        surface_cells = self.surface_cells or "crossings"
        return jaxthermo.voxelize(mesh, pitch, surface_cells=surface_cells)

    def build_mesh(self) -> Any:
        """The mesh, from its file or as a shape, in metres and z up."""
        mesh_or_shape = self.mesh or self.shape
        if mesh_or_shape is None:
            raise InputError("bodies: a body needs a `mesh` or a `shape`")
        placed = self._placed_part()
        return mesh_or_shape.build() if placed is None else placed.mesh

    def build_materials(self, grid: Any = None) -> Any:
        """A material, one with others painted over it, or one for each label or part.

        Materials by parts of the mesh need the voxel grid of the body.
        """
        if isinstance(self.material, PartsConfig):
            return self.material.build(grid, self._build_parts())
        assert self.material is not None
        base = self.material.build()
        painted = tuple(region.build() for region in self.regions)
        return jaxthermo.MaterialMap(base, painted) if painted else base

    def _with_parts(self) -> MeshConfig | PartsShape | None:
        """The geometry of the body if it may have named parts."""
        shape = self.shape if isinstance(self.shape, PartsShape) else None
        return self.mesh or shape

    @override
    def mistakes(self) -> list[Mistake]:
        mistakes: list[Mistake] = []
        if self.solid is not None and self.voxels_high is not None:
            message = "the array has them: give the `pitch`"
            mistakes.append((("voxels_high",), message))
        if self.interior is not None and self.inside == "open":
            message = (
                "outer air is in the cavities with `inside: open`: give one of both"
            )
            mistakes.append((("interior",), message))
        if self.solid is not None and self.surface_cells is not None:
            message = "an array of voxels has no surface but theirs: leave it out"
            mistakes.append((("surface_cells",), message))
        if isinstance(self.material, PartsConfig) and self._with_parts() is None:
            message = "only a `mesh` file or a `shape` of kind `parts` has parts"
            mistakes.append((("material",), message))
        if self.wall is not None:
            if self.starts_steady and self._is_held_at_start:
                message = (
                    "the back of ground is held at its temperature at the start: give "
                    "a number, or a `sheet` with a `back`"
                )
                mistakes.append((("temperature",), message))
            return [*mistakes, *self._sheet_mistakes()]
        if isinstance(self.shape, GroundShape):
            message = "has no inside: give its `layers`, or a `sheet`"
            return [(("shape",), message)] if self.material is not None else []
        if self.material is None:
            mistakes.append((("material",), "missing, and it has no default"))
        return [*mistakes, *self._regions_mistakes()]

    def _sheet_mistakes(self) -> list[Mistake]:
        reasons = {
            "solid": "an array of voxels has no sheet: give a `mesh` or a `shape`",
            "material": "the layers of the `sheet` have their materials: leave it out",
            "regions": "the layers of the `sheet` by part say what is where",
            "structure": "a `sheet` has its own structure: leave it out",
            "skin": "a `sheet` has `cells` through its thickness: leave it out",
            "surface_map": "a `sheet` has its own surface: leave it out",
            "surface_cells": "a `sheet` has its own surface: leave it out",
        }
        return [
            ((key,), reason)
            for key, reason in reasons.items()
            if getattr(self, key) != type(self).model_fields[key].default
        ]

    def _regions_mistakes(self) -> list[Mistake]:
        if not self.regions:
            return []
        if isinstance(self.material, PartsConfig):
            return [(("regions",), "the parts of `material` say what is where")]
        if isinstance(self.material, LabelledConfig):
            return [(("regions",), "the labels of `material` say what is where")]
        return []


def _file_stamp(path: Path) -> list[object]:
    """Name and state of a file; another content has another state."""
    status = path.stat() if path.exists() else None
    return [str(path), status and status.st_mtime_ns, status and status.st_size]


def _lowest_diffusivity(material: Any, temperature: float) -> float:
    """Lowest diffusivity of all materials and axes at a temperature [m^2/s]."""
    diffusivities = []
    for body_material in getattr(material, "materials", (material,)):
        constant = body_material.at(temperature)
        lowest = float(np.min(constant.conductivity))
        diffusivities.append(lowest / float(constant.volumetric_heat_capacity))
    return min(diffusivities)


def _without_scale(text: str) -> str:
    # Six digits: the same shape in another unit differs by rounding.
    sizes = [abs(float(number)) for number in _NUMBER.findall(text)]
    scale = max(sizes, default=0.0) or 1.0
    return _NUMBER.sub(lambda number: f"{float(number[0]) / scale:.6g}", text)
