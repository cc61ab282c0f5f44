"""The config of the comparison: bodies, loads, structures, claims; checked, in SI."""

import hashlib
import math
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

from pydantic import Field, ValidationError

from calibrate.config.schema import RefinedReference
from jaxthermo.config.loader import mesh_folders
from jaxthermo.config.messages import close_match, described, in_file
from jaxthermo.config.schema.geometry import MeshConfig, ShapeConfig
from jaxthermo.config.schema.image import PinholeConfig
from jaxthermo.config.schema.material import Material
from jaxthermo.config.schema.scene import TimeConfig
from jaxthermo.config.schema.structure import (
    FluxCorrectedMap,
    FullVolume,
    Partition,
    StructureConfig,
    SurfaceMapConfig,
)
from jaxthermo.config.schema.terms import TermConfig
from jaxthermo.config.strict_yaml import read_yaml
from jaxthermo.config.types.files import FOLDERS
from jaxthermo.config.types.model import Location, Mistake, Model
from jaxthermo.config.types.quantities import (
    Fraction,
    Irradiance,
    NotEmpty,
    Number,
    PositiveTime,
    Temperature,
    Whole,
)
from jaxthermo.errors import InputError

from ..harness.record import fingerprint


FULL = "full volume"
LINKS = "full volume as links"
# Labels of what every structure is compared with.
_RESERVED = (FULL, LINKS)

# The SSIM's window is 7 pixels wide: smaller frames would hardly hold two.
_MIN_PIXELS = 16

# The side that the sun shines on, in the file's own axes.
_Load: TypeAlias = Literal["+x", "-x", "+y", "-y", "+z", "-z"]

# In voxels along up.
_Height = Annotated[Whole, Field(ge=8, le=4096)]

_Repeats = Annotated[Whole, Field(ge=2, le=100)]


class ComparedBody(Model):
    """A body that every structure is made of."""

    mesh: MeshConfig | None = None
    shape: ShapeConfig | None = None

    exactly_one: ClassVar = (("mesh", "shape"),)

    @property
    def name(self) -> str:
        """The file's or the shape's."""
        if self.mesh is not None:
            return self.mesh.path.stem
        return "" if self.shape is None else self.shape.kind


class _SunConfig(Model):
    """Parallel rays from the side that a load names."""

    irradiance: Irradiance
    until: PositiveTime | None = None


class ExpectConfig(Model):
    """Expectations of a structure; the report marks those that are not met."""

    body: str | None = None
    """Body to which the expectations apply; all bodies if not given."""
    error_percent: Annotated[Number, Field(gt=0)] | None = None
    """At most, at the worst time of the worst load."""
    nodes: Annotated[Whole, Field(ge=1)] | None = None
    """At most."""
    node_share: Fraction | None = None
    """Nodes over solid voxels, at most."""
    times_faster: Annotated[Number, Field(gt=0)] | None = None
    """At least, by the median, than the full volume's explicit loop."""


class _NamedConfig(Model):
    """A structure and what the tables call it."""

    label: Annotated[str, Field(min_length=1, max_length=40)]
    structure: StructureConfig


class EntryConfig(_NamedConfig):
    """One structure of the comparison."""

    expect: ExpectConfig | None = None


class _PictureConfig(Model):
    """Which load and saved time the pictures show."""

    load: _Load
    time: PositiveTime


class LevelsConfig(Model):
    """The sweep over numbers of levels, up to all that the first body has."""

    counts: Annotated[tuple[Annotated[Whole, Field(ge=1)], ...], NotEmpty]
    hollow: Annotated[tuple[Literal["empty", "innermost"], ...], NotEmpty] = ("empty",)


class _EquilibriumConfig(Model):
    """A body heated on one side and then left alone until it is even."""

    body: str | None = None
    """Its name; the first one if not given."""
    voxels_high: _Height = 32


class LimbConfig(Model):
    """A body with thin limbs, and the structures that its local error is shown for."""

    shape: ShapeConfig
    voxels_high: _Height
    structures: Annotated[tuple[_NamedConfig, ...], NotEmpty]

    def mistakes(self) -> list[Mistake]:
        """Names given twice."""
        labels = [*_RESERVED, *(entry.label for entry in self.structures)]
        return _twice(labels, "structures", len(_RESERVED))


class _ClaimsConfig(Model):
    """Claims of the thesis that are measured; an omitted one is not run."""

    levels: LevelsConfig | None = None
    equilibrium: _EquilibriumConfig | None = None
    limb: LimbConfig | None = None


class BudgetEntry(_NamedConfig):
    """One line of the budget, for voxels of some heights."""

    structure: StructureConfig = FullVolume()
    voxels_high: Annotated[tuple[_Height, ...], NotEmpty] | None = None
    """Those of the budget if not given."""
    surface_cells: Literal["dominant_axis", "crossings"] = "crossings"


class _GoalConfig(Model):
    """An error that some structure of so many nodes has to keep to."""

    nodes: Annotated[Whole, Field(ge=1)]
    """At most."""
    error_percent: Annotated[Number, Field(gt=0)]
    """At most, at every saved time under every load."""


