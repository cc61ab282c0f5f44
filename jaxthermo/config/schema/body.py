"""Bodies: a mesh or a shape, its voxels, structure, material, temperature and pose."""

import math
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag
from typing_extensions import override

import jaxthermo

from ...errors import InputError
from ..messages import quoted
from ..types import quantities as si
from ..types.files import FoundPath
from ..types.model import ByKind, Mistake, Model
from ..types.varying import not_increasing, unequal
from .material import BodyMaterial, LabelledConfig, Material
from .selection import empty_box
from .structure import FluxCorrectedMap, FullVolume, StructureConfig, SurfaceMapConfig


def _metres_per_unit(value: Any) -> float:
    """Metres, from a unit's name, a length such as "25.4 mm", or a number."""
    is_name = isinstance(value, str) and value[:1].isalpha()
    try:
        return si.to_si(f"1 {value}" if is_name else value, si.LENGTH)
    except InputError:
        raise si.refuse(
            f"expected a length unit such as 'mm', got {quoted(value)}"
        ) from None


MetresPerUnit = Annotated[
    float,
    BeforeValidator(_metres_per_unit, json_schema_input_type=float | str),
    Field(gt=0),
]


class MeshConfig(Model, builds="load_mesh"):
    """A mesh file and its scale: metres per file unit, or the height of the body."""

    path: FoundPath
    """OBJ, PLY, STL, GLB or OFF file, beside the config or in JAXTHERMO_MESHES."""
    unit: MetresPerUnit | None = None
    """Length of one file unit, such as mm."""
    height: si.PositiveLength | None = None
    """Extent along `up` instead of the unit [m]."""
    up: Literal["x", "y", "z", "-x", "-y", "-z"] = "z"

    exactly_one: ClassVar = (("unit", "height"),)


class _Box(Model, builds="shapes.box", kind="box"):
    """A block with edges along the axes."""

    size: si.Size


class _Sphere(Model, builds="shapes.sphere", kind="sphere"):
    """A ball."""

    radius: si.PositiveLength


class _Cylinder(Model, builds="shapes.cylinder", kind="cylinder"):
    """An upright cylinder."""

    radius: si.PositiveLength
    height: si.PositiveLength


class _Slab(Model, builds="shapes.slab", kind="slab"):
    """A plate, thin along x."""

    thickness: si.PositiveLength
    width: si.PositiveLength
    length: si.PositiveLength


class _Figurine(Model, builds="shapes.figurine", kind="figurine"):
    """The demo body, with thick and thin parts, some in front of others."""

    height: si.PositiveLength


ShapeConfig = Annotated[_Box | _Sphere | _Cylinder | _Slab | _Figurine, ByKind()]


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


class _RotationConfig(Model):
    """A rotation about an axis through the origin, right-handed."""

    axis: si.Direction
    angle: si.Angle

    def build(self, *args: Any) -> Any:
        # Rodrigues' formula, R = 1 + sin(a) K + (1 - cos(a)) K^2, with K v = axis x v.
        x, y, z = np.asarray(self.axis) / math.hypot(*self.axis)
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        sine, cosine = math.sin(self.angle), math.cos(self.angle)
        matrix = np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)
        return tuple((float(a), float(b), float(c)) for a, b, c in matrix)


class _PoseConfig(Model, builds="Pose"):
    """Position of the body in the scene: rotated first, then translated."""

    translation: si.Position = (0.0, 0.0, 0.0)
    rotation: _RotationConfig | None = None


class _MotionConfig(Model, builds="Motion"):
    """Poses at times, between which the body moves."""

    times: Annotated[tuple[si.Time, ...], si.NotEmpty]
    poses: tuple[_PoseConfig, ...]
    every: si.PositiveTime | None = None
    """Interval after which shadows, views and contacts are recomputed."""

    def build(self, *args: Any) -> Any:
        poses = tuple(pose.build() for pose in self.poses)
        return self.target()(jaxthermo.PoseTable(self.times, poses), every=self.every)

    def mistakes(self) -> list[Mistake]:
        found = not_increasing(self.times, "times", "s")
        return [*found, *unequal(self.poses, "poses", self.times, "times")]


def _rests_or_moves(value: Any) -> str:
    # Any of its keys, so that a motion without times is told what it lacks.
    keys = {"times", "poses", "every"} & {*(value if isinstance(value, dict) else ())}
    return "<moves>" if keys or isinstance(value, _MotionConfig) else "<rests>"


AnyPose = Annotated[
    Annotated[_PoseConfig, Tag("<rests>")] | Annotated[_MotionConfig, Tag("<moves>")],
    Discriminator(_rests_or_moves),
]


class BodyConfig(Model, builds="Body"):
    """One body of the scene."""

    mesh: MeshConfig | None = None
    """Mesh file of the body, a closed surface."""
    shape: ShapeConfig | None = None
    """Shape that needs no file, instead of a mesh."""
    pitch: si.PositiveLength | None = None
    """Edge of a voxel [m]."""
    voxels_high: Annotated[si.Whole, Field(ge=1, le=4096)] | None = None
    """Number of voxels along z, instead of their pitch."""
    structure: StructureConfig = FullVolume()
    """Nodes and links that represent the body's heat."""
    surface_map: SurfaceMapConfig = FluxCorrectedMap()
    material: BodyMaterial
    """Name, properties, both, or a file of labels with a material for each."""
    regions: tuple[_PaintConfig, ...] = ()
    """Boxes of other materials, later ones on top."""
    temperature: si.Temperature
    """Temperature at the start [K]."""
    pose: AnyPose = _PoseConfig()
    """Position in the scene, or a table of positions by time."""

    exactly_one: ClassVar = (("mesh", "shape"), ("pitch", "voxels_high"))

    def build(self, *args: Any) -> Any:
        """The body, voxelized.

        Raises:
            InputError: for a mesh, labels or a fit card that cannot be used.
        """
        mesh = self.build_mesh()
        pitch = self.pitch
        if pitch is None:
            height = float(np.ptp(mesh.bounds[:, 2]))
            pitch = height / float(self.voxels_high or 1)
        return self.target()(
            self.structure.build(jaxthermo.voxelize(mesh, pitch=pitch)),
            self.build_materials(),
            temperature=self.temperature,
            pose=self.pose.build(),
            surface_map=self.surface_map.build(),
        )

    def build_mesh(self) -> Any:
        """The mesh, from its file or as a shape, in metres and z up."""
        given = self.mesh or self.shape
        if given is None:
            raise InputError("bodies: a body needs a `mesh` or a `shape`")
        return given.build()

    def build_materials(self) -> Any:
        """One material, one with others painted over it, or one for each label."""
        base = self.material.build()
        painted = tuple(region.build() for region in self.regions)
        return jaxthermo.MaterialMap(base, painted) if painted else base

    @override
    def mistakes(self) -> list[Mistake]:
        if not self.regions:
            return []
        if isinstance(self.material, LabelledConfig):
            return [(("regions",), "the labels of `material` say what is where")]
        found = self.material.varying(("material",))
        for i, region in enumerate(self.regions):
            found += region.material.varying(("regions", i, "material"))
        return found
