"""Frames of a run on one temperature scale, drawn at its end or later."""

import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from ..arrays import precision
from ..config.camera_framing import build_recorder, camera_on
from ..config.loader import load_config, to_yaml
from ..config.schema.scene import SceneConfig
from ..config.types.model import build
from ..console.results_folder import prepare_folder, results_folder
from ..console.terminal import open_console, print_line, status
from ..errors import InputError
from ..image.measurements import AbstractMeasurement, Isotherm, names_of
from ..image.radiance.band import apparent_temperature
from ..image.radiance.draw import Moment
from ..image.radiance.image import Image
from ..image.surface.view import View
from ..integrate.run.abstract_solution import SOLUTION_FILE, StoredSolution
from ..integrate.run.solution_file import load_run
from ..physics.term import AbstractTerm
from ..report.numbers import count
from ..scene.scene import SolvedSurface
from .frame_files import Frame
from .frame_names import FRAMES, earlier_frames, frame_names
from .frame_outputs import Extras, earlier_outputs, write_outputs


# Margin of the colour scale over the range of visible temperatures [-]: the palette's
# end colours stay free for values off the scale.
_RELATIVE_MARGIN = 0.02
# Minimum margin and minimum range of the colour scale [K]: on a smaller one a body of
# uniform temperature would show its rounding.
_MIN_MARGIN = 0.05


class FrameCamera:
    """The config's camera on a scene; it is checked before a long run."""

    def __init__(
        self,
        config: SceneConfig,
        surfaces: tuple[SolvedSurface, ...],
        terms: tuple[AbstractTerm, ...],
    ):
        # The view at the start is computed now: it refuses a camera that is inside a
        # body or sees none.
        self.camera = camera_on(config.camera, surfaces)
        self._image = config.image
        self._recorder = build_recorder(self.camera, config.image)
        self._surfaces = surfaces
        self._terms = terms
        self._view_at_start()

    def _view_at_start(self) -> View:
        return self._recorder.view(self._surfaces, self._terms)

    @property
    def samples(self) -> int:
        """Samples along each axis of a pixel in the images of `detector`."""
        return 1 if self._measures else self._image.samples

    @property
    def _measures(self) -> bool:
        # A camera mixes temperatures in pixels at outlines, and so do its effects.
        effects = self._recorder.effects
        return bool(effects.blur or effects.lag or effects.detector)

    def detector(self, stored: StoredSolution) -> Callable[[int], Image]:
        """Function that draws a frame with all effects and `samples` of each pixel."""
        if not self._measures:
            return functools.partial(self.draw, stored)
        recording = self._recorder.recording(
            functools.partial(self._moment, stored), np.asarray(stored.times)
        )
        return recording.frame

    def remarks(self) -> list[str]:
        """A line for each measurement that is on no body at the start."""
        settings = self._image
        remarks: list[str] = []
        width, height = self.camera.size
        samples = self._image.samples
        fine = np.zeros((samples * height) * (samples * width), bool)
        fine[self._view_at_start().pixel] = True
        blocks = fine.reshape(height, samples, width, samples)
        filled = np.asarray(blocks.all(axis=(1, 3)))
        measurements: tuple[AbstractMeasurement, ...] = build(settings.measurements)
        for name, measurement in zip(names_of(measurements), measurements, strict=True):
            if isinstance(measurement, Isotherm):
                continue
            if not filled[measurement.pixels(np.zeros((height, width)))].any():
                remarks.append(
                    f"note: measurement '{name}' is on the background or an outline at "
                    "the start"
                )
        return remarks

    def draw(self, stored: StoredSolution, index: int) -> Image:
        """Radiation of a saved time in front of the lens, all samples of each pixel."""
        return self._recorder.before_lens(self._moment(stored, index))

    def _moment(self, stored: StoredSolution, index: int) -> Moment:
        # On the host: indexing there compiles no program.
        time = np.asarray(stored.times)[index]
        return Moment(
            surfaces=self._surfaces,
            terms=self._terms,
            temperature=np.asarray(stored.surface_temperature)[index],
            received=stored.irradiance(index),
            time=time,
            load_time=stored.load_time(index),
        )


class SavedTime(NamedTuple):
    """A saved time of a run that becomes a frame."""

    index: int
    seconds: float
    name: str
    """Name of its files, without the ending."""


def chosen_frames(
    config: SceneConfig, times: Float[Array | np.ndarray, " t"]
) -> list[SavedTime]:
    """Saved times [s] that become frames.

    Raises:
        InputError: for a time that was not saved.
    """
    saved = np.asarray(times, float)
    seconds = saved.tolist()
    numbers = range(len(seconds))
    choices = list(map(SavedTime, numbers, seconds, frame_names(seconds)))
    if config.image.frames is None:
        return choices
    indices = [int(np.abs(saved - time).argmin()) for time in config.image.frames]
    for k, time in zip(indices, config.image.frames, strict=True):
        if not np.isclose(saved[k], time, rtol=1e-5):
            raise InputError(f"image.frames: {time:g} s is not a saved time")
    return [choices[k] for k in indices]


