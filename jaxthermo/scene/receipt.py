"""The receipt: what a compiled program holds, what was left out, and why."""

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Omission:
    """Something that is not in the program."""

    what: str
    why: str


@dataclass(frozen=True)
class Part:
    """What a mechanism reaches of one body, or of two that touch."""

    mechanism: str
    bodies: tuple[int, ...]
    area: float
    """Of the surface that it acts on, at the start [m^2]; 0 for what acts inside."""
    surface_share: float
    """Of the surface of the first of the bodies [-]."""


@dataclass(frozen=True, eq=False)
class Receipt:
    """What `compile_scene` made of a scene."""

    included: tuple[str, ...]
    parts: tuple[Part, ...]
    """Of what is included, how much of each body it acts on."""
    left_out: tuple[Omission, ...]
    notes: tuple[str, ...]
    """What to know of the laws: ranges that were left, data that is not sure."""
    nodes: int
    links: int
    fragments: int
    snapshots: int
    """How often bodies and sources are taken anew as they move; 1 if nothing does."""
    capacity_ratios: tuple[float, ...]
    """Of each body: what its nodes can store over what it could; 1 if all of it."""
    dtype: str
    memory_bytes: int
    """Forecast of the solver's peak: states, operators and surface arrays."""
    stable_step_s: float | None
    """Of explicit steps; None where there is no limit, or none is known."""

    def as_dict(self) -> dict:
        """Plain types, for `summary.json`."""
        return asdict(self)
