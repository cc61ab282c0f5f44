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
from ..image.colour.ticks import time_label
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
from ..report.columns import write_columns
from ..report.frame_sheet import shown_on_sheet, tile_sheet
from ..report.numbers import count
from .frame_files import Frame


_MEASUREMENTS, _SHEET, _ANIMATION = "measurements", "contact_sheet", "animation"
_MEASURED_FILES = tuple(f"{_MEASUREMENTS}.{kind}" for kind in ("csv", "svg", "png"))
OUTPUTS_OF_FRAMES = (
    *_MEASURED_FILES,
    f"{_SHEET}.png",
    *(f"{_ANIMATION}{ending}" for ending in ANIMATIONS.values()),
)
"""Names of the files in the folder of a run that are of all frames together."""

# Colours, compression and disk of some frames, while the next one is drawn.
_WRITERS = 3


def earlier_outputs(folder: Path) -> set[Path]:
    """The outputs of all frames of an earlier command."""
    return {folder / name for name in OUTPUTS_OF_FRAMES if (folder / name).is_file()}


class Extras(NamedTuple):
    """Outputs of all frames that options of a command ask for."""

    animate: str | None = None
    """Kind of animation; None for none."""
    rate: float | None = None
    """Frames a second [1/s]; chosen by their number if None."""
    sheet: bool = False

    @classmethod
    def of(
        cls, animate: Sequence[str] | None, rate: float | None, sheet: bool
    ) -> "Extras":
        """Read the options of a command, of which `--animate` alone means APNG.

        Raises:
            InputError: for a rate that is none or without an animation, or MP4 without
                the package av.
        """
        kind = None if animate is None else next(iter(animate), "apng")
        if rate is not None and kind is None:
            raise InputError(f"--frame-rate {rate:g}: give --animate too")
        if rate is not None and not 0.0 < rate <= MAX_RATE:
            raise InputError(
                f"--frame-rate {rate:g}: give frames a second, up to {MAX_RATE:g}"
            )
        if kind is not None:
            check_animation(kind)
        return cls(kind, rate, sheet)

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
    """Write the files of all frames, and those of all together.

    Args:
        config: of the scene.
        frames: at the times.
        times: of the frames [s].
        folder: of the run.
        stems: paths of the files of each frame, without the end of their names.
        extras: what is asked for beside them.

    Returns:
        The files, and lines for the terminal.
    """
    on_sheet = set(shown_on_sheet(len(times)) if extras.sheet else ())
    seen, notes = _Seen(on_sheet, extras.animate is not None), list[str]()
    pictures = seen.pictures(frames, stems)
    if extras.animate is None:
        # Without pictures this writes the files alone.
        collections.deque(pictures, maxlen=0)
    else:
        rate = extras.rate or default_rate(len(times))
        path = folder / f"{_ANIMATION}{ANIMATIONS[extras.animate]}"
        write_animation(
            path, pictures=pictures, rate=rate, palette=config.image.palette
        )
        seen.files.add(path)
        notes.append(f"{path.name}: {_playback(times, rate)}")
    how = config.image
    if extras.sheet:
        shown, colours = (
            [times[k] for k in sorted(on_sheet)],
            (how.palette, how.quantity),
        )
        path = folder / f"{_SHEET}.png"
        whole = tile_sheet(seen.tiles, shown, *seen.scale, *colours, config.name or "")
        write_png(path, whole)
        seen.files.add(path)
        part = f"{len(shown)} of " if len(shown) < len(times) else ""
        notes.append(f"{path.name}: {part}{count(len(times), 'frame')}")
    if how.measurements:
        measured = _write_measurements(
            config, times=times, readings=seen.readings, folder=folder
        )
        seen.files.update(measured)
    return seen.files, notes + _remarks(config, seen)


@dataclass
class _Seen:
    """Traces of the frames, which are drawn and written one by one."""

    on_sheet: set[int]
    """Numbers of the frames of which tiles are kept."""
    animated: bool
    files: set[Path] = field(default_factory=set)
    tiles: list[np.ndarray] = field(default_factory=list)
    readings: list[dict[str, Reading]] = field(default_factory=list)
    scale: tuple[float, float] = (0.0, 0.0)
    saturated: int = 0

    def pictures(
        self, frames: Iterator[Frame], stems: Sequence[Path]
    ) -> Iterator[Picture]:
        """Write the files of each frame, and yield its picture for an animation."""
        with ThreadPoolExecutor(_WRITERS) as writers:
            written = collections.deque[Future[list[Path]]]()
            for k, (frame, stem) in enumerate(zip(frames, stems, strict=True)):
                drawn = frame.picture() if self.animated else None
                written.append(writers.submit(frame.write, stem, drawn))
                self.readings.append(frame.readings)
                self.scale = frame.scale
                self.saturated += frame.saturated
                if k in self.on_sheet:
                    self.tiles.append(frame.tile())
                if drawn is not None:
                    yield drawn
                if len(written) == _WRITERS:
                    # More that wait would fill the memory.
                    self.files.update(written.popleft().result())
            for each in written:
                self.files.update(each.result())


def _playback(times: Sequence[float], rate: float) -> str:
    frames = f"{count(len(times), 'frame')} at {rate:g} a second"
    steps = np.diff(times)
    if len(steps) and np.allclose(steps, steps[0], rtol=0.01, atol=0):
        shown = time_label(float(steps[0]) * rate).removeprefix("t = ")
        return f"{frames}, one second shows {shown} of the run"
    return f"{frames}, of times that are not evenly spaced" if len(steps) else frames


def _measured(config: SceneConfig) -> dict[str, AbstractMeasurement]:
    given: tuple[AbstractMeasurement, ...] = build(config.image.measurements)
    return dict(zip(names_of(given), given, strict=True))


def _write_measurements(
    config: SceneConfig,
    times: Sequence[float],
    readings: Sequence[dict[str, Reading]],
    folder: Path,
) -> list[Path]:
    measurements = _measured(config)
    of_each = {name: [frame[name] for frame in readings] for name in measurements}
    columns = dict[str, np.ndarray]()
    for name, each in measurements.items():
        rows = np.array(of_each[name], float)
        table = dict(zip(Reading._fields, rows.T, strict=True))
        match each:
            case Isotherm():
                shown = {"_fraction": "fraction", "_pixels": "pixels"}
            case Spot():
                shown = {"_K": "mean"}
            case _:
                shown = {f"_{key}_K": key for key in ("min", "mean", "max")}
        columns |= {f"{name}{end}": table[key] for end, key in shown.items()}
    write_columns(folder / f"{_MEASUREMENTS}.csv", times, columns)
    # By name: a run without measurements does not wait for the library of charts.
    charts: Any = importlib.import_module("jaxthermo.report.measurement_chart")
    path, title = folder / _MEASUREMENTS, config.name or ""
    charts.write_measurement_chart(path, times, measurements, of_each, title)
    return [folder / name for name in _MEASURED_FILES]


def _remarks(config: SceneConfig, seen: _Seen) -> list[str]:
    notes, frames = list[str](), len(seen.readings)
    for name, each in _measured(config).items():
        without = sum(reading[name].pixels == 0 for reading in seen.readings)
        if without and not isinstance(each, Isotherm):
            notes.append(
                f"note: measurement '{name}' is on the background or an outline in "
                f"{without} of {count(frames, 'frame')}"
            )
    if seen.saturated:
        notes.append(
            f"note: {count(seen.saturated, 'pixel')} above 655.35 K in the centikelvin "
            "files have the largest number, 65535"
        )
    return notes
