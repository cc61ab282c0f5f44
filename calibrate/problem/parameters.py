"""Fitted numbers of a scene with their bounds and priors.

A parameter sets one number of every scene of a fit, or several tied to the same value.
Together the parameters are one vector z of unconstrained coordinates, 0 at the start.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxthermo.errors import InputError
from jaxthermo.scene.scene import Scene

from .bijections import Bijection, Values, bijection
from .parameter_paths import find_path, with_value


Coordinates = Float[Array | np.ndarray, " p"]
"""Unconstrained coordinates of all parameters, 0 at the start."""


@dataclass(frozen=True)
class Prior:
    """Normal prior of a value, or of its logarithm where `log_normal`."""

    mean: float
    sd: float
    """Standard deviation of the value, or of its logarithm."""
    log_normal: bool = False

    def residual(self, value: Values) -> Values:
        """(value - mean) / sd, or (log value - log mean) / sd."""
        value = jnp.asarray(value)
        if self.log_normal:
            return (jnp.log(value) - math.log(self.mean)) / self.sd
        return (value - self.mean) / self.sd


@dataclass(frozen=True, eq=False)
class Smoothness:
    """Prior that a link's weight w is like those of the links at the same nodes.

    Penalty: mean over all link ends of ((log w - mean log w at the node) / sd)^2.
    """

    src: Int[np.ndarray, " e"]
    dst: Int[np.ndarray, " e"]
    sd: float

    def residual(self, value: Values) -> Float[Array, " q"]:
        """One row per link end; their squares sum to the penalty."""
        ends, logs = np.concatenate([self.src, self.dst]), jnp.log(value)
        # A link is an end at both of its nodes.
        logs = jnp.concatenate([logs, logs])
        nodes = int(ends.max()) + 1
        count = np.maximum(np.bincount(ends, minlength=nodes), 1).astype(logs.dtype)
        mean = jax.ops.segment_sum(logs, jnp.asarray(ends), nodes) / count
        return (logs - mean[ends]) / (self.sd * math.sqrt(len(ends)))


@dataclass(frozen=True)
class Parameter:
    """A number, or a list of them, at one or several paths of a scene.

    Raises:
        InputError: for bounds that exclude the start.
    """

    name: str
    """Dotted path, see `parameter_paths`."""
    start: tuple[float, ...]
    """Start values; a single one for a scalar."""
    lower: float = -math.inf
    upper: float = math.inf
    tied: tuple[str, ...] = ()
    """Further paths that take the same value."""
    prior: Prior | None = None
    softplus: bool = False
    is_scalar: bool = True
    first_is_fixed: bool = False
    """Keep the first value of a list at its start, where only ratios matter."""
    smoothness: Smoothness | None = None
    bijection: Bijection = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        if not self.lower < self.upper:
            raise InputError(
                f"parameter {self.name}: bounds {self.lower:g} to {self.upper:g}: the "
                "lower one must be less"
            )
        # At a bound the coordinate would be infinite.
        for value in self.start:
            if not self.lower < value < self.upper:
                raise InputError(
                    f"parameter {self.name}: starts at {value:g}, which is not between "
                    f"its bounds {self.lower:g} and {self.upper:g}"
                )
        varied = self.start[1:] if self.first_is_fixed else self.start
        start = np.asarray(varied[0] if self.is_scalar else varied)
        made = bijection(start, self.lower, self.upper, self.softplus)
        # The dataclass is frozen.
        object.__setattr__(self, "bijection", made)

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.start) - self.first_is_fixed

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of each coordinate."""
        if self.is_scalar:
            return (self.name,)
        return tuple(f"{self.name}.{i + self.first_is_fixed}" for i in range(self.size))

    @property
    def paths(self) -> tuple[str, ...]:
        """Names of everything in the scene that takes the value."""
        return (self.name, *self.tied)

    def coordinate(self, value: Any) -> Float[Array, "*m"]:
        """Coordinates of a value in the scene."""
        value = jnp.asarray(value)
        varied = value[1:] if self.first_is_fixed else value
        return jnp.asarray(self.bijection.coordinate(varied))


@dataclass(frozen=True)
class ParameterSet:
    """All parameters of a fit.

    Raises:
        InputError: for two parameters that set the same number.
    """

    parameters: tuple[Parameter, ...]

    def __post_init__(self):
        if not self.parameters:
            raise InputError("parameters: there is nothing to fit; name one at least")
        # Tied paths count too: the later of two parameters would win in silence.
        paths = [path for p in self.parameters for path in p.paths]
        for path in paths:
            if paths.count(path) > 1:
                raise InputError(f"parameter {path}: it is there twice")

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return sum(p.size for p in self.parameters)

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of each coordinate."""
        return tuple(label for p in self.parameters for label in p.labels)

    def check(self, scene: Scene) -> None:
        """Raise an InputError unless every path exists in the scene."""
        for p in self.parameters:
            for name in p.paths:
                find_path(scene, name)

    def values(self, z: Coordinates) -> dict[str, Values]:
        """Values by parameter name."""
        z, values, first = jnp.asarray(z), {}, 0
        for p in self.parameters:
            part = z[first : first + p.size]
            value = p.bijection.value(part[0] if p.is_scalar else part)
            # Bounds are float64 and must not promote a float32 fit.
            value = jnp.asarray(value, z.dtype)
            if p.first_is_fixed:
                fixed = jnp.full(1, p.start[0], z.dtype)
                value = jnp.concatenate([fixed, value])
            values[p.name] = value
            first += p.size
        return values

    def flat_values(self, z: Coordinates) -> Float[Array, " p"]:
        """Values of all coordinates, in the order of `labels`."""
        values = self.values(z)
        parts = [jnp.atleast_1d(values[p.name]) for p in self.parameters]
        pairs = zip(self.parameters, parts, strict=True)
        return jnp.concatenate([v[1:] if p.first_is_fixed else v for p, v in pairs])

    def coordinates(self, values: dict[str, Any]) -> Float[Array, " p"]:
        """Coordinates of values by parameter name."""
        parts = [jnp.atleast_1d(p.coordinate(values[p.name])) for p in self.parameters]
        return jnp.concatenate(parts)

    def insert(self, scene: Scene, z: Coordinates) -> Scene:
        """Copy of the scene with the values of the coordinates z."""
        values = self.values(z)
        # Runs when a program is traced, not at each evaluation.
        for p in self.parameters:
            for name in p.paths:
                scene = with_value(scene, find_path(scene, name), values[p.name])
        return scene

    def prior_residual(self, z: Coordinates) -> Float[Array, " q"]:
        """Deviations from the priors [standard deviations]."""
        return self._residual(z, [(p, p.prior) for p in self.parameters])

    def smoothness_residual(self, z: Coordinates) -> Float[Array, " q"]:
        """Deviations of link weights from their neighbours' [standard deviations]."""
        return self._residual(z, [(p, p.smoothness) for p in self.parameters])

    def _residual(self, z: Coordinates, terms: list[tuple[Parameter, Any]]) -> Any:
        values = self.values(z)
        rows = [
            jnp.atleast_1d(term.residual(values[p.name]))
            for p, term in terms
            if term is not None
        ]
        return jnp.concatenate(rows) if rows else jnp.zeros(0, z.dtype)
