"""Outputs of all frames of a run together: animation, contact sheet, measurements."""

import collections
import importlib
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL.Image import Image as Picture

from ..config.schema.scene import SceneConfig
from ..config.types.model import build
from ..errors import InputError
from ..image.colour.annotate import write_png
from ..image.files.animation import (
    ANIMATIONS,
    MAX_BYTES,
    MAX_RATE,
    check_animation,
    default_rate,
    write_animation,
)
from ..image.measurements import (
    AbstractMeasurement,
    Isotherm,
    Reading,
    Spot,
    names_of,
)
from ..progress import duration
from ..report.columns import write_columns
from ..report.frame_sheet import shown_on_sheet, tile_sheet
from ..report.numbers import count
from .frame_files import Frame, start_of


_MEASUREMENTS = "measurements"
_SHEET = "contact_sheet"
_ANIMATION = "animation"
_MEASURED_FILES = tuple(f"{_MEASUREMENTS}.{ending}" for ending in ("csv", "svg", "png"))
OUTPUTS_OF_FRAMES = (
    *_MEASURED_FILES,
    f"{_SHEET}.png",
    *(f"{_ANIMATION}{ending}" for ending in ANIMATIONS.values()),
)
"""Names of the files for all frames together, in the folder of a run."""

# Number of threads that colour, compress and write frames while others are drawn.
_WRITERS = 3


def earlier_outputs(folder: Path) -> set[Path]:
    """The outputs for all frames of an earlier command."""
    return {folder / name for name in OUTPUTS_OF_FRAMES if (folder / name).is_file()}


class Extras(NamedTuple):
    """Outputs for all frames together, as the options of a command select them."""

    animate: str | None = None
    """Kind of animation; None for none."""
    rate: float | None = None
    """Frames per second [1/s]; by default the animation lasts a few seconds."""
    sheet: bool = False

    @classmethod
    def of(
        cls, animate: Sequence[str] | None, rate: float | None, sheet: bool
    ) -> "Extras":
        """Read the options of a command; `--animate` alone means APNG.

        Raises:
            InputError: for a rate out of range or without an animation, or MP4 without
                the package av.
        """
        animation = None if animate is None else next(iter(animate), "apng")
        if rate is not None and animation is None:
            raise InputError(f"--frame-rate {rate:g}: give --animate too")
        if rate is not None and not 0.0 < rate <= MAX_RATE:
            raise InputError(
                f"--frame-rate {rate:g}: give frames a second, up to {MAX_RATE:g}"
            )
        if animation is not None:
            check_animation(animation)
        return cls(animate=animation, rate=rate, sheet=sheet)

    def check(self, config: SceneConfig) -> None:
        """Refuse an animation that does not fit into memory, before a long run.

        Raises:
            InputError: for too many frames of the config's size.
        """
        if self.animate in (None, "mp4"):
            return
        frames = len(config.image.frames or config.time.save_times)
        size = 3 * frames * config.camera.width * config.camera.height
        if size > MAX_BYTES:
            raise InputError(
                f"--animate {self.animate}: {count(frames, 'frame')} of "
                f"{config.camera.width} x {config.camera.height} do not fit into "
                "memory: use mp4, or fewer image.frames"
            )


NO_EXTRAS = Extras()


def write_outputs(
    config: SceneConfig,
    frames: Iterator[Frame],
    times: Sequence[float],
    folder: Path,
    stems: Sequence[Path],
    extras: Extras,
) -> tuple[set[Path], list[str]]:
    """Write the files of each frame, and the outputs for all frames together.

    Args:
        config: of the scene.
        frames: the frames at `times`.
        times: of the frames [s].
        folder: of the run.
        stems: paths of the files of each frame, without the ending of their names.
        extras: the outputs for all frames together.

    Returns:
        The files, and lines for the terminal.
    """
    sheet_indices = shown_on_sheet(len(times)) if extras.sheet else []
    written = _WrittenFrames(set(sheet_indices), animated=extras.animate is not None)
    notes: list[str] = []
    pictures = written.pictures(frames, stems)
    if extras.animate is None:
        # The iterator writes the files; there are no pictures.
        collections.deque(pictures, maxlen=0)
    else:
        rate = extras.rate or default_rate(len(times))
        path = folder / f"{_ANIMATION}{ANIMATIONS[extras.animate]}"
        write_animation(
            path, pictures=pictures, rate=rate, palette=config.image.palette
        )
        written.files.add(path)
        notes.append(f"{path.name}: {_playback(times, rate)}")
    settings = config.image
    if extras.sheet:
        sheet_times = [times[k] for k in sheet_indices]
        low, high = written.scale
        path = folder / f"{_SHEET}.png"
        contact_sheet = tile_sheet(
            written.tiles,
            times=sheet_times,
            total=len(times),
            beyond=written.beyond,
            low=low,
            high=high,
            palette=settings.palette,
            quantity=settings.quantity,
            title=config.name or "",
            start=start_of(config),
        )
        write_png(path, contact_sheet)
        written.files.add(path)
        subset = f"{len(sheet_times)} of " if len(sheet_times) < len(times) else ""
        notes.append(f"{path.name}: {subset}{count(len(times), 'frame')}")
    if settings.measurements:
        measured = _write_measurements(
            config, times=times, readings=written.readings, folder=folder
        )
        written.files.update(measured)
    return written.files, notes + _remarks(config, written)


