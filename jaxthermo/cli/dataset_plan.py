"""Variations and views of a dataset, all checked before anything is simulated."""

import hashlib
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..archive import text_hash
from ..config.camera_framing import build_camera
from ..config.loader import config_hash, load_config, resolved
from ..config.schema.body import BodyConfig
from ..config.schema.dataset import (
    DatasetConfig,
    KeypointConfig,
    OrbitConfig,
    PathConfig,
)
from ..config.schema.image import CameraConfig, PinholeConfig
from ..config.schema.scene import SceneConfig
from ..errors import InputError, located
from ..image.files.keypoints import BodyPoint
from ..image.surface.visible import WorldMesh, visible_points
from ..temperatures import ALLOW_EXTREME


# More frames than this are a mistake in a list.
_MAX_FRAMES = 1_000_000
# Default distances of cameras, relative to that at which the bodies fill the view.
_NEAR = 1.0
_FAR = 1.5
_MARGIN = 1.06


class _Variation(NamedTuple):
    """One run of the scene."""

    name: str
    changes: Mapping[str, object]
    """Values by dotted key that distinguish this run from the others."""
    config: SceneConfig


class DatasetPlan(NamedTuple):
    """All runs of a dataset, and the cameras that see all of them."""

    config: DatasetConfig
    variations: list[_Variation]
    views: list[CameraConfig]
    categories: list[str]
    """Class of every body."""
    keypoints: list[BodyPoint]

    def frames_of(self, variation: _Variation) -> int:
        """Number of frames of a variation."""
        config = variation.config
        times = config.image.frames or config.time.save_times
        return len(self.views) * len(times)

    @property
    def validation(self) -> frozenset[str]:
        """Names of the variations whose frames are for validation."""
        fraction = self.config.validation
        if fraction is None:
            return frozenset()
        total = len(self.variations)
        count = min(max(1, round(fraction * total)), total - 1)
        order = np.random.default_rng([self.config.seed, 2]).permutation(total)
        return frozenset(self.variations[number].name for number in order[:count])

    def scene(self, variation: int, view: int) -> SceneConfig:
        """Config of the frames of a variation in a view."""
        config = self.variations[variation].config
        key = [self.config.seed, variation, view]
        (seed,) = np.random.SeedSequence(key).generate_state(1).tolist()
        # With a common seed all frames of a time would have the same noise.
        effects = tuple(_with_seed(effect, seed) for effect in config.image.effects)
        image = config.image.model_copy(update={"effects": effects})
        return config.model_copy(update={"camera": self.views[view], "image": image})

    @property
    def digest(self) -> str:
        """Hash of all that the files depend on [16 hex digits]."""
        texts = [config_hash(variation.config) for variation in self.variations]
        settings = resolved(self.config) | {"scene": ""}
        views = [view.model_dump(mode="json") for view in self.views]
        text = json.dumps([texts, settings, views], sort_keys=True, default=str)
        return text_hash(text)


def _with_seed(effect: Any, seed: int) -> Any:
    """A detector's noise with another seed; other effects as they are."""
    if effect.kind != "detector_noise":
        return effect
    return effect.model_copy(update={"seed": seed})


def plan_dataset(config: DatasetConfig) -> DatasetPlan:
    """Make all variations and views, and check that every camera sees a body.

    Raises:
        InputError: for a change that the scene cannot have, a camera that sees nothing,
            or too few or many names of classes.
    """
    variations = _variations(config)
    first = variations[0].config
    categories = list(config.categories or (body.label for body in first.bodies))
    for variation in variations:
        if len(categories) != len(variation.config.bodies):
            raise InputError(
                f"categories: {len(categories)} names, and {variation.name} of the "
                f"scene has {len(variation.config.bodies)} bodies: give one for each"
            )
    world = [_world(body, 0.0) for body in first.bodies]
    corners = np.concatenate([body.vertices[body.faces] for body in world])
    if config.validation is not None and len(variations) < 2:
        raise InputError(
            "validation: a set of its own needs another run: give variations or ranges"
        )
    views = list(config.views or ())
    if config.orbit is not None:
        views = _orbit(config.orbit, corners.reshape(-1, 3), config.seed)
    if config.path is not None:
        views = _path(config.path, corners.reshape(-1, 3))
    plan = DatasetPlan(
        config=config,
        variations=variations,
        views=views,
        categories=categories,
        keypoints=_keypoints(config.keypoints, first.bodies),
    )
    if sum(map(plan.frames_of, variations)) > _MAX_FRAMES:
        raise InputError(f"a dataset of more than {_MAX_FRAMES:,} frames: give less")
    _check_views(plan)
    return plan


