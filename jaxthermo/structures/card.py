"""Data of fit cards apart from the weights themselves, which need JAX."""

import abc
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import Any


@dataclass(frozen=True, eq=False)
class AbstractCard(abc.ABC):
    """Fit of one kind of structure: its data, without the weights."""

    name: str
    structure: Mapping[str, Any]
    """Kind and options of the structure, as in a config."""
    _: KW_ONLY
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Other fitted values of the scene, by name."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Range of each number of `scene_numbers` over all fitted cases."""
    tolerance: float = 1.2
    """Factor by which a number may lie beyond its range, or beyond the one value of a
    range without width, before `extrapolations` lists it."""
    mechanisms: tuple[str, ...] = ()
    """Mechanisms of heat transfer in these cases."""
    geometry: Mapping[str, str] = field(default_factory=dict)
    """Hash of each fitted body's geometry, by the name of its file or shape."""
    error_percent: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Errors of "train" and "held_out", each "default" and "fitted" [%]."""
    error_kelvin: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Errors of "train" and "held_out" against finer voxels, and that of the
    "reference" itself [K]; empty if the fit was compared with no finer voxels."""
    surface_cells: str = ""
    """Surface cells of the voxels that were fitted; empty if they are not known."""
    origin: Mapping[str, str] = field(default_factory=dict)
    """Cases and settings of the fit, hashes and versions."""


@dataclass(frozen=True, eq=False)
class CardSummary(AbstractCard):
    """A card as a table shows it, without its weights."""