class BudgetConfig(Model):
    """Parts of the error against the truth: `experiments run budget`."""

    body: str | None = None
    """Its name; the first one if not given."""
    voxels_high: Annotated[tuple[_Height, ...], NotEmpty]
    """Heights for all structures without their own."""
    reference_voxels_high: _Height
    """Voxels of the reference, at least twice as many."""
    reference: StructureConfig = FullVolume()
    """Structure of the reference."""
    points: Annotated[Whole, Field(ge=100, le=10_000_000)] = 10_000
    """Number of points on the mesh at which temperatures are compared."""
    structures: Annotated[tuple[BudgetEntry, ...], NotEmpty]
    goals: tuple[_GoalConfig, ...] = ()

    def mistakes(self) -> list[Mistake]:
        """Names given twice, and voxels too fine for their reference."""
        labels = [entry.label for entry in self.structures]
        found = _twice(labels, "structures")
        finest = self.reference_voxels_high
        given: dict[Location, tuple[int, ...]] = {("voxels_high",): self.voxels_high}
        for i, entry in enumerate(self.structures):
            # Coarse structures of the reference's own voxels are marked as such.
            own = entry.voxels_high or ()
            given["structures", i, "voxels_high"] = tuple({*own} - {finest})
        words = f"must be at most half of the reference's {finest}"
        for where, heights in given.items():
            if any(2 * height > finest for height in heights):
                found.append((where, words))
        return found


class ComparisonConfig(Model):
    """The whole comparison."""

    bodies: Annotated[tuple[ComparedBody, ...], NotEmpty]
    voxels_high: _Height
    material: Material
    temperature: Temperature
    sun: _SunConfig
    loads: Annotated[tuple[_Load, ...], NotEmpty]
    terms: tuple[TermConfig, ...] = ()
    time: TimeConfig
    structures: Annotated[tuple[EntryConfig, ...], NotEmpty]
    surface_map: SurfaceMapConfig = FluxCorrectedMap(at="voxel")
    full_volume_as_links: bool = True
    reference_step: Annotated[Fraction, Field(gt=0)] = 0.25
    truth: RefinedReference | None = None
    """Runs of finer voxels, which truth errors are measured from."""
    budget: BudgetConfig | None = None
    """An experiment of its own: where errors come from."""
    repeats: _Repeats = 5
    camera: PinholeConfig = PinholeConfig()
    picture: _PictureConfig
    claims: _ClaimsConfig = _ClaimsConfig()

    def mistakes(self) -> list[Mistake]:
        """Names given twice, and names of what is not there."""
        found: list[Mistake] = []
        labels = [entry.label for entry in self.structures]
        found += _twice([body.name for body in self.bodies], "bodies")
        found += _twice([*_RESERVED, *labels], "structures", len(_RESERVED))
        found += _twice(list(self.loads), "loads")
        if self.picture.load not in self.loads:
            found.append((("picture", "load"), "is not one of the `loads`"))
        if min(self.camera.width, self.camera.height) < _MIN_PIXELS:
            message = f"frames are compared from {_MIN_PIXELS} pixels up, each way"
            found.append((("camera",), message))
        shown = self.picture.time
        if not any(math.isclose(shown, time) for time in self.time.save_times):
            found.append((("picture", "time"), "is not a saved time"))
        return [*found, *self._unknown_bodies()]

    def _unknown_bodies(self) -> list[Mistake]:
        """Bodies that are named elsewhere and are not in the list."""
        bodies = [body.name for body in self.bodies]
        named: list[tuple[Location, str | None]] = [
            (("structures", i, "expect", "body"), entry.expect.body)
            for i, entry in enumerate(self.structures)
            if entry.expect is not None
        ]
        if self.claims.equilibrium is not None:
            location = ("claims", "equilibrium", "body")
            named.append((location, self.claims.equilibrium.body))
        if self.budget is not None:
            named.append((("budget", "body"), self.budget.body))
        return [
            (where, f"there is no '{name}'{close_match(name, bodies)}")
            for where, name in named
            if name is not None and name not in bodies
        ]


def _twice(names: list[str], key: str, first: int = 0) -> list[Mistake]:
    return [
        ((key, i - first), f"'{name}' is there twice")
        for i, name in enumerate(names)
        if name in names[:i]
    ]


def load_comparison(
    path: Path, height: int | None = None, *, find_meshes: bool = True
) -> ComparisonConfig:
    """The config in a YAML file, with meshes found and values in SI units.

    Raises:
        InputError: one line for each mistake.
    """
    data: dict[str, Any] = read_yaml(path)
    if height is not None:
        data = {**data, "voxels_high": height}
    context = {FOLDERS: mesh_folders(path.parent) if find_meshes else ()}
    try:
        return ComparisonConfig.model_validate(data, context=context)
    except ValidationError as error:
        given = lambda place: place == ("voxels_high",) and height is not None
        source = lambda place: "--height" if given(place) else in_file(path, place)
        raise InputError(described(error, source)) from error


def resolved(config: ComparisonConfig) -> dict[str, Any]:
    """The config as plain values in SI units."""
    return config.model_dump(mode="json", exclude_none=True)


def body_identity(body: ComparedBody) -> dict[str, Any]:
    """The body as plain values, with the content of its file in place of its path."""
    plain = body.model_dump(mode="json", exclude_none=True)
    if body.mesh is not None:
        content = body.mesh.path.read_bytes()
        plain["mesh"]["path"] = hashlib.sha256(content).hexdigest()
    return plain


def structure_identity(structure: StructureConfig) -> dict[str, Any]:
    """The structure as plain values, with the content of a file of labels."""
    plain = structure.model_dump(mode="json", exclude_none=True)
    if isinstance(structure, Partition):
        plain["labels"] = hashlib.sha256(structure.labels.read_bytes()).hexdigest()
    return plain


def common_identity(config: ComparisonConfig) -> dict[str, Any]:
    """Inputs that all rows have in common, without what makes rows of its own."""
    plain = resolved(config)
    apart = ("bodies", "loads", "structures", "claims", "full_volume_as_links")
    for key in (*apart, "truth", "budget"):
        plain.pop(key, None)
    return plain


def config_hash(config: ComparisonConfig) -> str:
    """16 hex digits that change with the config, but not with the folder of meshes."""
    plain = resolved(config)
    plain["bodies"] = [body_identity(body) for body in config.bodies]
    return fingerprint(plain)
