"""Geometry of a body: a mesh file, a shape, or several of them combined, and poses."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field
from typing_extensions import override

import jaxthermo

from ...errors import InputError
from ..messages import close_match, quoted
from ..types import quantities as si
from ..types.files import FoundPath
from ..types.model import ByKind, Mistake, Model, build
from .sheet import GroundShape


def _metres_per_unit(value: Any) -> float:
    """Metres, from a unit's name, a length such as "25.4 mm", or a number."""
    is_name = isinstance(value, str) and value[:1].isalpha()
    try:
        return si.to_si(f"1 {value}" if is_name else value, si.LENGTH)
    except InputError:
        raise si.refuse(
            f"expected a length unit such as 'mm', got {quoted(value)}"
        ) from None


_MetresPerUnit = Annotated[
    float,
    BeforeValidator(_metres_per_unit, json_schema_input_type=float | str),
    Field(gt=0),
]


class MeshConfig(Model, builds="load_mesh"):
    """A mesh file and its scale: metres per file unit, or the height of the body."""

    path: FoundPath
    """OBJ, PLY, STL, GLB, glTF, OFF, 3MF or DAE file, in the config's folder or
    JAXTHERMO_MESHES."""
    unit: _MetresPerUnit | None = None
    """Length of one file unit, such as mm."""
    height: si.PositiveLength | None = None
    """Extent along `up` [m], instead of the unit."""
    up: Literal["x", "y", "z", "-x", "-y", "-z"] = "z"
    part: Annotated[str, Field(min_length=1)] | None = None
    """Name of the only part of the file that counts; `jaxthermo parts` lists them."""

    exactly_one: ClassVar = (("unit", "height"),)

    @override
    def build(self, *args: Any) -> Any:
        """The mesh of the file, or of the part, at its position.

        Raises:
            InputError: for a file or part that cannot be used.
        """
        if self.part is None:
            return super().build()
        placed = self.build_placed_part()
        return placed.mesh.placed(placed.pose)

    def build_parts(self) -> "dict[str, jaxthermo.Mesh]":
        """The named parts of the file, placed like the mesh."""
        if self.part is not None:
            return {"": self.build()}
        return jaxthermo.load_parts(**self.arguments())

    def build_placed_part(self) -> "jaxthermo.PlacedPart":
        """The part in a frame that it shares with the parts of its geometry.

        Raises:
            InputError: for a file that cannot be read, or has no such part.
        """
        assert self.part is not None
        parts = self.placed_parts()
        if self.part not in parts:
            raise InputError(
                f"{self.path}: there is no part {self.part!r}"
                f"{close_match(self.part, parts)}"
            )
        return parts[self.part]

    def placed_parts(self) -> "Mapping[str, jaxthermo.PlacedPart]":
        """All parts of the file, by name, those of equal geometry with one mesh.

        Raises:
            InputError: for a file that cannot be read.
        """
        arguments = {k: v for k, v in self.arguments().items() if k != "part"}
        status = self.path.stat() if self.path.exists() else None
        stamp = status and (status.st_mtime_ns, status.st_size)
        return _placed_parts(stamp, **arguments)


@lru_cache(maxsize=8)
def _placed_parts(
    stamp: object, **arguments: Any
) -> "Mapping[str, jaxthermo.PlacedPart]":
    """Parts of a file; the stamp tells whether it has changed."""
    del stamp
    return jaxthermo.placed_parts(jaxthermo.load_parts(**arguments))


class _Box(Model, builds="shapes.box", kind="box"):
    """A block with edges along the axes."""

    size: si.Size


class _Sphere(Model, builds="shapes.sphere", kind="sphere"):
    """A ball."""

    radius: si.PositiveLength


class _Round(Model):
    """A shape that is round about z, of flat faces."""

    sections: Annotated[si.Whole, Field(ge=6, le=1000)] | None = None
    """Number of flat sides around it; 64 if not given."""


class _Cylinder(_Round, builds="shapes.cylinder", kind="cylinder"):
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


class _RotationConfig(Model):
    """A rotation about an axis through the origin, right-handed."""

    axis: si.Direction
    angle: si.Angle


class PoseConfig(Model, builds="Pose"):
    """Position of the body in the scene: rotated first, then translated."""

    translation: si.Position = (0.0, 0.0, 0.0)
    rotation: _RotationConfig | None = None

    def build(self, *args: Any) -> Any:
        """Return the pose, which remembers the axis and the angle of its rotation."""
        if self.rotation is None:
            return self.target()(self.translation)
        return self.target().about(
            self.rotation.axis, self.rotation.angle, self.translation
        )


class _Tube(_Round, builds="shapes.tube", kind="tube"):
    """An upright tube, open at both ends."""

    radius: si.PositiveLength
    """Outer radius [m]."""
    inner_radius: si.PositiveLength
    height: si.PositiveLength

    @override
    def mistakes(self) -> list[Mistake]:
        message = f"must be less than the outer radius, {self.radius:g} m"
        return [] if self.inner_radius < self.radius else [(("inner_radius",), message)]


