"""`jaxthermo view` and `jaxthermo play`: a scene, or a finished run, in a browser."""

from pathlib import Path

import viser

from ..arrays import precision
from ..config.loader import load_config
from ..config.schema.scene import SceneConfig
from ..console.terminal import open_console, patient_interrupt, print_line, status
from ..integrate.run.solution_file import load_run
from ..live.live_run import AbstractLiveRun
from ..live.playback import Playback
from ..live.server import LiveView, serving
from ..live.session import LiveSession
from .frames import finished_config


def view(
    config: Path, overrides: tuple[str, ...], host: str, port: int, rate: float
) -> None:
    """Simulate a scene in a browser until Ctrl-C."""
    load_config(config, overrides)
    with serving(host, port) as server, status(open_console(), "building the scene"):
        session = LiveSession(config, overrides, rate)
        _show(server, live_run=session, config=session.config, port=port, rate=rate)


def play(run: Path, host: str, port: int, rate: float) -> None:
    """Show a finished run in a browser until Ctrl-C."""
    config = finished_config(run, (), find_meshes=False)
    with precision(config.dtype):
        stored = load_run(run)
        playback = Playback(stored)
    with serving(host, port) as server:
        _show(server, live_run=playback, config=config, port=port, rate=rate)


def _show(
    server: viser.ViserServer,
    live_run: AbstractLiveRun,
    config: SceneConfig,
    port: int,
    rate: float,
) -> None:
    console = open_console()
    view = LiveView(server=server, run=live_run, config=config, rate=rate)
    bound = server.get_port()
    if port not in (0, bound):
        print_line(console, f"port {port} is taken: using {bound}")
    address = f"http://{server.get_host()}:{bound}"
    print_line(console, f"{address} shows {config.name}; Ctrl-C ends it")
    with patient_interrupt() as stopped:
        view.run(stopped)