def _scale(config: SceneConfig, images: Iterator[Image]) -> tuple[float, float]:
    # The images must not be coarsened yet: a pixel that the silhouette crosses shows a
    # mixture with the background, colder than any point of the body.
    low = config.image.low
    high = config.image.high
    if low is None or high is None:
        coldest = np.inf
        warmest = -np.inf
        for image in images:
            apparent = config.image.quantity == "apparent"
            values = image.radiance if apparent else image.temperature
            seen = np.asarray(values)[np.asarray(image.object_id) >= 0]
            ends = np.array([seen.min(), seen.max()])
            if apparent:
                # It increases with the radiance: the ends of both correspond.
                ends = apparent_temperature(ends, image.band)
            coldest = min(coldest, float(ends[0]))
            warmest = max(warmest, float(ends[1]))
        margin = max(_RELATIVE_MARGIN * (warmest - coldest), _MIN_MARGIN)
        # The config's end may be beyond all temperatures: then pixels have one colour.
        if low is None:
            low = min(coldest - margin, (high or np.inf) - _MIN_MARGIN)
        if high is None:
            high = max(warmest + margin, low + _MIN_MARGIN)
    if not -np.inf < low < high < np.inf:
        raise InputError(
            "image: the temperatures seen are not finite: check the terms, or give "
            "both image.low and image.high"
        )
    return low, high


class _Drawn(NamedTuple):
    """Frames that were written."""

    count: int
    lines: list[str]
    """Lines for the terminal: outputs for all frames together, and remarks."""


def write_frames(
    config: SceneConfig,
    camera: FrameCamera,
    stored: StoredSolution,
    folder: Path,
    extras: Extras,
) -> _Drawn:
    """Draw the frames of a run and the outputs for all of them together.

    Earlier frames are removed: frames of another camera or scale must not be mistaken
    for the new ones. Files with other names stay.

    Args:
        config: of the scene.
        camera: of the frames.
        stored: the run.
        folder: of the run.
        extras: animation and contact sheet.
    """
    frame_times = chosen_frames(config, stored.times)
    # Drawn twice, for the scale and for the file: a long run would fill the memory.
    scale = _scale(config, (camera.draw(stored, time.index) for time in frame_times))
    draw = camera.detector(stored)
    images = (draw(time.index) for time in frame_times)
    frames = prepare_folder(folder / FRAMES)
    earlier = earlier_frames(frames) | earlier_outputs(folder)
    # Written once for all frames: the config of many bodies is long.
    config_text = to_yaml(config) if "exr" in config.image.files else ""
    written, lines = write_outputs(
        config,
        frames=(
            Frame.of(
                config, config_text, image=image, scale=scale, samples=camera.samples
            )
            for image in images
        ),
        times=[time.seconds for time in frame_times],
        folder=folder,
        stems=[frames / time.name for time in frame_times],
        extras=extras,
    )
    for path in earlier - written:
        path.unlink(missing_ok=True)
    return _Drawn(len(frame_times), lines)


def render(
    run: Path, out: Path | None, overrides: tuple[str, ...], extras: Extras
) -> None:
    """`jaxthermo render`: draw a run again, with changes of camera or image."""
    # The solution contains the surface: the mesh file may be missing.
    config = finished_config(run, overrides, find_meshes=False)
    extras.check(config)
    console = open_console()
    target = out or run
    with precision(config.dtype), status(console, "drawing frames"):
        stored = load_run(run)
        camera = FrameCamera(config, stored.surfaces, stored.terms)
        with results_folder(target) as folder:
            frames = write_frames(
                config, camera=camera, stored=stored, folder=folder, extras=extras
            )
    print_line(console, f"{count(frames.count, 'frame')} in {target / FRAMES}")
    for line in frames.lines:
        print_line(console, line)


def finished_config(
    run: Path, overrides: tuple[str, ...], find_meshes: bool
) -> SceneConfig:
    """The config of a finished run, with changes of camera or image.

    Raises:
        InputError: for a folder without a run, or a change of anything else.
    """
    for name in ("config.yaml", SOLUTION_FILE):
        if not (run / name).is_file():
            raise InputError(
                f"{run}: has no {name}; name a folder written by `jaxthermo simulate`"
            )
    for text in overrides:
        section = text.split("=")[0].split(".")[0].strip()
        if section not in ("camera", "image"):
            raise InputError(
                f"--set {text}: only camera and image can change after the run; "
                "use `jaxthermo simulate` for the rest"
            )
    return load_config(run / "config.yaml", overrides, find_meshes=find_meshes)