@dataclass
class _WrittenFrames:
    """Records of the frames, which are drawn and written one by one."""

    on_sheet: set[int]
    """Indices of the frames on the contact sheet."""
    animated: bool
    files: set[Path] = field(default_factory=set)
    tiles: list[np.ndarray] = field(default_factory=list)
    readings: list[dict[str, Reading]] = field(default_factory=list)
    scale: tuple[float, float] = (0.0, 0.0)
    beyond: tuple[bool, bool] = (False, False)
    """Flags of temperatures below and above the scale on the contact sheet."""
    saturated: int = 0

    def pictures(
        self, frames: Iterator[Frame], stems: Sequence[Path]
    ) -> Iterator[Picture]:
        """Write the files of each frame, and yield its picture for an animation."""
        with ThreadPoolExecutor(_WRITERS) as writers:
            pending = collections.deque[Future[list[Path]]]()
            for k, (frame, stem) in enumerate(zip(frames, stems, strict=True)):
                drawn = frame.picture() if self.animated else None
                pending.append(writers.submit(frame.write, stem, drawn))
                self.readings.append(frame.readings)
                self.scale = frame.scale
                self.saturated += frame.saturated
                if k in self.on_sheet:
                    tile = frame.tile()
                    self.tiles.append(tile.colours)
                    below, above = tile.beyond
                    self.beyond = (self.beyond[0] or below, self.beyond[1] or above)
                if drawn is not None:
                    yield drawn
                if len(pending) == _WRITERS:
                    # More pending frames would fill the memory.
                    self.files.update(pending.popleft().result())
            for task in pending:
                self.files.update(task.result())


def _playback(times: Sequence[float], rate: float) -> str:
    frames = f"{count(len(times), 'frame')} at {rate:g} a second"
    steps = np.diff(times)
    if len(steps) and np.allclose(steps, steps[0], rtol=0.01, atol=0):
        interval = duration(float(steps[0]) * rate)
        return f"{frames}, one second shows {interval} of the run"
    return f"{frames}, of times that are not evenly spaced" if len(steps) else frames


def _measured(config: SceneConfig) -> dict[str, AbstractMeasurement]:
    measurements: tuple[AbstractMeasurement, ...] = build(config.image.measurements)
    return dict(zip(names_of(measurements), measurements, strict=True))


def _write_measurements(
    config: SceneConfig,
    times: Sequence[float],
    readings: Sequence[dict[str, Reading]],
    folder: Path,
) -> list[Path]:
    measurements = _measured(config)
    series = {name: [frame[name] for frame in readings] for name in measurements}
    columns: dict[str, np.ndarray] = {}
    for name, measurement in measurements.items():
        rows = np.array(series[name], float)
        table = dict(zip(Reading._fields, rows.T, strict=True))
        match measurement:
            case Isotherm():
                suffixes = {"_fraction": "fraction", "_pixels": "pixels"}
            case Spot():
                suffixes = {"_K": "mean"}
            case _:
                suffixes = {f"_{key}_K": key for key in ("min", "mean", "max")}
        columns |= {f"{name}{end}": table[key] for end, key in suffixes.items()}
    write_columns(folder / f"{_MEASUREMENTS}.csv", times, columns)
    # By name: a run without measurements does not import the library of charts.
    charts: Any = importlib.import_module("jaxthermo.report.measurement_chart")
    charts.write_measurement_chart(
        folder / _MEASUREMENTS,
        times=times,
        measurements=measurements,
        readings=series,
        title=config.name or "",
    )
    return [folder / name for name in _MEASURED_FILES]


def _remarks(config: SceneConfig, written: _WrittenFrames) -> list[str]:
    notes: list[str] = []
    frames = len(written.readings)
    for name, measurement in _measured(config).items():
        without = sum(reading[name].pixels == 0 for reading in written.readings)
        if without and not isinstance(measurement, Isotherm):
            notes.append(
                f"note: measurement '{name}' is on the background or an outline in "
                f"{without} of {count(frames, 'frame')}"
            )
    if written.saturated:
        notes.append(
            f"note: {count(written.saturated, 'pixel')} above 655.35 K in the "
            "centikelvin files have the largest number, 65535"
        )
    return notes
