"""The live view in a browser: a loop that simulates, colours and sends frames.

The loop runs in the thread that calls it, and alone changes what is shown; callbacks of
widgets only put requests into its queue. Without a browser the simulation waits.
"""

import contextlib
import io
import queue
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import viser

from ..config.schema.scene import SceneConfig
from ..constants import ZERO_CELSIUS
from ..errors import InputError
from ..image.colour.palette import BACKGROUND, apply_palette
from .controls import Controls
from .hand_values import hand_values
from .live_camera import LiveCamera
from .live_run import AbstractLiveRun
from .panels import RunStatus
from .playback import Playback
from .player import FRAME, Player
from .scale import Scale, scale_of
from .scene_view import SERIES, SceneView
from .session import LiveSession
from .surface_points import surface_points


# Time between two lines of status, and between frames of the detector and curves [s].
_STATUS_EVERY = 0.25
_SIDE_EVERY = 0.3


class LiveView:
    """The page of a simulation or a finished run, and requests from it."""

    def __init__(
        self,
        server: viser.ViserServer,
        run: AbstractLiveRun,
        config: SceneConfig,
        rate: float,
    ):
        self._server = server
        self._run = run
        self._player = Player(run, rate)
        self._asked: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
        self._detector = LiveCamera(config, run.surfaces)
        self._fixed = False
        self._note = ""
        self._compiling = ""
        points = surface_points(run.surfaces)
        self._view = SceneView(
            server=server, run=run, points=points, camera=self._detector.camera
        )
        kelvin = points.temperature(run.temperature)
        image = config.image
        self._scale = scale_of(kelvin, image.palette)
        if image.low is not None and image.high is not None:
            self._scale = Scale(image.low, image.high, image.palette)
        self._seen: Scale | None = None
        self._probes: list[int] = []
        self._controls = Controls(
            server,
            ask=self.ask,
            rate=rate,
            scale=self._scale,
            quantity=self._detector.quantity,
            run=run,
        )
        if isinstance(run, LiveSession):
            self._controls.add_values(hand_values(config))
            self._controls.add_structures(_factor(config))
        self._said = -1.0
        self._drawn = -1.0
        self._changed = True
        server.scene.on_click()(self._clicked)
        self._controls.show_scale(self._scale)
        self._draw(everything=True)
        self._controls.add_probe_help()
        self._say()

    def ask(self, request: str, value: Any) -> None:
        """Put a request into the queue, from any thread."""
        self._asked.put((request, value))

    def step(self, clock: float) -> None:
        """Do what was requested, and show the next frame, at a reading of a clock."""
        for request, value in self._requests():
            self._note = ""
            try:
                self._do(request, value)
            except InputError as error:
                self._note = " ".join(str(error).split())
            self._changed = True
            self._said = -1.0
        if not self._server.get_clients():
            # Nobody looks: the simulation waits.
            self._player.jumped()
            self._changed = True
            return
        moved = self._player.tick(clock)
        if moved or self._changed:
            stale = clock - self._drawn > _SIDE_EVERY
            self._draw(everything=stale or self._changed)
            self._drawn = clock if stale or self._changed else self._drawn
            self._changed = False
        if clock - self._said > _STATUS_EVERY:
            self._say()
            self._said = clock

    def run(self, stopped: Callable[[], bool]) -> None:
        """Show frames until `stopped` is true."""
        while not stopped():
            begin = time.perf_counter()
            self.step(begin)
            time.sleep(max(0.001, FRAME - (time.perf_counter() - begin)))

    def _requests(self) -> list[tuple[str, Any]]:
        """Requests since the last frame; of a slider that moved on, the last one."""
        pending: dict[Any, tuple[str, Any]] = {}
        while True:
            try:
                request, value = self._asked.get_nowait()
            except queue.Empty:
                return list(pending.values())
            key = (request, value[0]) if request == "value" else request
            if request in ("toggle", "probe"):
                key = (request, len(pending))
            pending.pop(key, None)
            pending[key] = request, value

    def _do(self, request: str, value: Any) -> None:
        player = self._player
        run = self._run
        match request:
            case "toggle" if player.playing:
                player.pause()
            case "toggle":
                player.play()
            case "reset":
                player.reset()
                self._forget_range()
            case "rate":
                player.set_rate(value)
                if isinstance(run, LiveSession):
                    run.set_rate(value)
                player.jumped()
            case "seek" if isinstance(run, Playback):
                run.seek(value)
                player.jumped()
            case "value":
                self._change({value[0]: value[1]})
            case "structure":
                bodies = range(len(run.surfaces))
                changes = {f"bodies.{n}.structure": value for n in bodies}
                self._change(changes, builds=True)
            case "palette":
                self._scale = self._scale._replace(palette=value)
                self._controls.show_scale(self._scale)
            case "fixed":
                self._fixed = value
                self._forget_range()
            case "low" | "high":
                self._set_end(request, value)
            case "probe":
                self._add_probe(*value)
            case "unprobe":
                self._probes = []
                self._view.mark([])

    def _change(self, changes: dict[str, str | None], builds: bool = False) -> None:
        session = self._run
        assert isinstance(session, LiveSession)
        if builds:
            self._announce("compiling: the bodies are built again")
        change = session.prepare(changes)
        if change.compiles:
            reason = "steps of the new bodies" if builds else "other mechanisms act now"
            self._announce(f"compiling: {reason}")
        session.use(change)
        self._compiling = ""
        self._player.jumped()
        self._view.show_terms(session)

    def _announce(self, text: str) -> None:
        # Sent at once: what follows takes seconds.
        self._compiling = text
        self._say()
        self._server.flush()

    def _forget_range(self) -> None:
        """Fit the colours to the current temperatures, unless they are set by hand."""
        if not self._fixed:
            kelvin = self._view.points.temperature(self._run.temperature)
            self._scale = scale_of(kelvin, self._scale.palette)
            self._seen = None
            self._controls.show_scale(self._scale)

    def _set_end(self, which: str, celsius: float) -> None:
        ends = {which: celsius + ZERO_CELSIUS}
        scale = self._scale._replace(**ends)
        if not scale.low < scale.high:
            self._controls.show_scale(self._scale)
            raise InputError("colours: give a low end below the high one")
        self._scale = scale
        self._fixed = True
        self._controls.show_scale(scale, fixed=True)

    def _add_probe(self, origin: Any, direction: Any) -> None:
        point = self._view.pick(
            self._run,
            origin=np.asarray(origin, float),
            direction=np.asarray(direction, float),
        )
        if point is None:
            return
        self._probes = [*self._probes, point][-len(SERIES) :]
        self._view.mark(self._probes)

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        self.ask("probe", (event.ray_origin, event.ray_direction))

    def _draw(self, everything: bool) -> None:
        """Colour the bodies; with `everything` the camera's frame and curves too."""
        kelvin = self._view.points.temperature(self._run.temperature)
        if not np.isfinite(kelvin).all():
            self._player.pause()
            raise InputError("temperatures are not finite: check the terms")
        scale = self._scale if self._fixed else self._scale.holding(kelvin)
        if scale != self._scale:
            self._scale = scale
            self._controls.show_scale(scale)
        self._view.show(self._run, kelvin, scale)
        if everything:
            self._draw_frame()
            self._draw_curves()

    def _draw_frame(self) -> None:
        kelvin = self._detector.frame(self._run)
        palette = self._scale.palette
        # A camera shows reflections too: it has a scale of its own.
        previous = self._seen or scale_of(kelvin, palette)
        seen = self._scale if self._fixed else previous.holding(kelvin)
        self._seen = seen._replace(palette=palette)
        coloured = apply_palette(kelvin, *self._seen, invalid=BACKGROUND)
        self._controls.show_camera(coloured, self._seen)

    def _draw_curves(self) -> None:
        if not self._probes:
            self._controls.hide_curves()
            return
        curves = self._run.curves(self._view.points.weights[self._probes])
        if len(curves.times) < 2:
            # A point is no curve.
            self._controls.hide_curves()
            return
        names = [f"probe {n + 1}" for n in range(len(self._probes))]
        self._controls.show_curves(curves, names)

    def _say(self) -> None:
        player = self._player
        run = self._run
        state = "paused"
        if player.playing:
            state = "running"
        elif run.finished:
            state = "at the end"
        simulated, frames = player.speeds() or (None, None)
        status = RunStatus(
            time=run.time,
            end=run.end,
            state=state,
            simulated=simulated,
            frames=frames,
            note=self._compiling or self._note,
        )
        self._controls.show_status(status, player.playing)


def _factor(config: SceneConfig) -> int:
    return int(getattr(config.bodies[0].structure, "factor", None) or 4)


@contextmanager
def serving(host: str, port: int) -> Iterator[viser.ViserServer]:
    """A server on a port, or on the next one that is free; closed at the end.

    Raises:
        InputError: for a host or port that cannot be listened on.
    """
    if not 0 <= port <= 65535:
        raise InputError(f"--port {port}: give a number from 0 to 65535")
    try:
        family, *_, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.bind(address)
    except OSError as error:
        raise InputError(
            f"--host {host}: cannot listen there ({error.strerror}); leave it out for "
            "this computer alone, or give 0.0.0.0 for others too"
        ) from error
    # It prints its address in a box, and that it has stopped.
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host, port, label="jaxthermo", verbose=False)
    try:
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()
