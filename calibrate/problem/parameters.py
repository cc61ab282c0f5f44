"""Fitted numbers of a scene with their bounds and priors.

A parameter sets one number of every scene of a fit, or several tied to the same value.
Together the parameters are one vector z of unconstrained coordinates, 0 at the start.

The path of a number, as in "bodies.0.structure.weights.within", consists of the fields
of the Python objects and of list indices; a body may be named instead of numbered, as
in "bodies.roof.temperature". `weights`, `material` and `temperature` stand
for those of a scene's only body, and a term may be named by its mechanism, as in
`sun.irradiance`. A layer of a sheet is that of all parts, as in
`sheet.layers.0.thickness`, or of some, as in `sheet.layers.glass_*.0.thickness`.
Numbers of frames, not of a scene, are in `config.frame_names`.
"""

import difflib
import functools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxthermo.arrays import precision
from jaxthermo.config.types.quantities import extreme_mistake
from jaxthermo.errors import InputError
from jaxthermo.geometry.part_names import pattern_of_parts
from jaxthermo.scene.scene import Scene, mechanism_names
from jaxthermo.structures.kinds.sheet import Sheet

from ..config.frame_names import REFLECTED, is_of_camera, is_of_frames
from ..config.scales import typical_size
from ..config.schema import is_temperature
from .bijections import Bijection, Values, bijection
from .frame_values import AS_GIVEN, FrameValues, poses_at


Path = tuple[str | int, ...]

_ABBREVIATIONS: dict[str, Path] = {
    "weights": ("bodies", 0, "structure", "weights"),
    "material": ("bodies", 0, "material"),
    "temperature": ("bodies", 0, "temperature"),
}
"""Short names in a scene of one body."""

_LAYER = re.compile(
    r"(?:bodies\.(?P<body>\d+)\.)?sheet\.layers\.(?:(?P<part>.+)\.)?"
    r"(?P<layer>\d+)\.(?P<field>\D.*)"
)

# The constructor's argument and the field that keeps it differ.
_FIELD_OF = {"absorptivity": "given_absorptivity"}


def find_path(scene: Scene, name: str) -> Path:
    """Resolve a dotted name in a scene, which must have such a number."""
    numbered = _numbered(scene, name)
    path: Path = tuple(int(p) if p.isdigit() else p for p in numbered.split("."))
    head, *tail = path
    if head in _ABBREVIATIONS:
        path = (*_ABBREVIATIONS[str(head)], *tail)
        if len(scene.bodies) > 1:
            raise InputError(
                f"parameter {name}: the scene has {len(scene.bodies)} bodies: say "
                f"which, as in {'.'.join(map(str, path))}"
            )
    elif head in (names := mechanism_names(scene)):
        path = ("terms", names.index(str(head)), *tail)
    path = tuple(_FIELD_OF.get(p, p) if isinstance(p, str) else p for p in path)
    node: Any = scene
    for depth, step in enumerate(path):
        children = _children(node)
        if step not in children:
            parent = ".".join(map(str, path[:depth])) or "a scene"
            close = difflib.get_close_matches(str(step), map(str, children), 1)
            hint = f"; did you mean '{close[0]}'?" if close else ""
            listed = ", ".join(map(str, children)) or "nothing to be fitted"
            raise InputError(
                f"parameter {name}: {parent} has no '{step}'{hint} (it has {listed})"
            )
        node = _child(node, step)
    if _children(node):
        listed = ", ".join(map(str, _children(node)))
        raise InputError(f"parameter {name}: name one of its parts: {listed}")
    return path


def find_paths(scene: Scene, name: str) -> tuple[Path, ...]:
    """Resolve a dotted name to the paths of everything in a scene that it names.

    One path, but one for each part for a layer of a sheet with parts.

    Raises:
        InputError: for a name of no number of the scene.
    """
    match = _LAYER.fullmatch(_numbered(scene, name))
    if match is None:
        return (find_path(scene, name),)
    if match["body"] is None and len(scene.bodies) > 1:
        raise InputError(
            f"parameter {name}: the scene has {len(scene.bodies)} bodies: say which, "
            f"as in bodies.0.{name}"
        )
    number = int(match["body"] or 0)
    sheet = scene.bodies[number].structure if number < len(scene.bodies) else None
    if not isinstance(sheet, Sheet):
        raise InputError(f"parameter {name}: there is no sheet of body {number}")
    names = list(sheet.grid.part_names)
    pattern = match["part"]
    parts = range(len(sheet.stacks))
    if pattern is not None:
        patterns = pattern_of_parts(names, [pattern, "*"], f"parameter {name}")
        parts = [n for n, part in enumerate(names) if patterns[part] == pattern]
    body = f"bodies.{number}.structure.stacks"
    layer = f"{match['layer']}.{match['field']}"
    return tuple(find_path(scene, f"{body}.{part}.{layer}") for part in parts)