class _Cone(_Round, builds="shapes.cone", kind="cone"):
    """An upright cone with its tip up, or cut off at a smaller radius."""

    radius: si.PositiveLength
    height: si.PositiveLength
    top_radius: si.PositiveLength | None = None
    """Radius of the upper end [m]; pointed if not given."""


class _Capsule(_Round, builds="shapes.capsule", kind="capsule"):
    """An upright rod with round ends."""

    radius: si.PositiveLength
    height: si.PositiveLength
    """From tip to tip [m]."""

    @override
    def mistakes(self) -> list[Mistake]:
        message = f"must be at least the diameter, {2 * self.radius:g} m"
        return [] if self.height >= 2 * self.radius else [(("height",), message)]


class _Hemisphere(_Round, builds="shapes.hemisphere", kind="hemisphere"):
    """Half of a ball, its flat side down."""

    radius: si.PositiveLength


def _three_or_more(points: tuple[Any, ...]) -> tuple[Any, ...]:
    if len(points) < 3:
        raise si.refuse(f"give three or more points, got {len(points)}")
    return points


_Outline = AfterValidator(_three_or_more)


class _Prism(Model, builds="shapes.prism", kind="prism"):
    """A body between two equal polygons."""

    points: Annotated[tuple[si.PlanePosition, ...], _Outline]
    """Corners [x, y] of the outline [m]."""
    height: si.PositiveLength
    """Extent along z, half of it to each side of z = 0 [m]."""


class _Rectangle(Model, builds="shapes.rectangle", kind="rectangle"):
    """A flat surface with its front up, for a sheet."""

    width: si.PositiveLength
    """Edge along x [m]."""
    length: si.PositiveLength
    """Edge along y [m]."""


class _Disc(_Round, builds="shapes.disc", kind="disc"):
    """A round flat surface with its front up, for a sheet."""

    radius: si.PositiveLength


class _Polygon(Model, builds="shapes.polygon", kind="polygon"):
    """A flat surface between corners in space, for a sheet."""

    points: Annotated[tuple[si.Position, ...], _Outline]
    """Corners, counter-clockwise seen from the front [m]."""


class _Pipe(_Round, builds="shapes.pipe", kind="pipe"):
    """The side of an upright cylinder, its front outside, for a sheet."""

    radius: si.PositiveLength
    height: si.PositiveLength


class _Tray(Model, builds="shapes.tray", kind="tray"):
    """The surface of a box without its top, its front outside, for a sheet."""

    size: si.Size


class _PartConfig(Model):
    """A mesh or shape that a body is combined from."""

    mesh: MeshConfig | None = None
    shape: "ShapeConfig | None" = None
    pose: PoseConfig = PoseConfig()
    """Position in the combined shape: rotated first, then translated."""

    exactly_one: ClassVar = (("mesh", "shape"),)

    def build(self, *args: Any) -> Any:
        mesh_or_shape = self.mesh or self.shape
        assert mesh_or_shape is not None
        return mesh_or_shape.build().placed(self.pose.build())

    @override
    def mistakes(self) -> list[Mistake]:
        if not isinstance(self.shape, GroundShape) or self.shape.layers is None:
            return []
        message = "a part has no layers: give them in the `sheet` of the body"
        return [(("shape", "layers"), message)]


_Parts = Annotated[tuple[_PartConfig, ...], Field(min_length=2)]


class _Union(Model, kind="union"):
    """All the space inside any of the parts; needs the package manifold3d."""

    parts: _Parts

    def build(self, *args: Any) -> Any:
        return jaxthermo.shapes.union(*build(self.parts))


class _Difference(Model, kind="difference"):
    """The first part less all the others; needs the package manifold3d."""

    parts: _Parts

    def build(self, *args: Any) -> Any:
        return jaxthermo.shapes.difference(*build(self.parts))


class PartsShape(Model, kind="parts"):
    """Named meshes and shapes side by side, whose triangles stay as they are."""

    parts: Annotated[dict[str, _PartConfig], si.NotEmpty]
    """The parts by name."""

    @override
    def build(self, *args: Any) -> Any:
        return jaxthermo.shapes.joined(*self.build_parts().values())

    def build_parts(self) -> "dict[str, jaxthermo.Mesh]":
        """The named parts, each at its position."""
        return {name: part.build() for name, part in self.parts.items()}


ShapeConfig = Annotated[
    _Box
    | _Sphere
    | _Cylinder
    | _Slab
    | _Figurine
    | _Tube
    | _Cone
    | _Capsule
    | _Hemisphere
    | _Prism
    | _Rectangle
    | _Disc
    | _Polygon
    | _Pipe
    | _Tray
    | GroundShape
    | _Union
    | _Difference
    | PartsShape,
    ByKind(),
]
