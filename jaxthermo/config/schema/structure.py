"""Structures, weights of conduction and surface maps: the thermal model of a body."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator
from typing_extensions import override

import jaxthermo

from ...errors import InputError
from ..shipped_cards import card_name
from ..types.files import CardPath, FoundPath, read_labels
from ..types.model import ByKind, KindModel, Mistake, Model, Short
from ..types.quantities import (
    Auto,
    Flag,
    NotEmpty,
    Number,
    PositiveLength,
    PositiveTime,
    Whole,
)
from .selection import WhereConfig


def _number_or_list(value: Any) -> str:
    return "<list>" if isinstance(value, list | tuple) else "<number>"


_NUMBER = Tag("<number>")
_LIST = Tag("<list>")
_EITHER = Discriminator(_number_or_list)
# Above this, float32 overflows long before the weight has any physical meaning.
_MAX_WEIGHT = 1e9
_Weight = Annotated[Number, Field(ge=0, le=_MAX_WEIGHT)]
_Positive = Annotated[Number, Field(gt=0, le=_MAX_WEIGHT)]
_Weights = Annotated[
    Annotated[_Weight, _NUMBER] | Annotated[tuple[_Weight, ...], NotEmpty, _LIST],
    _EITHER,
]
_PositiveWeights = Annotated[
    Annotated[_Positive, _NUMBER] | Annotated[tuple[_Positive, ...], NotEmpty, _LIST],
    _EITHER,
]
# No body has more voxels, or layers of them, along an edge.
Count = Annotated[Whole, Field(ge=1, le=4096)]
# For a body of no scene: about the interval of frames of a fast process.
_SHORTEST_TIME = 60.0
# Number of levels; None for all that the body has.
_Levels = Annotated[Count | None, Auto]


class _WeightsConfig(Model, builds="ConductionWeights"):
    """Factors of conductances and capacities; a list has one number for each level."""

    within: _Weights = 1.0
    between: _Weights = 1.0
    surface: _Weight = 1.0
    capacity: _PositiveWeights = 1.0
    surface_distance: _Weight = 1.0
    nearest_capacity: Annotated[Number, Field(ge=-10, le=10)] = 0.0
    non_orthogonal: Annotated[Number, Field(ge=-1, le=2)] = 0.0
    card: CardPath | None = None
    """Fit card with all weights, instead of numbers: a file, or card://NAME."""

    def build(self, *args: Any) -> Any:
        if self.card is not None:
            return jaxthermo.load_card(self.card).weights
        return super().build()

    def mistakes(self) -> list[Mistake]:
        if self.card is None:
            return []
        # The weights of a card were fitted together: none can be changed alone.
        changed_weights = [
            name
            for name, field in type(self).model_fields.items()
            if name != "card" and getattr(self, name) != field.default
        ]
        return [
            ((name,), "is in the card: give one or the other")
            for name in changed_weights
        ]


# Factors, or the path of a fit card.
_CardOrWeights = Annotated[_WeightsConfig, Short("card")]


class _Structure(KindModel):
    """A kind of structure; `build` takes the body's voxel grid."""

    weights: _CardOrWeights = _WeightsConfig()

    @property
    def options(self) -> Mapping[str, object]:
        """The kind and its options as plain values, without the weights."""
        return self.model_dump(mode="json", exclude={"weights"}, exclude_none=True)

    def options_of(self, built: Any) -> Mapping[str, object]:
        """The options with the values that were chosen for the built structure."""
        del built
        return self.options

    def build(self, *args: Any) -> Any:
        # The weights of a card compensate the errors of one structure only.
        path = self.weights.card
        if path is not None:
            fitted = dict(jaxthermo.load_card(path).structure)
            if fitted != self.options:
                raise InputError(
                    f"weights: {card_name(path)} is of {_listed(fitted)}, and the "
                    f"structure is {_listed(self.options)}: fit one for it, or use "
                    "the card's structure"
                )
        return super().build(*args)


def _listed(options: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in options.items())


class FullVolume(_Structure, builds="FullVolume", kind="full_volume"):
    """Every solid voxel."""

    kernels: Literal["numba"] | None = None

    @property
    @override
    def options(self) -> Mapping[str, object]:
        # Weights do not depend on the kernels of steps.
        options = super().options
        return {name: value for name, value in options.items() if name != "kernels"}


class _SingleShell(_Structure, builds="SingleShell", kind="single_shell"):
    """The surface voxels only."""

    capacity: Literal["body", "own"] = "body"


class _MultiLevel(_Structure, builds="MultiLevel", kind="multi_level"):
    """Shells inside shells."""

    levels: Count = 10
    hollow: Literal["empty", "innermost"] = "empty"


