"""What is fitted: named numbers of a scene, within bounds, with what is known of them.

A parameter sets one place in every scene of a fit, or several tied to the same value.
Together they are one vector z of free numbers, 0 at the start.
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

from .bijections import AbstractTransform, Values, transform
from .parameter_paths import find, put


Free = Float[Array | np.ndarray, " p"]
"""Free numbers of all parameters, 0 at the start."""


@dataclass(frozen=True)
class Prior:
    """What is known beforehand: a normal distribution, of the logarithm if positive."""

    mean: float
    sd: float
    """Of the value; of its logarithm, where `of_logarithm`."""
    of_logarithm: bool = False

    def misfit(self, value: Values) -> Values:
        """(Value - mean) / sd."""
        value = jnp.asarray(value)
        if self.of_logarithm:
            return (jnp.log(value) - math.log(self.mean)) / self.sd
        return (value - self.mean) / self.sd


@dataclass(frozen=True, eq=False)
class Smoothness:
    """That weights of links are like those of the links about the same nodes.

    The mean over all links' ends of ((log w - mean there) / sd)^2.
    """

    src: Int[np.ndarray, " e"]
    dst: Int[np.ndarray, " e"]
    sd: float

    def misfit(self, value: Values) -> Float[Array, " q"]:
        """A row an end of a link, so that squares sum to that mean."""
        ends, logs = np.concatenate([self.src, self.dst]), jnp.log(value)
        both = jnp.concatenate([logs, logs])
        nodes = int(ends.max()) + 1
        count = np.maximum(np.bincount(ends, minlength=nodes), 1)
        mean = jax.ops.segment_sum(both, jnp.asarray(ends), nodes) / count.astype(
            both.dtype
        )
        return (both - mean[ends]) / (self.sd * math.sqrt(len(ends)))


@dataclass(frozen=True)
class Parameter:
    """A number, or a list of them, at one or several places of a scene.

    Raises:
        InputError: for bounds that exclude the start.
    """

    name: str
    """Dotted, as in `paths`."""
    start: tuple[float, ...]
    """One number for a scalar; see `is_scalar`."""
    lower: float = -math.inf
    upper: float = math.inf
    also: tuple[str, ...] = ()
    """Further places that are tied to the same value."""
    prior: Prior | None = None
    soft: bool = False
    is_scalar: bool = True
    anchored: bool = False
    """Whether the first of a list keeps its start, since only ratios count."""
    smoothness: Smoothness | None = None
    """Of one value a link."""
    transform: AbstractTransform = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        if not self.lower < self.upper:
            raise InputError(
                f"parameter {self.name}: bounds {self.lower:g} to {self.upper:g}: the "
                "lower one must be less"
            )
        for value in self.start:
            if not self.lower < value < self.upper:
                raise InputError(
                    f"parameter {self.name}: starts at {value:g}, which is not between "
                    f"its bounds {self.lower:g} and {self.upper:g}"
                )
        moving = self.start[1:] if self.anchored else self.start
        start = np.asarray(moving[0] if self.is_scalar else moving)
        made = transform(start, self.lower, self.upper, self.soft)
        object.__setattr__(self, "transform", made)

    @property
    def size(self) -> int:
        """How many free numbers."""
        return len(self.start) - self.anchored

    @property
    def labels(self) -> tuple[str, ...]:
        """Of each number."""
        if self.is_scalar:
            return (self.name,)
        return tuple(f"{self.name}.{i + self.anchored}" for i in range(self.size))

    def value(self, z: Values) -> Float[Array, "*m"]:
        """What stands in the scene for free numbers."""
        found = jnp.asarray(self.transform.value(z))
        if not self.anchored:
            return found
        return jnp.concatenate([jnp.full(1, self.start[0], found.dtype), found])

    def free(self, value: Any) -> Float[Array, "*m"]:
        """The free numbers of what stands in a scene."""
        given = jnp.asarray(value)
        return jnp.asarray(self.transform.free(given[1:] if self.anchored else given))


@dataclass(frozen=True)
class ParameterSet:
    """All parameters of a fit.

    Raises:
        InputError: for two that set the same place.
    """

    parameters: tuple[Parameter, ...]

    def __post_init__(self):
        if not self.parameters:
            raise InputError("parameters: there is nothing to fit; name one at least")
        places = [place for p in self.parameters for place in (p.name, *p.also)]
        for place in places:
            if places.count(place) > 1:
                raise InputError(f"parameter {place}: it is there twice")

    @property
    def size(self) -> int:
        """Free numbers in all."""
        return sum(p.size for p in self.parameters)

    @property
    def labels(self) -> tuple[str, ...]:
        """Of each free number."""
        return tuple(label for p in self.parameters for label in p.labels)

    def check(self, scene: Scene) -> None:
        """Raise unless all of them are places of a scene."""
        for p in self.parameters:
            for name in (p.name, *p.also):
                find(scene, name)

    def split(self, z: Free) -> list[Values]:
        """Each parameter's part of the free numbers."""
        parts, first = [], 0
        for p in self.parameters:
            part = z[first : first + p.size]
            parts.append(part[0] if p.is_scalar else part)
            first += p.size
        return parts

    def values(self, z: Free) -> dict[str, Values]:
        """By name, what free numbers stand for."""
        z = jnp.asarray(z)
        pairs = zip(self.parameters, self.split(z), strict=True)
        return {p.name: p.value(part).astype(z.dtype) for p, part in pairs}

    def flat_values(self, z: Free) -> Float[Array, " p"]:
        """The same as one vector, in the order of `labels`."""
        values = self.values(z)
        parts = [jnp.atleast_1d(values[p.name]) for p in self.parameters]
        free = [
            part[1:] if p.anchored else part
            for p, part in zip(self.parameters, parts, strict=True)
        ]
        return jnp.concatenate(free)

    def free(self, values: dict[str, Any]) -> Float[Array, " p"]:
        """The free numbers of values by name."""
        parts = [jnp.atleast_1d(p.free(values[p.name])) for p in self.parameters]
        return jnp.concatenate(parts)

    def put(self, scene: Scene, z: Free) -> Scene:
        """The scene with the values of free numbers."""
        values = self.values(z)
        for p in self.parameters:
            # The whole of a list at once; names were checked when the fit was made.
            for name in (p.name, *p.also):
                scene = put(scene, find(scene, name), values[p.name])
        return scene

    def prior_misfit(self, z: Free) -> Float[Array, " q"]:
        """Of all parameters that have a prior, in standard deviations."""
        values = self.values(z)
        each = [
            jnp.atleast_1d(p.prior.misfit(values[p.name]))
            for p in self.parameters
            if p.prior is not None
        ]
        return jnp.concatenate(each) if each else jnp.zeros(0, z.dtype)

    def roughness(self, z: Free) -> Float[Array, " q"]:
        """Of all fields, in standard deviations."""
        values = self.values(z)
        each = [
            p.smoothness.misfit(values[p.name])
            for p in self.parameters
            if p.smoothness is not None
        ]
        return jnp.concatenate(each) if each else jnp.zeros(0, z.dtype)
