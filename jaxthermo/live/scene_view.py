"""The 3-D part of the live view: coloured bodies, arrows of sun and wind, probes."""

import math

import numpy as np
import viser
from jaxtyping import Float
from viser.transforms import SO3

from ..image.surface.abstract_camera import AbstractCamera
from ..physics.convection.wind import Wind
from ..physics.radiation.source import Sun
from ..physics.term import AbstractTerm
from ..physics.time_varying import value_at
from ..scene.scene import SolvedSurface
from .live_run import AbstractLiveRun
from .scale import Scale
from .surface_points import SurfacePoints, colours, point_on_ray


SERIES = ((232, 89, 12), (28, 126, 214), (47, 158, 68), (156, 54, 181))
"""sRGB colours of the probes, whose number they limit."""

_SUN = (250, 176, 5)
_WIND = (116, 192, 252)
# Vertical angle of the view of a parallel camera [rad].
_FIELD_OF_VIEW = 0.6
# Distance of the view over that of the scene's camera: the arrows are in it.
_BACK = 1.15
# Length of an arrow, and its distance from the centre, over the radius of the bodies.
_ARROW = 0.35
_AWAY = 1.2


class SceneView:
    """Nodes of the bodies in a server, which it updates."""

    def __init__(
        self,
        server: viser.ViserServer,
        run: AbstractLiveRun,
        points: SurfacePoints,
        camera: AbstractCamera,
    ):
        self._server = server
        self.points = points
        self._frames = []
        self._clouds = []
        scene = server.scene
        scene.set_up_direction("+z")
        # Points show their colours as they are: light is for arrows and probes alone.
        # An environment that lights them, and its shadows, keep a browser without a
        # graphics processor busy for long.
        scene.configure_environment_map(None)
        scene.configure_default_lights(cast_shadow=False)
        scene.add_light_ambient("/light", intensity=2.0)
        world = self._world(run)
        corners = np.stack([world.min(axis=0), world.max(axis=0)])
        self._centre = corners.mean(axis=0)
        self._radius = float(np.linalg.norm(corners[1] - corners[0]) / 2)
        self._paths = [_path_of(n, surface) for n, surface in enumerate(run.surfaces)]
        for name, position in zip(self._paths, points.position, strict=True):
            self._frames.append(scene.add_frame(name, show_axes=False))
            grey = np.full(position.shape, 128, np.uint8)
            cloud = scene.add_point_cloud(
                f"{name}/surface",
                position,
                grey,
                point_size=points.diameter,
                point_shape="circle",
                point_shading="flat",
                precision="float32",
            )
            self._clouds.append(cloud)
        self._place(run)
        start = server.initial_camera
        away = np.subtract(camera.position, camera.look_at)
        start.look_at = camera.look_at
        start.position = camera.look_at + _BACK * away
        start.fov = getattr(camera, "field_of_view", _FIELD_OF_VIEW)
        start.near = self._radius / 100
        start.far = self._radius * 100
        self._marks: list[viser.SceneNodeHandle] = []
        self._arrows: list[tuple[viser.SceneNodeHandle, AbstractTerm]] = []
        self.show_terms(run)

    def show(
        self, run: AbstractLiveRun, kelvin: Float[np.ndarray, " p"], scale: Scale
    ) -> None:
        """Colour the points by their temperatures [K]; move bodies that move."""
        coloured = colours(kelvin, *scale)
        with self._server.atomic():
            for cloud, rows in zip(self._clouds, self.points.rows, strict=True):
                cloud.colors = coloured[rows]
            if any(surface.moves for surface in run.surfaces):
                self._place(run)
            self._hide_suns_that_are_off(run.time)

    def show_terms(self, run: AbstractLiveRun) -> None:
        """Draw the directions of sun and wind as arrows."""
        for arrow, _ in self._arrows:
            arrow.remove()
        self._arrows = []
        for n, term in enumerate(run.terms):
            if isinstance(term, Sun) and not callable(term.direction):
                arrow = self._arrow("sun", n, np.asarray(term.direction), _SUN)
                self._arrows.append((arrow, term))
            elif isinstance(term, Wind):
                arrow = self._arrow("wind", n, np.asarray(term.velocity), _WIND)
                self._arrows.append((arrow, term))
        self._hide_suns_that_are_off(run.time)

    def _hide_suns_that_are_off(self, time: float) -> None:
        for arrow, term in self._arrows:
            if isinstance(term, Sun):
                shines = bool(value_at(term.strength, np.asarray(time)) > 0)
                if arrow.visible != shines:
                    arrow.visible = shines

    def pick(
        self,
        run: AbstractLiveRun,
        origin: Float[np.ndarray, " 3"],
        direction: Float[np.ndarray, " 3"],
    ) -> int | None:
        """Point that a ray hits first; None if it misses the bodies."""
        radius = self.points.diameter / 2
        return point_on_ray(
            self._world(run), origin=origin, direction=direction, radius=radius
        )

    def mark(self, points: list[int]) -> None:
        """Mark the probes, in the order of their colours."""
        for mark in self._marks:
            mark.remove()
        self._marks = []
        rows = self.points.rows
        for n, point in enumerate(points):
            body = self.points.body_of(point)
            position = self.points.position[body][point - rows[body].start]
            mark = self._server.scene.add_icosphere(
                f"{self._paths[body]}/probe{n}",
                radius=self._radius / 40,
                color=SERIES[n],
                position=position,
                cast_shadow=False,
                receive_shadow=False,
            )
            self._marks.append(mark)

    def _arrow(
        self, name: str, number: int, along: np.ndarray, colour: tuple
    ) -> viser.SceneNodeHandle:
        ahead = along / (math.hypot(*along) or 1.0)
        ends = [
            self._centre - self._radius * far * ahead for far in (_AWAY, _AWAY - _ARROW)
        ]
        path = f"/{name}{number}"
        arrow = self._server.scene.add_arrows(
            path,
            np.asarray([ends]),
            colour,
            shaft_radius=self._radius / 80,
            head_radius=self._radius / 30,
            head_length=self._radius / 8,
        )
        # Below the arrow, with which it is removed and hidden.
        self._server.scene.add_label(f"{path}/name", name, position=ends[0])
        return arrow

    def _place(self, run: AbstractLiveRun) -> None:
        for frame, surface in zip(self._frames, run.surfaces, strict=True):
            pose = _pose(surface, run.time)
            frame.wxyz = SO3.from_matrix(np.asarray(pose.rotation)).wxyz
            frame.position = pose.translation

    def _world(self, run: AbstractLiveRun) -> Float[np.ndarray, "p 3"]:
        pairs = zip(self.points.position, run.surfaces, strict=True)
        return np.concatenate([_pose(s, run.time).to_world(p) for p, s in pairs])


def _path_of(number: int, surface: SolvedSurface) -> str:
    """Path of a body among the nodes of the browser, whose names have no "/"."""
    name = surface.geometry.name.replace("/", "_")
    return f"/{number} {name}" if name else f"/body{number}"


def _pose(surface: SolvedSurface, time: float):
    return surface.geometry.pose.at(time)