def _numbered(scene: Scene, name: str) -> str:
    """A dotted name with the number of a body for its name, which may have dots."""
    start = "bodies."
    if not name.startswith(start):
        return name
    remaining = name.removeprefix(start)
    names = {body.name: n for n, body in enumerate(scene.bodies) if body.name}
    # The longest first: "door.left" before "door".
    for body_name in sorted(names, key=len, reverse=True):
        if remaining.startswith(f"{body_name}."):
            inner = remaining.removeprefix(f"{body_name}.")
            return f"{start}{names[body_name]}.{inner}"
    return name


def value_at(scene: Scene, path: Path) -> Any:
    """Value at a path."""
    return functools.reduce(_child, path, scene)


def with_values(scene: Scene, values: Mapping[Path, Any]) -> Scene:
    """Copy of the scene with other values at some paths."""
    return eqx.tree_at(
        lambda scene: [value_at(scene, path) for path in values],
        scene,
        list(values.values()),
        # A value of None is no leaf by default, and could not be replaced.
        is_leaf=lambda leaf: leaf is None,
    )


def _child(node: Any, step: str | int) -> Any:
    return node[step] if isinstance(step, int) else getattr(node, step)


def _children(node: Any) -> tuple[str | int, ...]:
    if isinstance(node, list | tuple):
        return tuple(range(len(node)))
    if not is_dataclass(node):
        return ()
    # Static fields are compiled into the program and cannot be fitted.
    return tuple(f.name for f in fields(node) if not f.metadata.get("static", False))


Coordinates = Float[Array | np.ndarray, " p"]
"""Unconstrained coordinates of all parameters, 0 at the start."""


@dataclass(frozen=True)
class Prior:
    """Normal prior of a value, or of its logarithm where `log_normal`."""

    mean: float
    sd: float
    """Standard deviation of the value, or of its logarithm."""
    log_normal: bool = False

    def __post_init__(self):
        if not 0 < self.sd < math.inf:
            raise InputError(
                f"Prior(sd={self.sd}): give a positive, finite standard deviation"
            )
        lowest = 0.0 if self.log_normal else -math.inf
        if not lowest < self.mean < math.inf:
            kind = "positive" if self.log_normal else "finite"
            raise InputError(f"Prior(mean={self.mean}): give a {kind} number")

    def residual(self, value: Values) -> Values:
        """(value - mean) / sd, or (log value - log mean) / sd."""
        if self.log_normal:
            return (jnp.log(jnp.asarray(value)) - math.log(self.mean)) / self.sd
        return (jnp.asarray(value) - self.mean) / self.sd


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
        # A link has an end at both of its nodes.
        ends = np.concatenate([self.src, self.dst])
        logs = jnp.concatenate([jnp.log(value), jnp.log(value)])
        nodes = int(ends.max()) + 1
        count = np.maximum(np.bincount(ends, minlength=nodes), 1).astype(logs.dtype)
        mean = jax.ops.segment_sum(logs, jnp.asarray(ends), nodes) / count
        return (logs - mean[ends]) / (self.sd * math.sqrt(len(ends)))


