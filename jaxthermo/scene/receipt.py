"""The receipt: what a compiled program holds, what was left out, and why."""

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Omission:
    """Something that is not in the program."""

    what: str
    why: str


@dataclass(frozen=True, eq=False)
class Receipt:
    """What `compile_scene` made of a scene."""

    included: tuple[str, ...]
    left_out: tuple[Omission, ...]
    nodes: int
    links: int
    fragments: int
    capacity_ratios: tuple[float, ...]
    """Of each body: what its nodes can store over what it could; 1 if all of it."""
    dtype: str
    memory_bytes: int
    """Forecast of the solver's peak: states, operators and surface arrays."""

    def as_dict(self) -> dict:
        """Plain types, for `summary.json`."""
        return asdict(self)
