"""Receipt of a compiled scene as data: mechanisms, parts and remarks."""

from dataclasses import asdict, dataclass

from ..choices import Dtype
from ..shown import html_of


@dataclass(frozen=True)
class Omission:
    """A mechanism that is not in the program."""

    what: str
    why: str


@dataclass(frozen=True)
class Part:
    """Part of a body, or of two bodies in contact, that a mechanism acts on."""

    mechanism: str
    bodies: tuple[int, ...]
    area: float
    """At the start [m^2]; 0 for what acts inside."""
    volume: float
    """Heated volume [m^3]; 0 for what acts on the surface."""
    surface_share: float
    """Fraction of the surface of the first of the bodies [-]."""
    length: float = 0.0
    """Length of a seam [m]; otherwise 0."""


@dataclass(frozen=True, eq=False)
class Receipt:
    """Contents of a compiled scene."""

    included: tuple[str, ...]
    parts: tuple[Part, ...]
    left_out: tuple[Omission, ...]
    notes: tuple[str, ...]
    """Remarks on the validity of laws: ranges exceeded, uncertain data."""
    warnings: tuple[str, ...]
    """Likely mistakes: bodies that overlap."""
    structures: tuple[str, ...]
    """Kind and number of nodes of each body, such as "Aggregate x4, 512 nodes"."""
    nodes: int
    links: int
    fragments: int
    snapshots: int
    """Number of geometries of moving bodies and sources; 1 if nothing moves."""
    capacity_ratios: tuple[float, ...]
    """Heat capacity of each body's nodes over that of the body [-]."""
    dtype: Dtype
    memory_bytes: int = 0
    """Forecast of the peak of the run without its structures, see `forecast_memory`."""
    body_names: tuple[str, ...] = ()
    """Name of each body; empty for one without."""
    searches: tuple[str, ...] = ()
    """Searches in the geometry that this run made; others were remembered."""

    def _repr_html_(self) -> str:
        return html_of(self)

    def as_dict(self) -> dict:
        """Plain types, for `summary.json`."""
        return asdict(self)