class _IrregularMultiLevel(
    _Structure, builds="IrregularMultiLevel", kind="irregular_multi_level"
):
    """Shells whose voxels grow inwards."""

    levels: _Levels = None
    keep_capacity: Flag = False


class _Octree(_Structure, builds="Octree", kind="octree"):
    """Cells that grow inwards and fill the body."""

    levels: _Levels = None


def _block_keys(data: Mapping[str, Any]) -> list[str]:
    """The keys in the data that choose the factor of an aggregate."""
    return [k for k in ("factor", "nodes", "size") if data.get(k) is not None]


class _Aggregate(_Structure, builds="Aggregate", kind="aggregate"):
    """Blocks of factor^3 voxels; `nodes` or `size` may choose the factor."""

    factor: Count | None = None
    """Voxels along an edge of a block; 4 unless the nodes or the size are given."""
    nodes: Annotated[Whole, Field(ge=1)] | None = None
    """Largest number of nodes: the smallest factor with no more of them is chosen."""
    size: PositiveLength | None = None
    """Edge of a block [m], rounded to whole voxels, instead of the factor."""
    min_time_constant: Annotated[float, Field(ge=0, le=1)] = 0.45
    alignment: Annotated[float, Field(ge=0, le=1)] = 0.7

    @model_validator(mode="before")
    @classmethod
    def _with_default(cls, data: Any) -> Any:
        # The default is written out, as in fit cards.
        if isinstance(data, dict) and not _block_keys(data):
            return {**data, "factor": 4}
        return data

    @classmethod
    @override
    def raw_mistakes(cls, data: Mapping[str, object]) -> list[Mistake]:
        block_keys = _block_keys(data)
        if len(block_keys) < 2:
            return []
        return [((block_keys[-1],), "give `factor`, `nodes` or `size`, one of them")]

    @override
    def build(self, *args: Any) -> Any:
        if self.nodes is None and self.size is None:
            return super().build(*args)
        # _Weights of a card are compared with the factor.
        factor = self.target().factor_for(*args, nodes=self.nodes, size=self.size)
        return self._with(factor).build(*args)

    @override
    def options_of(self, built: Any) -> Mapping[str, object]:
        return self._with(built.factor).options

    def _with(self, factor: int) -> Any:
        # The factor replaces the keys that choose it.
        return self.model_copy(update={"factor": factor, "nodes": None, "size": None})


class _ShellOverCore(_Structure, builds="ShellOverCore", kind="shell_over_core"):
    """Fine layers over blocks."""

    layers: Count = 1
    factor: Count = 4


class _Partition(_Structure, builds="Partition", kind="partition"):
    """Nodes given by a file of labels."""

    labels: FoundPath

    @override
    def arguments(self) -> dict[str, Any]:
        return super().arguments() | {"labels": read_labels(self.labels)}


StructureConfig = Annotated[
    FullVolume
    | _SingleShell
    | _MultiLevel
    | _IrregularMultiLevel
    | _Octree
    | _Aggregate
    | _ShellOverCore
    | _Partition,
    ByKind(),
    Short("kind", "full_volume"),
]


class _SkinConfig(Model):
    """Cells below the surface, thinner towards it."""

    cells: Annotated[Annotated[Whole, Field(ge=1, le=32)] | None, Auto] = None
    """Number of cells below each fragment; by the shortest time if `auto`."""
    shortest_time: PositiveTime | None = None
    """Shortest time after a change of what acts that matters [s]; the interval between
    saved times if not given."""
    on: WhereConfig | None = None
    """Part of the surface; that of the terms if they all have one, else all of it."""

    def build(self, *args: Any) -> Any:
        """The structure with this skin; a diffusivity [m^2/s] tells `auto`."""
        structure, diffusivity = args
        cells = self.cells
        if cells is None:
            cells = jaxthermo.Skin.cells_for(
                structure.grid.pitch,
                diffusivity=diffusivity,
                time=self.shortest_time or _SHORTEST_TIME,
            )
        on = self.on and self.on.build()
        return jaxthermo.Skin(structure, cells=cells, on=on)


SkinConfig = Annotated[_SkinConfig, Short("cells", words=("auto",))]

_Depth = Literal["surface", "voxel"]


class _ConstantMap(KindModel, builds="ConstantMap", kind="constant"):
    """The node's temperature."""


class _LinearMap(KindModel, builds="LinearMap", kind="linear"):
    """The node's temperature and its gradient."""

    at: _Depth = "surface"


class FluxCorrectedMap(KindModel, builds="FluxCorrectedMap", kind="flux_corrected"):
    """The energy balance at the surface, and the gradient along it."""

    at: _Depth = "surface"


SurfaceMapConfig = Annotated[
    _ConstantMap | _LinearMap | FluxCorrectedMap,
    ByKind(),
    Short("kind", "flux_corrected"),
]
