"""Structures, weights of conduction and surface maps: what stands for a body's heat."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag

from .fields import Auto, Flag, NotEmpty, Number, Whole
from .found import FoundPath
from .kinds import KindModel, by_kind, short_kind
from .model import Mistake, Model


def _number_or_list(value: Any) -> str:
    return "<list>" if isinstance(value, list | tuple) else "<number>"


_NUMBER = Tag("<number>")
_LIST = Tag("<list>")
_EITHER = Discriminator(_number_or_list)
# Beyond that float32 overflows long before there is any physics in it.
_MOST = 1e9
Weight = Annotated[Number, Field(ge=0, le=_MOST)]
Share = Annotated[Number, Field(gt=0, le=_MOST)]
Weights = Annotated[
    Annotated[Weight, _NUMBER] | Annotated[tuple[Weight, ...], NotEmpty, _LIST], _EITHER
]
Shares = Annotated[
    Annotated[Share, _NUMBER] | Annotated[tuple[Share, ...], NotEmpty, _LIST], _EITHER
]
Count = Annotated[Whole, Field(ge=1, le=4096)]
"""Of voxels or layers of them: no body has more along an edge."""
Levels = Annotated[Count | None, Auto]
"""None: as many as the body has."""


class WeightsConfig(Model):
    """Factors of conductances and capacities; a list has one number a level."""

    within: Weights = 1.0
    between: Weights = 1.0
    surface: Weight = 1.0
    capacity: Shares = 1.0
    surface_distance: Weight = 1.0
    nearest_capacity: Annotated[Number, Field(ge=-10, le=10)] = 0.0
    non_orthogonal: Annotated[Number, Field(ge=-1, le=2)] = 0.0
    card: FoundPath | None = None
    """A fit card, whose weights they are."""

    def mistakes(self) -> list[Mistake]:
        """Weights beside those of a card."""
        if self.card is None:
            return []
        given = [
            name
            for name, field in type(self).model_fields.items()
            if name != "card" and getattr(self, name) != field.default
        ]
        return [((name,), "is in the card: give one or the other") for name in given]


def _card(value: Any) -> Any:
    return {"card": value} if isinstance(value, str) else value


CardOrWeights = Annotated[WeightsConfig, BeforeValidator(_card)]
"""Factors, or the path of a fit card."""


class FullVolume(KindModel):
    """Every solid voxel."""

    kind: Literal["full_volume"] = "full_volume"
    weights: CardOrWeights = WeightsConfig()


class SingleShell(KindModel):
    """The surface voxels only."""

    kind: Literal["single_shell"] = "single_shell"
    capacity: Literal["body", "own"] = "body"
    weights: CardOrWeights = WeightsConfig()


class MultiLevel(KindModel):
    """Shells inside shells."""

    kind: Literal["multi_level"] = "multi_level"
    levels: Count = 10
    hollow: Literal["empty", "innermost"] = "empty"
    weights: CardOrWeights = WeightsConfig()


class IrregularMultiLevel(KindModel):
    """Shells whose voxels grow inwards."""

    kind: Literal["irregular_multi_level"] = "irregular_multi_level"
    levels: Levels = None
    keep_capacity: Flag = False
    weights: CardOrWeights = WeightsConfig()


class Octree(KindModel):
    """Cells that grow inwards and fill the body."""

    kind: Literal["octree"] = "octree"
    levels: Levels = None
    weights: CardOrWeights = WeightsConfig()


class Aggregate(KindModel):
    """Blocks of factor^3 voxels."""

    kind: Literal["aggregate"] = "aggregate"
    factor: Count = 4
    min_time_constant: Annotated[float, Field(ge=0, le=1)] = 0.45
    alignment: Annotated[float, Field(ge=0, le=1)] = 0.7
    weights: CardOrWeights = WeightsConfig()


class ShellOverCore(KindModel):
    """Fine layers over blocks."""

    kind: Literal["shell_over_core"] = "shell_over_core"
    layers: Count = 1
    factor: Count = 4
    weights: CardOrWeights = WeightsConfig()


class Partition(KindModel):
    """Nodes as a file of labels says."""

    kind: Literal["partition"] = "partition"
    labels: FoundPath
    weights: CardOrWeights = WeightsConfig()


StructureConfig = Annotated[
    Annotated[FullVolume, Tag("<full_volume>")]
    | Annotated[SingleShell, Tag("<single_shell>")]
    | Annotated[MultiLevel, Tag("<multi_level>")]
    | Annotated[IrregularMultiLevel, Tag("<irregular_multi_level>")]
    | Annotated[Octree, Tag("<octree>")]
    | Annotated[Aggregate, Tag("<aggregate>")]
    | Annotated[ShellOverCore, Tag("<shell_over_core>")]
    | Annotated[Partition, Tag("<partition>")],
    Discriminator(by_kind),
    short_kind("full_volume"),
]

Depth = Literal["surface", "voxel"]


class ConstantMap(KindModel):
    """The node's temperature."""

    kind: Literal["constant"] = "constant"


class LinearMap(KindModel):
    """The node's temperature and its gradient."""

    kind: Literal["linear"] = "linear"
    at: Depth = "surface"


class FluxCorrectedMap(KindModel):
    """The balance at the surface, and the gradient along it."""

    kind: Literal["flux_corrected"] = "flux_corrected"
    at: Depth = "surface"


SurfaceMapConfig = Annotated[
    Annotated[ConstantMap, Tag("<constant>")]
    | Annotated[LinearMap, Tag("<linear>")]
    | Annotated[FluxCorrectedMap, Tag("<flux_corrected>")],
    Discriminator(by_kind),
    short_kind("flux_corrected"),
]
