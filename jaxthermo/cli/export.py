"""`jaxthermo export`: the surfaces of a finished run as files of other programs."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..arrays import precision
from ..atomic import write_json
from ..config.schema.scene import SceneConfig
from ..console.results_folder import results_folder
from ..console.terminal import open_console, print_line, status
from ..errors import InputError
from ..image.files.surfaces import body_rows, temperature_scale, write_glb, write_vtu
from ..image.files.textures import BodyTextures, write_textures
from ..image.files.vtu import write_pvd
from ..integrate.run.abstract_solution import StoredSolution
from ..integrate.run.solution_file import load_run
from ..report.numbers import count
from .frames import SavedTime, chosen_frames, finished_config


class _Run(NamedTuple):
    """A finished run, and the times of it that are exported."""

    config: SceneConfig
    stored: StoredSolution
    times: list[SavedTime]

    @property
    def names(self) -> list[str]:
        """Name of every body: its number and label."""
        return [f"body{n}_{body.label}" for n, body in enumerate(self.config.bodies)]

    @property
    def scale(self) -> tuple[float, float]:
        """Ends of the colour scale [K]: of the config, or of what is exported."""
        image = self.config.image
        indices = [time.index for time in self.times]
        return temperature_scale(
            self.stored, indices=indices, low=image.low, high=image.high
        )


def export(
    run: Path, format: str, out: Path | None, overrides: tuple[str, ...]
) -> None:
    """Write the surfaces of a finished run at its saved times.

    Raises:
        InputError: for an unknown format, a folder without a run, or a time that was
            not saved.
    """
    if format not in _WRITERS:
        raise InputError(f"--format {format}: choose {', '.join(_WRITERS)}")
    config = finished_config(run, overrides, find_meshes=False)
    console = open_console()
    target = out or run / format
    with precision(config.dtype), status(console, "exporting"):
        stored = load_run(run)
        times = chosen_frames(config, stored.times)
        with results_folder(target) as folder:
            written = _WRITERS[format](_Run(config, stored, times), folder)
    print_line(console, f"{count(written, 'file')} in {target}")


def _write_vtu(run: _Run, folder: Path) -> int:
    files = []
    for time in run.times:
        name = f"surface_{time.name}.vtu"
        write_vtu(folder / name, run.stored, time.index, names=run.names)
        files.append((time.seconds, name))
    write_pvd(folder / "surface.pvd", files)
    return len(files) + 1


def _write_glb(run: _Run, folder: Path) -> int:
    low, high = run.scale
    for time in run.times:
        write_glb(
            folder / f"{time.name}.glb",
            run.stored,
            time.index,
            names=run.names,
            low=low,
            high=high,
            palette=run.config.image.palette,
        )
    return len(run.times)


def _write_texture(run: _Run, folder: Path) -> int:
    low, high = run.scale
    stored = run.stored
    pages = []
    written = 0
    for n, rows in enumerate(body_rows(stored)):
        geometry = stored.surfaces[n].geometry
        kelvin = np.asarray(stored.surface_temperature, float)[:, rows]
        frames = [(time.name, kelvin[time.index]) for time in run.times]
        body = BodyTextures(name=run.names[n], geometry=geometry, low=low, high=high)
        page = write_textures(
            folder, body=body, frames=frames, palette=run.config.image.palette
        )
        written += len(page["files"])
        for time, entry in zip(run.times, page["textures"], strict=True):
            written += len(entry["files"])
            pose = geometry.pose.at(time.seconds)
            entry["time_s"] = time.seconds
            entry["pose"] = {
                "translation_m": list(pose.translation),
                "rotation": [list(row) for row in pose.rotation],
            }
        pages.append(page)
    notes = {
        "units": "16-bit PNG: 0.01 K; EXR: K; heat PNG: 8 bits from low_K to high_K",
        "low_K": low,
        "high_K": high,
        "bodies": pages,
    }
    write_json(folder / "textures.json", notes)
    return written + 1


_WRITERS: dict[str, Callable[[_Run, Path], int]] = {
    "vtu": _write_vtu,
    "glb": _write_glb,
    "texture": _write_texture,
}