@dataclass(frozen=True)
class Parameter:
    """A number, or a list of them, at one or several paths of a scene."""

    name: str
    """Dotted path."""
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
        if self.prior is not None and self.prior.log_normal and self.lower < 0:
            raise InputError(
                f"parameter {self.name}: the prior is log-normal, and the lower bound "
                f"{self.lower:g} has no logarithm: give bounds of 0 or more"
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
        chosen_bijection = bijection(
            start,
            lower=self.lower,
            upper=self.upper,
            typical_size=typical_size(self.name),
            softplus=self.softplus,
        )
        # The dataclass is frozen.
        object.__setattr__(self, "bijection", chosen_bijection)

    def check_temperatures(self) -> None:
        """Refuse extreme temperatures of a start, a finite bound or a prior.

        Raises:
            InputError: naming the number and a remedy.
        """
        numbers = [("start", value) for value in self.start]
        numbers += [("bounds", bound) for bound in (self.lower, self.upper)]
        if self.prior is not None:
            numbers.append(("prior: mean", self.prior.mean))
        for key, kelvin in numbers:
            mistake = extreme_mistake(kelvin) if math.isfinite(kelvin) else ""
            if mistake:
                raise InputError(f"parameter {self.name}: {key}: {mistake}")

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
    """All parameters of a fit."""

    parameters: tuple[Parameter, ...]

    def __post_init__(self):
        if not self.parameters:
            raise InputError("parameters: there is nothing to fit; name one at least")
        # Tied paths count too: the later of two parameters would win in silence.
        for path in self.paths:
            if self.paths.count(path) > 1:
                raise InputError(f"parameter {path}: it is there twice")

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return sum(p.size for p in self.parameters)

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of each coordinate."""
        return tuple(label for p in self.parameters for label in p.labels)

    @property
    def paths(self) -> tuple[str, ...]:
        """Names of everything that takes a value."""
        return tuple(path for p in self.parameters for path in p.paths)

    @property
    def moves_cameras(self) -> bool:
        """True if poses of cameras are fitted."""
        return any(map(is_of_camera, self.paths))

    def check(self, scene: Scene) -> None:
        """Check paths, and temperatures as the scene checks its own.

        Raises:
            InputError: for a path that neither the scene nor its frames have, for two
                names of one number, or for an extreme temperature of a start, bound or
                prior.
        """
        names: dict[Path, str] = {}
        for name in self.paths:
            if is_of_frames(name):
                continue
            for path in find_paths(scene, name):
                first_name = names.setdefault(path, name)
                if first_name != name:
                    raise InputError(
                        f"parameter {name}: it is {first_name} too: leave one of them "
                        "out"
                    )
        if scene.allow_extreme_temperatures:
            return
        for parameter in self.parameters:
            if is_temperature(parameter.name):
                parameter.check_temperatures()

    def values(self, z: Coordinates) -> dict[str, Values]:
        """Values by parameter name."""
        z = jnp.asarray(z)
        values = {}
        first = 0
        for p in self.parameters:
            coordinates = z[first : first + p.size]
            value = p.bijection.value(coordinates[0] if p.is_scalar else coordinates)
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
        arrays = [jnp.atleast_1d(values[p.name]) for p in self.parameters]
        pairs = zip(self.parameters, arrays, strict=True)
        return jnp.concatenate([v[1:] if p.first_is_fixed else v for p, v in pairs])

    def coordinates(self, values: Mapping[str, Any]) -> Float[Array, " p"]:
        """Coordinates of values by parameter name."""
        arrays = [jnp.atleast_1d(p.coordinate(values[p.name])) for p in self.parameters]
        return jnp.concatenate(arrays)

    def insert(self, scene: Scene, z: Coordinates) -> Scene:
        """Copy of the scene with the values of the coordinates z."""
        # Runs when a program is traced, not at each evaluation.
        values = self._by_path(z).items()
        scene_values = {
            path: value
            for name, value in values
            if not is_of_frames(name)
            for path in find_paths(scene, name)
        }
        return with_values(scene, scene_values) if scene_values else scene

    def coordinates_of(self, scene: Scene) -> Float[np.ndarray, " p"]:
        """Coordinates of a scene's own values; those of the start in its frames.

        A value at a bound has an infinite one; of a value beyond, it is that of the
        bound.
        """
        rows = []
        with precision("float64"), np.errstate(divide="ignore"):
            for p in self.parameters:
                start = np.asarray(p.start)
                value = (
                    None
                    if is_of_frames(p.name)
                    else value_at(scene, find_paths(scene, p.name)[0])
                )
                if value is None or callable(value):
                    value = start
                clipped = np.clip(np.asarray(value, float), p.lower, p.upper)
                clipped = np.broadcast_to(clipped, start.shape)
                z = p.coordinate(clipped[0] if p.is_scalar else clipped)
                is_start = (clipped == start)[len(start) - p.size :]
                rows.append(np.where(is_start, 0.0, np.atleast_1d(z)))
        return np.concatenate(rows)

    def frame_values(self, z: Coordinates, views: Any = ()) -> FrameValues:
        """Values of frames at z.

        `views` holds the cameras' views near these poses; by default they do not move.
        """
        values = self._by_path(z)
        poses = self.poses(z, len(views)) if views else AS_GIVEN.poses
        reflected = values.get(REFLECTED)
        kelvin = None if reflected is None else jnp.asarray(reflected)
        return FrameValues(poses=poses, views=views, reflected=kelvin)

    def poses(self, z: Coordinates, cameras: int) -> Float[Array, "v 6"]:
        """Poses of that many cameras."""
        return poses_at(self._by_path(z), cameras, jnp.asarray(z).dtype)

    def start_poses(self, cameras: int) -> Float[np.ndarray, "v 6"]:
        """Poses of that many cameras at the start values, on the host."""
        return np.asarray(self.poses(np.zeros(self.size), cameras), float)

    def _by_path(self, z: Coordinates) -> dict[str, Values]:
        values = self.values(z)
        return {n: values[p.name] for p in self.parameters for n in p.paths}

    def prior_residual(
        self, z: Coordinates, penalty: Literal["prior", "smoothness"]
    ) -> Float[Array, " q"]:
        """Deviations from the priors, or of neighbouring links' weights [sd]."""
        values = self.values(z)
        terms = ((getattr(p, penalty), values[p.name]) for p in self.parameters)
        rows = [jnp.atleast_1d(term.residual(v)) for term, v in terms if term]
        return jnp.concatenate(rows) if rows else jnp.zeros(0, z.dtype)