def _variations(config: DatasetConfig) -> list[_Variation]:
    generator = np.random.default_rng([config.seed, 0])
    variations = []
    for values in itertools.product(*config.variations.values()):
        for _ in range(config.samples):
            changes = dict(zip(config.variations, values, strict=True))
            for name in config.ranges:
                low, high = config.range_of(name)
                # Six digits: a reader can type them again.
                changes[name] = float(f"{generator.uniform(low, high):.6g}")
            # One option for both files.
            allowed = {ALLOW_EXTREME: True} if config.allow_extreme_temperatures else {}
            changed_values = allowed | config.set | changes
            texts = [
                f"{key}={json.dumps(value)}" for key, value in changed_values.items()
            ]
            if config.times is not None:
                texts.append(f"image.frames={json.dumps(config.times)}")
            scene = load_config(config.scene, texts)
            name = f"v{len(variations):04d}"
            variations.append(_Variation(name=name, changes=changes, config=scene))
    return variations


def _keypoints(
    keypoints: Mapping[str, KeypointConfig], bodies: Sequence[BodyConfig]
) -> list[BodyPoint]:
    points = []
    for name, keypoint in keypoints.items():
        named = [n for n, body in enumerate(bodies) if body.label == keypoint.body]
        if isinstance(keypoint.body, int):
            named = [keypoint.body] if keypoint.body < len(bodies) else []
        if len(named) != 1:
            labels = ", ".join(dict.fromkeys(body.label for body in bodies))
            raise InputError(
                f"keypoints.{name}.body: {keypoint.body!r} is not one body: give a "
                f"number below {len(bodies)}, or a name that one of them has; there "
                f"are {labels}"
            )
        points.append(BodyPoint(name, body=named[0], position=keypoint.position))
    return points


def _centre(
    look_at: tuple[float, float, float] | None, corners: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "3"]:
    """Point that cameras look at [m], by default the middle of the bodies."""
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    return np.asarray(middle if look_at is None else look_at)


def _path(path: PathConfig, corners: Float[np.ndarray, "n 3"]) -> list[CameraConfig]:
    """Cameras at equal distances along the line of the path."""
    centre = _centre(path.look_at, corners)
    points = np.asarray(path.points)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.append(0.0, np.cumsum(lengths))
    places = np.linspace(0.0, along[-1], path.count)
    positions = np.stack([np.interp(places, along, axis) for axis in points.T], axis=1)
    return [
        PinholeConfig(
            position=_point(position),
            look_at=_point(centre),
            field_of_view=path.field_of_view,
            width=path.width,
            height=path.height,
        )
        for position in positions
    ]


def _orbit(
    orbit: OrbitConfig, corners: Float[np.ndarray, "n 3"], seed: int
) -> list[CameraConfig]:
    """Cameras at random points, uniform on the sphere between the elevations."""
    centre = _centre(orbit.look_at, corners)
    radius = _MARGIN * float(np.linalg.norm(corners - centre, axis=1).max())
    aspect = min(1.0, orbit.width / orbit.height)
    half_angle = math.atan(math.tan(orbit.field_of_view / 2) * aspect)
    fitting = radius / math.sin(half_angle)
    near, far = orbit.distance or (_NEAR * fitting, _FAR * fitting)
    low, high = (math.sin(angle) for angle in orbit.elevation)
    generator = np.random.default_rng([seed, 1])
    cameras = []
    for _ in range(orbit.count):
        sine = generator.uniform(low, high)
        distance = generator.uniform(near, far)
        azimuth = generator.uniform(*orbit.azimuth)
        cosine = math.sqrt(1 - sine**2)
        direction = np.array(
            [cosine * math.cos(azimuth), cosine * math.sin(azimuth), sine]
        )
        cameras.append(
            PinholeConfig(
                position=_point(centre + distance * direction),
                look_at=_point(centre),
                field_of_view=orbit.field_of_view,
                width=orbit.width,
                height=orbit.height,
            )
        )
    return cameras


def _point(values: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    x, y, z = (float(f"{value:.6g}") for value in values.tolist())
    return x, y, z


def _world(body: BodyConfig, time: float) -> WorldMesh:
    """Mesh of a body in the world at a time [s]."""
    mesh = body.build_grid().mesh if body.solid is not None else body.build_mesh()
    vertices = body.build_pose().at(time).to_world(mesh.vertices)
    return WorldMesh(vertices, mesh.faces, is_two_sided=body.wall is not None)


def _check_views(plan: DatasetPlan) -> None:
    seen = set()
    for variation in plan.variations:
        config = variation.config
        # Most variations have the same bodies at the same places.
        times = config.image.frames or config.time.save_times
        bodies = [body.model_dump_json() for body in config.bodies]
        key = hashlib.sha256(repr((bodies, times)).encode()).digest()
        if key in seen:
            continue
        seen.add(key)
        moves = any(hasattr(body.pose, "times") for body in config.bodies)
        start = tuple(_world(body, 0.0) for body in config.bodies)
        triangles = np.concatenate([body.vertices[body.faces] for body in start])
        for time in (0.0, *times) if moves else (0.0,):
            world = start if time == 0 else None
            world = world or tuple(_world(body, time) for body in config.bodies)
            for number, view in enumerate(plan.views):
                moment = f" at {time:g} s" if moves else ""
                name = next(
                    kind
                    for kind in ("orbit", "path", "views")
                    if getattr(plan.config, kind) is not None
                )
                with located(f"{name}.{number}, {variation.name}{moment}"):
                    visible_points(world, build_camera(view, triangles))
