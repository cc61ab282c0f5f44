"""Widgets of the live view. They ask for changes; the loop of the server makes them."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import viser
from jaxtyping import UInt8
from viser import uplot

from ..constants import ZERO_CELSIUS
from ..image.colour.palette import palette_names
from ..image.colour.ticks import to_celsius
from .hand_values import HandValue
from .live_run import AbstractLiveRun, Curves
from .panels import RunStatus, status_lines, temperature_bar
from .playback import Playback
from .scale import Scale
from .scene_view import SERIES


Ask = Callable[[str, Any], None]
"""Passes on a request of the user: its name, and its value."""

_RATES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Choices of the rate: seconds of the run per second."""

STRUCTURES = {
    "every voxel": "{{kind: full_volume}}",
    "blocks": "{{kind: aggregate, factor: {factor}}}",
    "layer over blocks": "{{kind: shell_over_core, factor: {factor}}}",
    "octree": "{{kind: octree}}",
}
"""Choices of the structure, as YAML with a factor."""

_AS_GIVEN = "as in the config"


class Controls:
    """All widgets, in two panels, for a simulation or a finished run."""

    def __init__(
        self,
        server: viser.ViserServer,
        ask: Ask,
        rate: float,
        scale: Scale,
        quantity: str,
        run: AbstractLiveRun,
    ):
        self._server = server
        self._gui = server.gui
        self._ask = ask
        self._quantity = quantity
        self._span = span = run.start, run.end
        gui = server.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        self._status = gui.add_html("")
        self._bar = gui.add_html(self._bar_of(scale))
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, color="green")
        self._asks(self._play, "toggle")
        self._asks(gui.add_button("Reset", icon=viser.Icon.PLAYER_SKIP_BACK), "reset")
        names = tuple(str(choice) for choice in _RATES)
        nearest = min(_RATES, key=lambda choice: abs(choice - rate))
        rates = gui.add_dropdown(
            "time rate [s/s]",
            names,
            initial_value=str(nearest),
            hint="seconds of the simulation in one second",
        )
        self._asks(rates, "rate", float)
        self._time = None
        if isinstance(run, Playback):
            step = 10.0 ** math.floor(math.log10((span[1] - span[0]) / 200))
            self._time = gui.add_slider("time [s]", *span, step, span[0])
            self._asks(self._time, "seek")
        with gui.add_folder("Colours"):
            palette = gui.add_dropdown(
                "palette", palette_names(), initial_value=scale.palette
            )
            self._asks(palette, "palette")
            fixed = gui.add_checkbox("range by hand", False)
            self._asks(fixed, "fixed")
            self._fixed = fixed
            self._low = gui.add_number("low [°C]", 0.0, step=0.5)
            self._high = gui.add_number("high [°C]", 1.0, step=0.5)
            self._asks(self._low, "low")
            self._asks(self._high, "high")
        gui.main_panel.set_width(360)
        self._picture: Any = None
        self._camera_bar: Any = None
        self._plot: Any = None
        panel = gui.add_panel()
        panel.dock_left()
        panel.set_width(330)
        self._side = panel.add_tab("Camera and probes")

    def add_values(self, values: tuple[HandValue, ...]) -> None:
        """Add sliders for the values of terms, in a folder for each term."""
        for title in dict.fromkeys(value.title for value in values):
            with self._gui.add_folder(title.capitalize()):
                for value in values:
                    if value.title == title:
                        self._add_value(value)

    def add_structures(self, factor: int) -> None:
        """Add the choice of a structure, for all bodies."""
        with self._gui.add_folder("Structure of the bodies"):
            choices = (_AS_GIVEN, *STRUCTURES)
            structure = self._gui.add_dropdown(
                "structure", choices, initial_value=_AS_GIVEN
            )
            number = self._gui.add_slider("factor", 1, 16, 1, factor)
            button = self._gui.add_button(
                "Build and start again", hint="compiles the program anew"
            )

        @button.on_click
        def _(event: viser.GuiEvent) -> None:
            text = STRUCTURES.get(structure.value)
            built = None if text is None else text.format(factor=int(number.value))
            self._ask("structure", built)

    def show_status(self, status: RunStatus, playing: bool) -> None:
        """Write the lines about the run."""
        self._status.content = status_lines(status)
        self._play.label = "Pause" if playing else "Play"
        icons = viser.Icon.PLAYER_PLAY, viser.Icon.PLAYER_PAUSE
        self._play.icon = icons[playing]
        if self._time is not None:
            self._time.value = status.time

    def show_scale(self, scale: Scale, fixed: bool | None = None) -> None:
        """Draw the temperature bar, and write its ends into the numbers."""
        if fixed is not None:
            self._fixed.value = fixed
        self._bar.content = self._bar_of(scale)
        self._low.value = round(to_celsius(scale.low), 2)
        self._high.value = round(to_celsius(scale.high), 2)

    def show_camera(self, rgb: UInt8[np.ndarray, "h w 3"], scale: Scale) -> None:
        """Show the frame of the scene's camera, and its own scale below."""
        bar = temperature_bar(*scale, self._quantity)
        if self._picture is None:
            with self._side:
                label = "frame of the scene's camera"
                self._picture = self._gui.add_image(rgb, label=label, format="png")
                self._camera_bar = self._gui.add_html(bar)
            return
        self._picture.image = rgb
        if self._camera_bar.content != bar:
            self._camera_bar.content = bar

    def show_curves(self, curves: Curves, names: list[str]) -> None:
        """Draw the temperatures of the probes over time, in degrees Celsius."""
        rows = curves.kelvin.astype(float) - ZERO_CELSIUS
        data = (curves.times.astype(float), *rows)
        series = [uplot.Series(label="t [s]")]
        for name, (r, g, b) in zip(names, SERIES, strict=False):
            series.append(uplot.Series(label=name, stroke=f"rgb({r},{g},{b})", width=2))
        if self._plot is None:
            self._plot = self._new_plot(data, tuple(series))
            return
        # In one piece: a browser checks that there is a series for each row.
        with self._server.atomic():
            if len(self._plot.series) != len(series):
                self._plot.series = tuple(series)
            self._plot.data = data
            self._plot.visible = True

    def _new_plot(self, data: Any, series: tuple[uplot.Series, ...]) -> Any:
        ink = "#c1c2c5"
        grid = uplot.Axis_Grid(stroke="#373a40")
        axes = tuple(
            uplot.Axis(label=name, stroke=ink, grid=grid)
            for name in ("time [s]", "temperature [°C]")
        )
        with self._side:
            return self._gui.add_uplot(
                data,
                series,
                scales={"x": uplot.Scale(time=False, range=self._span)},
                axes=axes,
                legend=uplot.Legend(show=True, live=False),
                height=200,
                padding=(14, 14, 0, 0),
            )

    def hide_curves(self) -> None:
        """Hide the curves."""
        if self._plot is not None:
            self._plot.visible = False

    def add_probe_help(self) -> None:
        """Say how probes are set, with a button that removes them."""
        with self._side:
            self._gui.add_markdown("Click on a body to set a **probe** (up to four).")
            self._asks(self._gui.add_button("Remove probes"), "unprobe")

    def _bar_of(self, scale: Scale) -> str:
        return temperature_bar(*scale, "surface temperature")

    def _add_value(self, value: HandValue) -> None:
        handles = [
            self._gui.add_slider(s.label, s.low, s.high, s.step, s.value)
            for s in value.sliders
        ]

        def changed(event: viser.GuiEvent) -> None:
            text = value.text(tuple(float(handle.value) for handle in handles))
            self._ask("value", (value.path, text))

        for handle in handles:
            handle.on_update(changed)

    def _asks(self, handle: Any, request: str, convert: Callable = lambda v: v) -> None:
        def asked(event: viser.GuiEvent) -> None:
            # The server itself changes widgets too.
            if event.client_id is not None:
                self._ask(request, convert(handle.value))

        if hasattr(handle, "on_click"):
            handle.on_click(asked)
        else:
            handle.on_update(asked)
