"""From a validated config to where a term acts."""

from ..voxels.selection import (
    AbstractSelection,
    AbstractSpace,
    Everything,
    FragmentMask,
    Region,
    Side,
)
from .array_files import read_mask
from .schema_place import RegionConfig, WhereConfig, WithinConfig


def build_selection(config: WhereConfig | None) -> AbstractSelection | None:
    """The part of the surface on which a term acts; None for all of it."""
    if config is None:
        return None
    if config.side is not None:
        return Side(**dict(config.side))
    if config.fragments is not None:
        return FragmentMask(read_mask(config.fragments.mask), config.fragments.body)
    return _space(config.region, config.body)


def build_space(config: WithinConfig | None) -> AbstractSpace | None:
    """The part of the inside on which a term acts; None for all of it."""
    return None if config is None else _space(config.region, config.body)


def _space(region: RegionConfig | None, body: int | None) -> AbstractSpace:
    if region is not None:
        return Region(**dict(region))
    return Everything(body=body or 0)
